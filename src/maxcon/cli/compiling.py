# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One line on stderr where a command pauses to compile; none where stderr is not a terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer

__all__ = ["compiling_told"]

LINE = "compiling, once after installation: up to a minute (`maxcon warmup` does it before)"


@contextmanager
def compiling_told(is_quiet: bool) -> Iterator[None]:
    """Say so, once, when something has to be compiled while this is open."""
    from maxcon._system.compiled import failures_to_keep_told, on_compilation

    is_told = is_quiet or not sys.stderr.isatty()

    def tell() -> None:
        nonlocal is_told
        if not is_told:
            is_told = True
            typer.echo(LINE, err=True)

    with failures_to_keep_told(), on_compilation(tell):
        yield
