"""The laboratory: what it takes to study the method, and not to use it."""
