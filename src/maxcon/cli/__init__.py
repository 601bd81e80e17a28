"""The command line: it parses, calls and prints; the work is done by importable functions."""

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from maxcon.cli import laboratory, maps
from maxcon.cli.export import export
from maxcon.cli.flags import GroupedCommand
from maxcon.cli.live import live
from maxcon.cli.localize import localize, relocalize
from maxcon.cli.options import IsJson, Topic
from maxcon.cli.terminal import Stop, print_json, stopping_in_order, warn
from maxcon.errors import MaxconError

__all__ = ["app", "main"]


def warmup(quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Only the last line.")] = False) -> None:
    """Compile what `map build` and `localize` need, once after installation: the first real call does not pause then.

    A call when all is compiled already says so, and where the code is kept.
    """
    from tempfile import TemporaryDirectory

    from maxcon._system.kernel_cache import checked_code_folder, on_compilation
    from maxcon.errors import FileError
    from maxcon.warmup import parts_to_compile

    compiled: list[str] = []
    kept_in, began = checked_code_folder(), time.perf_counter()
    try:
        with TemporaryDirectory(prefix="maxcon-warmup-") as folder:
            for part, run in parts_to_compile(Path(folder)).items():
                if not quiet:
                    typer.echo(f"{part:<26}", nl=False)
                start = time.perf_counter()
                with on_compilation(lambda part=part: compiled.append(part)):  # type: ignore[misc]
                    run()
                took = f"compiled in {time.perf_counter() - start:.1f} s" if part in compiled else "compiled already"
                if not quiet:
                    typer.echo(took)
    except OSError as error:
        raise FileError(
            f"Expected to be able to write {error.filename or 'compiled code'}, got: {error.strerror or error}."
            " Check the folder, its permissions and the free disk space."
        ) from error
    begin = f"compiled in {time.perf_counter() - began:.0f} s" if compiled else "everything was compiled already"
    typer.echo(f"{begin}; the code is kept in {kept_in}")


scans = typer.Typer(help="Say what is in scans or a recording.", no_args_is_help=True, rich_markup_mode=None)


@scans.callback()
def _group() -> None:
    """Say what is in scans or a recording."""


@scans.command()
def info(
    path: Annotated[Path, typer.Argument(metavar="SCANS", help="Scans or a recording, as of `maxcon localize`.")],
    topic: Topic = None,
    is_json: IsJson = False,
) -> None:
    """Print topics, fields, how times of points are understood and why, rate, extent, and shares of points."""
    from rich.console import Console
    from rich.table import Column, Table

    from maxcon.io.scans import describe
    from maxcon.io.text import printable

    found = describe(path, topic)
    if is_json:
        print_json(found._asdict() | {"scanners": [scanner.facts for scanner in found.scanners]})
        return
    console = Console(highlight=False, markup=False)  # names in files are no markup
    if found.topics:
        names = [Column("topic", overflow="fold"), Column("type", overflow="fold"), Column("messages", justify="right")]
        topics = Table(*names, box=None, pad_edge=False)
        for one in found.topics:
            topics.add_row(printable(one.name), printable(one.type), f"{one.n_messages:,}")
        console.print(topics)
    for note in found.notes:
        console.print(note)
    if not found.scanners:
        console.print("no point cloud that can be read")
    for scanner in found.scanners:
        table = Table("", "", show_header=False, box=None, pad_edge=False)
        for row in scanner.words.items():
            table.add_row(*row)
        console.print()
        console.print(table)


app = typer.Typer(
    name="maxcon", help="Maximum-consensus localization of LiDAR scans in a point-cloud map.", no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]}, rich_markup_mode=None,
    pretty_exceptions_enable=False,
)  # fmt: skip
app.add_typer(maps.app, name="map")
app.add_typer(scans, name="scans")
app.command(cls=GroupedCommand, short_help="Localize every scan of a drive in a map.")(localize)
app.command(cls=GroupedCommand, short_help="Find scans in a map without any prior.")(relocalize)
app.command(cls=GroupedCommand, short_help="Localize scans as they come by ROS 2.")(live)
app.command(short_help="Write poses as GeoJSON, GeoPackage, KML, TUM, KITTI.")(export)
app.command(short_help="Simulate a city, its mapping and scans.")(laboratory.simulate)
app.command(cls=GroupedCommand, short_help="Compare methods over the epochs of a dataset.")(laboratory.study)
app.command(short_help="Write the page of a study.")(laboratory.report)
app.command(short_help="Simulate, map, localize and report a small city.")(laboratory.demo)
app.command(short_help="Compile once, so that the first call does not pause.")(warmup)


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
