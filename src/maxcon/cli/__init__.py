# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The command line: it parses, calls and prints; the work is done by importable functions."""

import sys
from typing import Annotated

import typer

from maxcon.cli import laboratory, maps, preparation
from maxcon.cli.export import export
from maxcon.cli.flags import GroupedCommand
from maxcon.cli.live import live
from maxcon.cli.localize import localize, relocalize
from maxcon.cli.terminal import Stop, stopping_in_order, warn
from maxcon.errors import MaxconError

__all__ = ["app", "main"]

app = typer.Typer(
    name="maxcon", help="Maximum-consensus localization of LiDAR scans in a point-cloud map.", no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]}, rich_markup_mode=None,
    pretty_exceptions_enable=False,
)  # fmt: skip
app.add_typer(maps.app, name="map")
app.add_typer(preparation.scans, name="scans")
app.command(cls=GroupedCommand, short_help="Localize every scan of a drive in a map.")(localize)
app.command(cls=GroupedCommand, short_help="Find scans in a map without any prior.")(relocalize)
app.command(cls=GroupedCommand, short_help="Localize scans as they come by ROS 2.")(live)
app.command(short_help="Write poses as GeoJSON, GeoPackage, KML, TUM, KITTI.")(export)
app.command(short_help="Simulate a city, its mapping and scans.")(laboratory.simulate)
app.command(cls=GroupedCommand, short_help="Compare methods over the epochs of a dataset.")(laboratory.study)
app.command(short_help="Write the page of a study.")(laboratory.report)
app.command(short_help="Simulate, map, localize and report a small city.")(laboratory.demo)
app.command(short_help="Compile once, so that the first call does not pause.")(preparation.warmup)


def _print_version(is_wanted: bool) -> None:
    if is_wanted:
        from maxcon import __version__

        typer.echo(f"maxcon {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and end.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Maximum-consensus localization of LiDAR scans in a point-cloud map."""


def main() -> None:
    """Run the command line; what the user can mend is one line on stderr and exit code 2."""
    with stopping_in_order() as received:
        try:
            app()
        except Stop as stop:
            if not stop.is_told:
                warn("maxcon: stopped")
            raise
        except (MaxconError, SystemError) as error:
            if received:  # in a compiled function or a reader, where the exception became another one
                warn("maxcon: stopped")
                sys.exit(128 + received[0])
            if isinstance(error, SystemError):
                raise
            typer.echo(f"maxcon: {one_line(str(error))}", err=True)
            sys.exit(2)


def one_line(words: str) -> str:
    """Return words in one line: line ends and other control characters, as names of files may have, as escapes."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in words)
