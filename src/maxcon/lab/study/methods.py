"""Methods of a study by name, and the variants of the map they are given."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from maxcon._system import Progress
from maxcon._system.atomic import make_folder
from maxcon.drive.localize import Method
from maxcon.errors import MissingExtraError, OptionError
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MapTargets, MultiStart, check_small_gicp
from maxcon.lab.dataset import Dataset
from maxcon.localizer import MaximumConsensus
from maxcon.search.objectives import OBJECTIVES, Count, MaxEigenvalue, Objective
from maxcon.search.space import SearchSpace

STANDARD = "standard"


CELL = 0.06  # voxel edge of the standard map, m
MAP_VARIANTS: dict[str, dict[str, Any]] = {
    STANDARD: {}, "cell-0.03": {"cell": 0.03}, "cell-0.12": {"cell": 0.12}, "cell-0.20": {"cell": 0.20},
    "density-1/4": {"keep_every": 4}, "density-1/16": {"keep_every": 16}, "ground": {"keeps_ground": True},
}  # fmt: skip
"""How maps differ from the standard one (`Dataset.map_options`), by their names in the table of a study."""


def make_maps(
    dataset: Dataset, folder: Path, names: Iterable[str], progress: Progress | None = None
) -> dict[str, Path]:
    """Build the maps, of `MAP_VARIANTS`, that are not in `folder` yet; a built map has no variants."""
    from maxcon.mapping.build import build_map

    paths = {}
    for name in dict.fromkeys(names):
        if dataset.map_path is not None and name != STANDARD:
            raise OptionError(
                f"Expected clouds in {dataset.path} to build the map {name!r} from, got a built map."
                f" Leave out the methods that need it, or name clouds under [map]."
            )
        path = paths[name] = dataset.map_path or folder / f"{name.replace('/', '-')}.map"
        if not path.exists():
            make_folder(folder)
            options = dataset.map_options(**{"cell": CELL} | MAP_VARIANTS[name])
            build_map(dataset.map_clouds, path, options, progress=progress and partial(_report_of_map, progress, name))
    return paths


def _report_of_map(report: Progress, name: str, step: str, done: int, total: int) -> None:
    report(f"map {name}: {step}", done, total)


@dataclass(frozen=True)
class StudyMethod:
    """A method of a study."""

    name: str  # in the table and in figures
    # Anything with ``localize(scan, point_map, prior)``; it is sent to other processes, so its class must be importable
    method: Method
    map_name: str = STANDARD  # name of the map that it gets, of `MAP_VARIANTS`
    # Whether it starts from the reference pose instead of the prior: for starts spread around the true pose, as the
    # paper's
    around_reference: bool = False

    @property
    def needs_small_gicp(self) -> bool:
        """Whether it works only where that package is installed."""
        inner = self.method.method if isinstance(self.method, MultiStart) else self.method
        return isinstance(inner, Gicp | CountThenGicp)


METHOD_SETS: dict[str, tuple[str, ...]] = {
    "consensus": (
        "maxcon",
        "count-points", "helmert-points", "max-eigenvalue-points",
        "count-occupied", "helmert-occupied", "max-eigenvalue-occupied",
    ),
    "baselines": (
        "icp-point-1m", "icp-point-3m", "icp-plane-1m", "icp-plane-3m", "gicp-1m", "gicp-3m",
        "icp-plane-1m-5x5", "icp-plane-3m-5x5", "count-1m-then-gicp",
    ),
    "ground": (
        "helmert-ground", "icp-plane-1m-ground", "icp-plane-3m-ground", "gicp-3m-ground",
        "count-1m-then-gicp-ground",
    ),
    "weights": (
        "helmert-points", "helmert-points-unweighted", "helmert-occupied-published", "helmert-occupied-unweighted",
        "helmert-occupied",
    ),
    "thinning": (
        "helmert-occupied-whole-scan", "helmert-occupied", "helmert-occupied-thinned-0.40",
        "count-occupied-whole-scan", "count-occupied", "helmert-points-thinned",
    ),
    "cells": ("helmert-cell-0.03", "helmert-occupied", "helmert-cell-0.12", "helmert-cell-0.20"),
    "density": tuple(
        f"{objective}-{multiplicity}{density}"
        for density in ("", "-density-1/4", "-density-1/16")
        for objective in ("count", "helmert")
        for multiplicity in ("points", "occupied")
    ),
}  # fmt: skip
"""Sets of methods that are compared to answer one question, by name."""

DEFAULT_SETS = ("consensus", "baselines")

CELL_ONLY: dict[str, Any] = {"refinement": False, "search": "exhaustive"}
"""The answer is the best cell, which is where objectives, weights and cells can be compared; all are scored, once for
all objectives, and how distinct the best one is can be measured."""

AS_PUBLISHED: dict[str, Any] = {"weighting": "published", "thinning": 0.0, "is_levelled": False, **CELL_ONLY}
"""As in the paper: points without a normal constrain nothing, all points are used, the prior's height is kept."""


def known_methods(space: SearchSpace) -> dict[str, StudyMethod]:
    """Return all methods that have a name; those of maximum consensus search in `space`, in cells of their map."""
    found = [*_consensus_methods(space), *_baseline_methods(space)]
    return {method.name: method for method in found}


