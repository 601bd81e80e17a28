"""What files, processes and compiled code need, whatever is computed: outputs in one step, locks, work gone on with."""

from collections.abc import Callable

__all__ = ["Progress"]

Progress = Callable[[str, int, int], None]
"""A function that long jobs call as they go on, with (step, number done, number in all)."""
