# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Answers against the error of the prior: levels of errors, and trials at each."""

import csv
import math
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError
from maxcon.geometry import Pose
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MapTargets, MultiStart
from maxcon.lab.evaluation import Quantiles, pose_error
from maxcon.lab.simulation import PriorErrors
from maxcon.lab.study.bench import Bench, prepare_map
from maxcon.lab.study.methods import StudyMethod
from maxcon.localizer import MaximumConsensus
from maxcon.scan import Scan
from maxcon.search.space import SearchSpace

MAXCON, COUNT_THEN_GICP, GICP_FROM_MANY = "maxcon", "count 1 m, then GICP", "GICP from 75 starts"
"""Names among `methods_at`: of what searches the whole level; the last takes longest."""


def prior_level(offset: float, heading_deg: float) -> PriorErrors:
    """Return the level of priors wrong by up to `offset` (m) in x and in y and `heading_deg` (degrees), and no more."""
    return PriorErrors(offset, heading_deg, z=0.0, tilt_deg=0.0)


def prior_at(reference: Pose, level: PriorErrors, seed: int, epoch: int) -> Pose:
    """Draw the prior of an epoch about its reference: the same at every call, whatever else was drawn before."""
    millis = (round(1e3 * level.offset), round(1e3 * level.heading_deg))
    return level.prior(reference, np.random.default_rng((seed, epoch, *millis)))


def space_of(level: PriorErrors) -> SearchSpace:
    """Return the search space of a level."""
    return SearchSpace(half_width=level.offset, heading_half_width_deg=level.heading_deg)


def methods_at(level: PriorErrors, gates: Sequence[float] = (1.0, 3.0, 6.0)) -> list[StudyMethod]:
    """Return the methods that are compared at a level, each told how wrong the prior may be.

    Maximum consensus has all its defaults and the standard map. The peers get the ground too: it holds height and tilt,
    which GICP solves for, and ICP is right more often with it (docs/prior_error.md). `gates` (m) are of registration
    from one start; ICP has all but those above 3.
    """
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


@dataclass(frozen=True, slots=True)
class PriorTrial:
    """The result of one method from one prior.

    offset, heading_deg: the level: the prior is wrong by up to so much in x and in y, m, and in heading, degrees.
    status, is_good: the method's own word, and whether it reports its pose as good.
    is_right: whether the pose is within 0.3 m and 1 degree of the reference.
    distance, heading_error_deg: of the pose from the reference, in x and y, m, and signed, degrees.
    ms: processor time from points in memory to the pose.
    """

    offset: float
    heading_deg: float
    epoch: int
    method: str
    status: str
    is_good: bool
    is_right: bool
    distance: float
    heading_error_deg: float
    ms: float

    @property
    def key(self) -> tuple[float, float, int, str]:
        """Level, epoch and method: what tells one trial from another."""
        return self.offset, self.heading_deg, self.epoch, self.method


def try_epoch(
    bench: Bench, epoch: int, level: PriorErrors, methods: Sequence[StudyMethod], seed: int
) -> list[PriorTrial]:
    """Let methods localize one epoch from the same prior, drawn around the reference.

    Each is timed on its own copy of the scan, with all it computes from the scan; its part of the map is loaded before.
    """
    points = bench.scans.read(epoch, bench.options.min_range, bench.options.max_range).points
    true_pose = bench.reference.at(float(bench.scans.times[epoch]))
    trials = []
    for method in methods:
        point_map = bench.maps[method.map_name]
        reference = point_map.frame.pose_to_local(true_pose)
        prior = prior_at(reference, level, seed, epoch)
        prepare_map(method.method, Scan(points), point_map, prior)
        scan, started = Scan(points), time.process_time()
        estimate = method.method.localize(scan, point_map, prior)
        ms = 1e3 * (time.process_time() - started)
        error = pose_error(estimate.pose, reference)
        trials.append(
            PriorTrial(
                level.offset, level.heading_deg, epoch, method.name, estimate.status.value,
                estimate.is_localized, error.is_success, error.distance, math.degrees(error.heading), ms,
            )
        )  # fmt: skip
    return trials


def write_trials(path: str | os.PathLike[str], trials: Iterable[PriorTrial]) -> None:
    """Write trials as CSV, a row each; the file appears, or is replaced, only whole."""
    with atomic_file(path) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [field.name for field in fields(PriorTrial)])
        writer.writeheader()
        writer.writerows(asdict(trial) for trial in trials)


def read_trials(path: str | os.PathLike[str]) -> list[PriorTrial]:
    """Return the trials of a file; none if there is no file; FileError if it holds something else."""
    import msgspec

    if not Path(path).exists():
        return []
    try:
        with Path(path).open(newline="", encoding="utf-8") as stream:
            return msgspec.convert(list(csv.DictReader(stream)), list[PriorTrial], strict=False)
    except (msgspec.ValidationError, UnicodeDecodeError) as error:
        raise FileError(
            f"Expected the trials of an earlier run in {path}, got something else ({error}). Move the file away."
        ) from error


@dataclass(frozen=True, slots=True)
class TrialSummary:
    """The results of one method from all priors of one level (see `PriorTrial`).

    median_error: distance of the right ones, m; NaN where none is right.
    median_ms, p95_ms: processor time.
    """

    offset: float
    heading_deg: float
    method: str
    n_epochs: int
    n_right: int
    n_good: int
    n_wrong_but_good: int
    median_error: float
    median_ms: float
    p95_ms: float


def summarize_trials(trials: Iterable[PriorTrial]) -> list[TrialSummary]:
    """Return one summary per level and method: levels rising, methods in the order they first come."""
    groups: dict[tuple[float, float, str], list[PriorTrial]] = {}
    for trial in trials:
        groups.setdefault((trial.offset, trial.heading_deg, trial.method), []).append(trial)
    found = []
    for level_and_method, group in sorted(groups.items(), key=lambda item: item[0][:2]):
        right = Quantiles.of(trial.distance for trial in group if trial.is_right)
        times = Quantiles.of(trial.ms for trial in group)
        n_right, n_good = (sum(getattr(trial, name) for trial in group) for name in ("is_right", "is_good"))
        n_wrong_but_good = sum(trial.is_good and not trial.is_right for trial in group)
        counts = (len(group), n_right, n_good, n_wrong_but_good)
        found.append(TrialSummary(*level_and_method, *counts, right.median, times.median, times.p95))
    return found