def choose_methods(
    names: Sequence[str], space: SearchSpace, objectives: Mapping[str, Objective] | None = None
) -> list[StudyMethod]:
    """Return methods by names and sets; of your own `objectives`, "mine" stands for `mine-occupied`, its best cells."""
    own = objectives or {}
    known = known_methods(space)
    chosen: dict[str, StudyMethod] = {}
    for name in names:
        if name in own:
            method = MaximumConsensus(space, objective=own[name], multiplicity="occupied", **CELL_ONLY)
            mine = StudyMethod(f"{name.rpartition(':')[2]}-occupied", method)
            ours = (known[f"{objective.name}-occupied"] for objective in OBJECTIVES)
            chosen.update({one.name: one for one in (mine, *ours)})
            continue
        if name not in known and name not in METHOD_SETS:
            near = difflib.get_close_matches(name, [*known, *METHOD_SETS], n=3, cutoff=0.4)
            raise OptionError(
                f"Expected a method or a set, got {name!r}. Did you mean {' or '.join(near) or 'consensus'}?"
                f" Sets are {', '.join(METHOD_SETS)}; docs/study.md lists the methods, and runs your own."
            )
        chosen.update({member: known[member] for member in METHOD_SETS.get(name, (name,))})
    if not chosen:
        raise OptionError(f"Expected at least one method, got none. Sets are {', '.join(METHOD_SETS)}.")
    return list(chosen.values())


def refined_words(described: Mapping[str, dict[str, Any]]) -> str:
    """Which of a user's methods, described as in a study, adjust the pose where ours of that study do not."""
    refines = {name: one["method"].get("refinement") for name, one in described.items() if name != "maxcon"}
    refined = [name for name, does in refines.items() if does]
    if not refined or False not in refines.values():
        return ""
    return (
        f"{', '.join(refined)}: adjusted to the map's surfaces after the search, which best cells alone are not."
        " Compare it with maxcon; or its objective with ours: maxcon study --methods package.module:Name"
    )


def installed_methods(methods: Sequence[StudyMethod]) -> tuple[list[StudyMethod], list[str]]:
    """Return the methods whose packages are installed, and the names of the others."""
    try:
        check_small_gicp()
    except MissingExtraError:
        missing = [method.name for method in methods if method.needs_small_gicp]
        return [method for method in methods if method.name not in missing], missing
    return list(methods), []


def _consensus_methods(space: SearchSpace) -> list[StudyMethod]:
    """The method as `localize` runs it; and the best cell alone, by every objective and with one thing changed."""
    as_localize = SearchSpace(space.half_width, heading_half_width_deg=space.heading_half_width_deg)
    methods = [StudyMethod("maxcon", MaximumConsensus(as_localize))]

    def best_cell(name: str, map_name: str = STANDARD, cells: SearchSpace = space, **options: Any) -> StudyMethod:
        return StudyMethod(name, MaximumConsensus(cells, **CELL_ONLY | options), map_name)

    for multiplicity, published in (("points", AS_PUBLISHED), ("occupied", {})):
        options = published | {"multiplicity": multiplicity}
        for objective in OBJECTIVES:
            densities = () if isinstance(objective, MaxEigenvalue) else ("density-1/4", "density-1/16")
            name = f"{objective.name}-{multiplicity}"
            methods.append(best_cell(name, objective=objective, **options))
            methods += [best_cell(f"{name}-{map_}", map_, objective=objective, **options) for map_ in densities]
        methods.append(best_cell(f"helmert-{multiplicity}-unweighted", **options | {"weighting": "one"}))
    return [
        *methods,
        best_cell("helmert-occupied-published", **AS_PUBLISHED),
        best_cell("helmert-occupied-whole-scan", thinning=0.0),
        best_cell("helmert-occupied-thinned-0.40", thinning=0.4),
        best_cell("helmert-points-thinned", multiplicity="points"),
        best_cell("count-occupied-whole-scan", objective=Count(), thinning=0.0),
        *(
            best_cell(f"helmert-{name}", name, _in_cells_of(space, MAP_VARIANTS[name]["cell"]))
            for name in ("cell-0.03", "cell-0.12", "cell-0.20")
        ),
        best_cell("helmert-ground", "ground"),
    ]


def _in_cells_of(space: SearchSpace, cell: float) -> SearchSpace:
    """Return the space in cells of another edge, widened to whole cells."""
    n_cells = -(-space.half_width // cell) if space.half_width % cell > 1e-9 else space.half_width / cell
    return SearchSpace(round(n_cells) * cell, cell, space.heading_half_width_deg, space.heading_step_deg)


def _baseline_methods(space: SearchSpace) -> list[StudyMethod]:
    """ICP and GICP with both gates from the prior, 5 x 5 starts around the reference, and a count before GICP."""
    methods: dict[str, Method] = {}
    targets = MapTargets()
    for gate in (1.0, 3.0):
        end = f"{gate:.0f}m"
        point, plane = (Icp(residual, gate, targets=targets) for residual in ("point", "plane"))
        methods |= {f"icp-point-{end}": point, f"icp-plane-{end}": plane, f"gicp-{end}": Gicp(gate, targets=targets)}
    found = [StudyMethod(name, method) for name, method in methods.items()]
    found += [
        StudyMethod(f"{name}-5x5", MultiStart(method), around_reference=True)
        for name, method in methods.items()
        if isinstance(method, Icp)
    ]
    methods["count-1m-then-gicp"] = count = CountThenGicp(
        space.half_width, space.heading_half_width_deg, gicp=Gicp(3.0, targets=targets)
    )
    on_ground = [name for name in methods if not name.startswith("icp-point")]
    found += [StudyMethod(f"{name}-ground", methods[name], "ground") for name in on_ground]
    return [*found, StudyMethod("count-1m-then-gicp", count)]
