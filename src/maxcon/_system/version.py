"""The version, at the bottom of the house where everybody may read it."""

__version__ = "0.1.0"
