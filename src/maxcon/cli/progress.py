# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A progress bar on stderr that also tells the rate."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["progress_bar", "step_bars"]


@contextmanager
def _bars(unit: str, is_quiet: bool) -> Iterator[Any]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    class Rate(TextColumn):
        def render(self, task: Any) -> Any:
            speed = task.finished_speed or task.speed
            self.text_format = f"{speed:,.1f} {unit}/s" if speed and unit else ""
            return super().render(task)

    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(""),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=is_quiet,
    ) as progress:
        yield progress


@contextmanager
def progress_bar(title: str, total: int, unit: str, is_quiet: bool) -> Iterator[Callable[[], None]]:
    """Yield a function to call after each of `total` units."""
    with _bars(unit, is_quiet) as progress:
        task = progress.add_task(title, total=total)
        yield lambda: progress.advance(task)


@contextmanager
def step_bars(unit: str, is_quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function to call with (step, done, of how many); each step gets a bar of its own."""
    with _bars(unit, is_quiet) as progress:
        tasks: dict[str, Any] = {}

        def report(step: str, done: int, total: int) -> None:
            if step not in tasks:
                tasks[step] = progress.add_task(step, total=total)
            progress.update(tasks[step], completed=done, total=total)

        yield report
