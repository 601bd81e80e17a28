"""Answers against the error of the prior: levels of errors, priors drawn at each, and the methods that are compared."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from maxcon.geometry import Pose
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MapTargets, MultiStart
from maxcon.lab.simulation import PriorErrors
from maxcon.lab.study.bench import Bench
from maxcon.lab.study.methods import StudyMethod
from maxcon.lab.study.table import MethodStatistics, rows_by_method, statistics
from maxcon.localizer import MaximumConsensus
from maxcon.scan.trajectory import Trajectory
from maxcon.search.space import SearchSpace

if TYPE_CHECKING:
    import pyarrow

MAXCON, COUNT_THEN_GICP, GICP_FROM_MANY = "maxcon", "count 1 m, then GICP", "GICP from 75 starts"
"""Names among `methods_at`: of what searches the whole level; the last takes longest."""


def prior_level(offset: float, heading_deg: float) -> PriorErrors:
    """Return the level of priors wrong by up to `offset` (m) in x and in y and `heading_deg` (degrees), and no more."""
    return PriorErrors(offset, heading_deg, z=0.0, tilt_deg=0.0)


def level_name(level: PriorErrors) -> str:
    """Return the name of the priors of a level in a table."""
    return f"{level.offset:g} m, {level.heading_deg:g}°"


def prior_at(reference: Pose, level: PriorErrors, seed: int, epoch: int) -> Pose:
    """Draw the prior of an epoch about its reference: the same at every call, whatever else was drawn before."""
    millis = (round(1e3 * level.offset), round(1e3 * level.heading_deg))
    return level.prior(reference, np.random.default_rng((seed, epoch, *millis)))


def with_levels(bench: Bench, levels: Iterable[PriorErrors], epochs: Sequence[int], seed: int) -> Bench:
    """Return a bench that has priors of each level, too, drawn around the reference of some epochs, by `level_name`."""
    times = bench.scans.times[list(epochs)]
    truth = [bench.reference.at(float(time)) for time in times]
    drawn = {
        level_name(level): [prior_at(pose, level, seed, epoch) for pose, epoch in zip(truth, epochs, strict=True)]
        for level in levels
    }
    priors = {name: Trajectory.from_poses(times, poses) for name, poses in drawn.items()}
    return replace(bench, priors=bench.priors | priors)


def space_of(level: PriorErrors) -> SearchSpace:
    """Return the search space of a level."""
    return SearchSpace(half_width=level.offset, heading_half_width_deg=level.heading_deg)


def methods_at(level: PriorErrors, gates: Sequence[float] = (1.0, 3.0, 6.0)) -> list[StudyMethod]:
    """Return the methods compared at a level; peers get a map with ground, which holds height and tilt."""
    targets = MapTargets()
    # Seventy-five starts of a scan thinned as usual take seconds; coarser, they end at the same places.
    quick = Gicp(3.0, thinning=2.0, step_tolerance=0.02, turn_tolerance=5e-3, targets=targets)
    many = MultiStart(
        quick, spacing=2.0 * level.offset / 5, n_headings=3, heading_spacing_deg=2.0 * level.heading_deg / 3,
        choice="overlap",
    )  # fmt: skip
    count = CountThenGicp(level.offset, level.heading_deg, gicp=Gicp(3.0, targets=targets))
    found = [
        StudyMethod(MAXCON, MaximumConsensus(space_of(level))),
        StudyMethod(COUNT_THEN_GICP, count, "ground"),
        StudyMethod(GICP_FROM_MANY, many, "ground"),
    ]
    found += [StudyMethod(f"GICP, gate {gate:g} m", Gicp(gate, targets=targets), "ground") for gate in gates]
    return found + [
        StudyMethod(f"ICP, gate {gate:g} m", Icp(gate=gate, targets=targets), "ground") for gate in gates if gate <= 3.0
    ]


def statistics_by_level(table: "pyarrow.Table", levels: Iterable[PriorErrors]) -> dict[str, list[MethodStatistics]]:
    """Return the statistics of a table's methods by `level_name`, in the order of the levels and of `methods_at`."""
    found = {level_name(level): list[MethodStatistics]() for level in levels}
    order = [method.name for method in methods_at(prior_level(1.0, 1.0))]
    for rows in rows_by_method(table, order):
        if rows.prior in found:
            found[rows.prior].append(statistics(rows))
    return {name: of_level for name, of_level in found.items() if of_level}
