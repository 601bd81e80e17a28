# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon map update`, and what `maxcon map info` says of updates."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from maxcon.cli.flags import flags
from maxcon.cli.options import Quiet, RangeOptions
from maxcon.cli.terminal import compiling_told, step_bars

__all__ = ["rows_of_updates", "update"]


@flags
def update(
    *,
    map_folder: Annotated[Path, typer.Argument(metavar="MAP", help="Map made by `maxcon map build`.")],
    drives: Annotated[
        list[Path],
        typer.Argument(
            metavar="DRIVES...",
            help="Scans and the table of their poses in turn: SCANS POSES.csv SCANS POSES.csv ... Scans as `maxcon"
            " localize` takes them, or a dataset.toml, whose reference poses are taken if no table follows. Of many"
            " drives a table is FOLDER/drive=NAME/poses.parquet.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="MAP2", help="Folder of the new version.")],
    reach: Annotated[
        float, typer.Option(metavar="M", help="Surfaces farther from the sensor are not judged, m.")
    ] = 30.0,
    least_looks: Annotated[
        int, typer.Option(metavar="N", help="Looks from places at least 0.5 m apart that it takes to call a change.")
    ] = 2,
    ranges: RangeOptions,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace MAP2 if there is one.")] = False,
    quiet: Quiet = False,
) -> None:
    """Write a new version of a map, in which what drives saw through is gone, and what they saw newly is new.

    Only epochs called localized count. Searches in MAP2 leave out what is gone. MAP is not touched.
    """
    from maxcon.lab.dataset import open_drives
    from maxcon.mapping.update import UpdateOptions, update_map

    options = UpdateOptions(
        reach=reach, least_looks=least_looks, min_range=ranges.min_range, max_range=ranges.max_range
    )
    with step_bars("", quiet) as report, compiling_told(quiet):
        manifest = update_map(map_folder, open_drives(drives), out, options, overwrite=overwrite, progress=report)
    typer.echo(f"{out}")
    for name, text in rows_of_updates(manifest.build.get("updates", [])):
        typer.echo(f"{name:<12} {text}")


def rows_of_updates(updates: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """What of a map is gone and new, and how it came so: names and words."""
    if not updates:
        return []
    last = updates[-1]
    total = max(last["n_known"] + last["n_gone"] + last["n_new"], 1)
    rows = [
        (name, f"{last[f'n_{name}']:,} voxels, {100.0 * last[f'n_{name}'] / total:.2f} %")
        for name in ("known", "gone", "new")
    ]
    for number, each in enumerate(updates, 1):
        drives = ", ".join(f"{drive['name']} ({drive['n_looks']:,} looks)" for drive in each["drives"])
        changed = f"{each['n_now_gone']:,} gone, {each['n_now_new']:,} new, {each['n_back']:,} back"
        parent = each["parent"]
        words = f"{number} of {parent['name']} {parent['sha256'][:8]} by {drives}: {each['n_judged']:,} seen, {changed}"
        rows.append(("update", words))
    return rows
