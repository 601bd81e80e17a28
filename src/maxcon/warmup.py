"""Compiling before the first real call: a tiny room is mapped and a scan localized in it, in every way there is.

No kernel is named here: what the public functions call is compiled, also what they will call one day.
"""

from collections.abc import Callable, Iterable
from dataclasses import fields
from enum import Enum
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.mapping.build import MapOptions, build_map
from maxcon.refine.fit import surface_thickness
from maxcon.relocalization import Relocalizer
from maxcon.scan import Scan
from maxcon.search import consensus_set
from maxcon.search.objectives import OBJECTIVES
from maxcon.search.space import SearchSpace

PRIOR = Pose(0.02, -0.03, 0.0, 0.0, 0.0, 0.0)
SPACE = SearchSpace(0.24, 0.06, 0.5, 0.5)
LARGER = 5.0
# A tile of the map with a single point: arrays of one row are of another memory layout, and so of another type.
LONELY = np.array([[40.0, 0.0, 0.0]])


def parts_to_compile(folder: Path) -> dict[str, Callable[[], object]]:
    """Return what compiles all that building maps and localizing call, part by part; files are made in `folder`."""
    return {
        "building maps": lambda: _build(folder),
        "normals of scans": lambda: _scan().normals,
        "search in maps in memory": _search_in_memory,
        "search in maps on disk": lambda: _search_on_disk(folder),
        "search without a prior": _search_without_prior,
    }


def _room() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of a room of 8 by 6 m as a scanner of 8 rings sees them, and their normals, shape (n, 3), m."""
    azimuths, elevations = np.meshgrid(np.radians(np.arange(0.0, 360.0, 2.0)), np.radians(np.arange(-7.0, 8.0, 2.0)))
    x, y = np.cos(azimuths).ravel(), np.sin(azimuths).ravel()
    is_end = np.abs(x) * 3.0 > np.abs(y) * 4.0
    distances = 1.0 / np.where(is_end, np.abs(x) / 4.0, np.abs(y) / 3.0)
    points = np.column_stack([x, y, np.tan(elevations).ravel()]) * distances[:, None]
    normals = np.column_stack([-np.sign(x) * is_end, -np.sign(y) * ~is_end, np.zeros(len(x))])
    return points, normals


def _floor() -> NDArray[np.float64]:
    """Points on the floor of the room, shape (n, 3), m."""
    x, y = np.meshgrid(np.arange(-4.0, 4.0, 0.25), np.arange(-3.0, 3.0, 0.25))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -0.6)])


def _scan() -> Scan:
    return Scan(np.concatenate([_room()[0], _floor()]))


def _build(folder: Path) -> None:
    """Build a map whose normals have sides, and one whose normals are fitted and classes found, in `folder`."""
    points, normals = _room()
    points = np.concatenate([points, LONELY])
    normals = np.concatenate([normals, [[0.0, 0.0, 1.0]]]).astype(np.float32)
    np.savez(folder / "signed.npz", points=points, normals=normals)
    np.savez(folder / "unsigned.npz", points=points, times=np.zeros(len(points)))
    for name, is_signed in (("signed", True), ("unsigned", False)):
        options = MapOptions(
            cell=SPACE.cell_edge, drop=(), normals_have_sides=is_signed, classify="off" if is_signed else "always"
        )
        build_map([folder / f"{name}.npz"], folder / f"{name}.map", options, n_threads=1)


def search_room(methods: Iterable[MaximumConsensus], *, is_signed: bool = True) -> None:
    """Let methods with the space `SPACE` localize a scan of the room in a map in memory."""
    points, normals = _room()
    _search(PointMap.from_points(points, normals, SPACE.cell_edge, is_signed=is_signed, ground=_floor()), methods)


def _search_in_memory() -> None:
    for is_signed in (True, False):
        search_room(_all_methods(), is_signed=is_signed)


def _search_on_disk(folder: Path) -> None:
    """Search in files: the arrays of their tiles are read-only, which is another type."""
    for name in ("signed", "unsigned"):
        _search(PointMap.open(folder / f"{name}.map"), _all_methods())


def _search_without_prior() -> None:
    """Search a whole map: of the room, but as large as a square, or too few points would take part."""
    points, normals = _room()
    point_map = PointMap.from_points(LARGER * points, normals, SPACE.cell_edge, ground=LARGER * _floor())
    Relocalizer(point_map).localize(Scan(LARGER * _scan().points))


def _all_methods() -> list[MaximumConsensus]:
    return [
        MaximumConsensus(SPACE, objective, **options)
        for objective, options in product(OBJECTIVES, options_of_the_method())
    ]


def _search(point_map: PointMap, methods: Iterable[MaximumConsensus]) -> None:
    scan = _scan()
    for method in (*methods, MaximumConsensus()):  # all in the same cells, and coarse to fine
        method.localize(scan, point_map, PRIOR)
    consensus_set(scan, point_map, PRIOR, SPACE, cell=(0, 0, 0))
    surface_thickness(scan.sample.points, scan.sample.normals)  # measured where few points are close


def options_of_the_method() -> list[dict[str, Any]]:
    """All values of all options of the method that have names for values, each with each."""
    choices = {field.name: type(field.default) for field in fields(MaximumConsensus) if isinstance(field.default, Enum)}
    return [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]
