# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon warmup`."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from maxcon.warmup import Compiled

__all__ = ["warmup"]


def warmup(quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Only the last line.")] = False) -> None:
    """Compile what `map build` and `localize` need, once after installation: the first real call does not pause then.

    A call when all is compiled already says so, and where the code is kept.
    """
    from maxcon._system.compiled import check_code_folder
    from maxcon._system.kernel_cache import code_folder
    from maxcon.errors import FileError
    from maxcon.warmup import warm_up

    done: list[Compiled] = []

    def report(part: str, compiled: "Compiled | None") -> None:
        if compiled is not None:
            done.append(compiled)
        if quiet:
            return
        if compiled is None:
            typer.echo(f"{part:<26}", nl=False)
        elif compiled.n_functions:
            typer.echo(f"compiled in {compiled.seconds:.1f} s")
        else:
            typer.echo("compiled already")

    check_code_folder()
    try:
        warm_up(report)
    except OSError as error:
        raise FileError(
            f"Expected to be able to write {error.filename or 'compiled code'}, got: {error.strerror or error}."
            " Check the folder, its permissions and the free disk space."
        ) from error
    seconds = sum(compiled.seconds for compiled in done)
    is_new = any(compiled.n_functions for compiled in done)
    begin = f"compiled in {seconds:.0f} s" if is_new else "everything was compiled already"
    typer.echo(f"{begin}; the code is kept in {code_folder()}")
