# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Progress bars on stderr that also tell the rate; none where stderr is not a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress

    from maxcon._system.progress import Progress as StepProgress

__all__ = ["progress_bar", "step_bars", "warn"]

SPEED_PERIOD = 600.0
"""The time left is estimated from the last so many seconds: a step of a study may take a minute."""


def warn(line: str) -> None:
    """Say on stderr what a command is at, or is waiting for."""
    print(line, file=sys.stderr, flush=True)  # noqa: T201


def _new_bars(unit: str) -> "Progress":
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    class Rate(TextColumn):
        def render(self, task: Any) -> Any:
            speed = task.finished_speed or task.speed
            self.text_format = f"{speed:,.1f} {unit}/s" if speed and unit else ""
            return super().render(task)

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(""),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        speed_estimate_period=SPEED_PERIOD,
    )


@contextmanager
def progress_bar(title: str, total: int, unit: str, is_quiet: bool, n_before: int = 0) -> Iterator[Callable[[], None]]:
    """Yield a function to call after each of `total` units, of which `n_before` were done before."""
    n_done = n_before
    with step_bars(unit, is_quiet) as report:

        def advance() -> None:
            nonlocal n_done
            n_done += 1
            report(title, n_done, total)

        yield advance


@contextmanager
def step_bars(unit: str, is_quiet: bool, *, has_lines: bool = False) -> Iterator["StepProgress"]:
    """Yield a function to call with (step, done, of how many); each step gets a bar of its own.

    Where stderr is not a terminal there are none; with `has_lines` a line says when a step begins.
    """
    if is_quiet or not sys.stderr.isatty():
        yield _Lines().tell if has_lines and not is_quiet else lambda step, done, total: None
        return
    bars = _new_bars(unit)
    tasks: dict[str, Any] = {}

    def report(step: str, done: int, total: int) -> None:
        if not tasks:
            bars.start()
        if step not in tasks:
            tasks[step] = bars.add_task(step, total=total)
        bars.update(tasks[step], completed=done, total=total)

    try:
        yield report
    finally:
        if tasks:
            bars.stop()


class _Lines:
    """A line on stderr for each step, when it begins."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def tell(self, step: str, done: int, total: int) -> None:
        if step not in self._told:
            self._told.add(step)
            warn(f"{step} ...")
