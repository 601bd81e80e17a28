"""What files, processes and compiled code need, whatever is computed: outputs in one step, locks, work gone on with."""

from collections.abc import Callable

__all__ = ["Progress"]

Progress = Callable[[str, int, int], None]
"""How long jobs tell how far they are: called with (step, done, of how many)."""
