# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How the map of a dataset is made: what its description says, as options of a map."""

from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.mapping.build.classes import DEFAULT_DROP, parse_classes
from maxcon.mapping.build.options import MapOptions

__all__ = ["dataset_map_options"]


def dataset_map_options(
    dataset: Dataset, *, cell: float = 0.06, keep_every: int = 1, keeps_ground: bool = False
) -> MapOptions:
    """Return the options to build the map of a dataset from its clouds.

    dataset: what is dropped, which classes mean vehicles, where the mapping sensor was, and how well the map is known.
    cell: voxel edge, m.
    keep_every: of so many points one is kept.
    keeps_ground: whether the ground stays in the map: a baseline that needs it may have it.
    """
    trajectory = dataset.map_trajectory
    return MapOptions(
        cell=cell,
        drop=_without_ground(dataset.drop) if keeps_ground else dataset.drop,
        vehicle_classes=dataset.vehicle_classes,
        trajectory=read_trajectory(trajectory) if trajectory is not None else None,
        normals_have_sides=dataset.normals_have_sides,
        crs=dataset.crs,
        keep_every=keep_every,
        sigma=dataset.map_sigma,
    )


def _without_ground(drop: tuple[str, ...] | None) -> tuple[str, ...]:
    """Return what is dropped, but for the ground."""
    ground = parse_classes(["ground"])
    return tuple(name for name in (DEFAULT_DROP if drop is None else drop) if not parse_classes([name]) <= ground)
