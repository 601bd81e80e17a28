# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The maps a study compares: the standard one, and others of the same clouds with one thing changed."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from maxcon._system.atomic import make_folder
from maxcon._system.progress import Progress
from maxcon.errors import OptionError
from maxcon.lab.dataset import Dataset

__all__ = ["MAP_VARIANTS", "STANDARD", "MapVariant", "make_maps"]

STANDARD = "standard"


@dataclass(frozen=True, slots=True)
class MapVariant:
    """How a map of a dataset differs from the standard one.

    cell: voxel edge, m.
    keep_every: one of so many points of the clouds is kept.
    keeps_ground: whether the ground stays in.
    """

    cell: float = 0.06
    keep_every: int = 1
    keeps_ground: bool = False


MAP_VARIANTS: dict[str, MapVariant] = {
    STANDARD: MapVariant(),
    "cell-0.03": MapVariant(cell=0.03),
    "cell-0.12": MapVariant(cell=0.12),
    "cell-0.20": MapVariant(cell=0.20),
    "density-1/4": MapVariant(keep_every=4),
    "density-1/16": MapVariant(keep_every=16),
    "ground": MapVariant(keeps_ground=True),
}
"""By name; the names are those in the table of a study."""


def make_maps(
    dataset: Dataset, folder: Path, names: Iterable[str], progress: Progress | None = None
) -> dict[str, Path]:
    """Build the maps that are not there yet; return the path of each.

    dataset: its clouds, or its built map, which is the standard one.
    folder: where the maps go, a folder each.
    names: of `MAP_VARIANTS`.
    progress: called with (step, done, of how many).
    """
    from maxcon.lab.dataset_options import dataset_map_options
    from maxcon.mapping.build import build_map

    paths = {}
    for name in dict.fromkeys(names):
        if dataset.map_path is not None:
            if name != STANDARD:
                raise OptionError(
                    f"Expected clouds in {dataset.path} to build the map {name!r} from, got a built map."
                    f" Leave out the methods that need it, or name clouds under [map]."
                )
            paths[name] = dataset.map_path
            continue
        path = folder / f"{name.replace('/', '-')}.map"
        if not path.exists():
            variant = MAP_VARIANTS[name]
            options = dataset_map_options(
                dataset, cell=variant.cell, keep_every=variant.keep_every, keeps_ground=variant.keeps_ground
            )
            make_folder(folder)
            build_map(dataset.map_clouds, path, options, progress=_named(progress, name))
        paths[name] = path
    return paths


def _named(progress: Progress | None, name: str) -> Progress | None:
    """Return a progress callback that names the map."""
    if progress is None:
        return None

    def report(step: str, done: int, total: int) -> None:
        progress(f"map {name}: {step}", done, total)

    return report
