# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One method over the epochs of a dataset: scans, priors and maps opened, answers as rows."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.drive.localize import DriveOptions, Method, check_inside, pose_or_none, scan_of, status_without_search
from maxcon.errors import FileError, MaxconError, MissingExtraError, TrajectoryError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import Trust, along_and_across
from maxcon.io.scans import Scans, open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MultiStart
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import Distinctness, distinctness, pose_error
from maxcon.lab.study.methods import StudyMethod
from maxcon.lab.study.table import Row
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.scan.trajectory import Trajectory
from maxcon.search.accumulator import Accumulator, SearchMethod
from maxcon.search.objectives import Helmert, Objective

MEASURES = ("peak_ratio", "kurtosis", "divergence", "spread")


@dataclass(frozen=True, slots=True)
class Answer:
    """A method's answer to an epoch; poses in the local frame of its map.

    estimate: the answer.
    milliseconds: from points in memory to the pose.
    distinctness: measures of methods that have scores of cells.
    starts: where each start of a method with several ended.
    """

    estimate: Estimate
    milliseconds: float
    distinctness: Distinctness | None = None
    starts: tuple[Estimate, ...] = ()


def reference_columns(prior: Pose | None, reference: Pose | None) -> dict[str, Any]:
    """Reference pose of an epoch, and the error of its prior; no columns where they are not known."""
    columns: dict[str, Any] = {}
    if reference is not None:
        columns |= {f"reference_{name}": getattr(reference, name) for name in ("x", "y", "z", "heading")}
    if reference is not None and prior is not None:
        error = pose_error(prior, reference)
        columns |= {"prior_distance": error.distance, "prior_heading_error": error.heading}
    return columns


def answer_columns(answer: Answer, reference: Pose | None, point_map: PointMap) -> dict[str, Any]:
    """Pose, errors and measures of an answer, also of one that the method does not trust."""
    estimate = answer.estimate
    columns: dict[str, Any] = {"status": estimate.status.value, "is_localized": estimate.is_localized}
    columns |= {"ms": answer.milliseconds, "score": estimate.score, "share": estimate.share}
    if estimate.reason:
        columns["reason"] = estimate.reason
    if math.isfinite(estimate.runner_up):
        columns["runner_up"] = estimate.runner_up
    if answer.starts:
        columns["n_starts"] = len(answer.starts)
    columns["was_widened"] = estimate.was_widened
    if estimate.status is Status.NO_MATCH:
        return columns | ({"n_converged": 0} if answer.starts else {})
    pose = point_map.frame.pose_to_global(estimate.pose)
    columns |= {name: getattr(pose, name) for name in ("x", "y", "z", "roll", "pitch", "heading")}
    if answer.distinctness is not None:
        measures = {name: getattr(answer.distinctness, name) for name in MEASURES}
        columns |= {name: value for name, value in measures.items() if math.isfinite(value)}
    if reference is not None:
        columns |= _certainty_columns(estimate, reference)
        error = pose_error(estimate.pose, reference)
        columns |= {"distance": error.distance, "along": error.along, "across": error.across}
        columns |= {"heading_error": error.heading, "is_success": error.is_success}
        if answer.starts:
            n_converged = sum(
                start.status is not Status.NO_MATCH and pose_error(start.pose, reference).is_success
                for start in answer.starts
            )
            columns |= {"n_converged": n_converged, "is_success": n_converged == len(answer.starts)}
    return columns


def _certainty_columns(estimate: Estimate, reference: Pose) -> dict[str, Any]:
    """Standard deviations, protection level and normalized squared error (NEES), along and across the reference."""
    columns: dict[str, Any] = {"height_error": estimate.pose.z - reference.z}
    if not np.isfinite(estimate.covariance).all():
        return columns
    covariance = along_and_across(estimate.covariance, reference.heading)
    error = pose_error(estimate.pose, reference)
    offset = np.array([error.along, error.across])
    columns |= {"sigma_along": math.sqrt(covariance[0, 0]), "sigma_across": math.sqrt(covariance[1, 1])}
    columns |= {"sigma_z": math.sqrt(estimate.covariance[2, 2]), "sigma_heading": math.sqrt(estimate.covariance[5, 5])}
    columns["nees"] = float(offset @ np.linalg.solve(covariance, offset))
    if math.isfinite(estimate.protection_level[0]):
        columns |= dict(zip(("protection_along", "protection_across"), estimate.protection_level, strict=True))
    return columns


REFERENCE = "reference"
"""Name of the reference as a prior: the search space lies around the true pose, as in the paper's figures."""

# Tiles of all maps of one process together are kept up to this size.
CACHE_BYTES = 2**30


@dataclass(frozen=True, slots=True)
class _Epoch:
    """One epoch before any method has seen it: poses in global coordinates."""

    scan: Scan
    prior: Pose | None
    reference: Pose | None


@dataclass(frozen=True, slots=True)
class BenchPlan:
    """The parts of a bench, from which each process opens its own.

    dataset: scans, reference and priors.
    maps: by name of the variant.
    options: range limits, and gaps of the trajectories to interpolate across.
    """

    dataset: Dataset
    maps: dict[str, Path]
    options: DriveOptions = field(default_factory=DriveOptions)

    def open(self) -> "Bench":
        """Open the parts of the dataset and the maps made of it."""
        reference = read_trajectory(self.dataset.reference)
        priors = {name: read_trajectory(path) for name, path in self.dataset.priors.items()}
        cache_bytes = CACHE_BYTES // max(1, len(self.maps))
        return Bench(
            open_scans(self.dataset.scans, self.dataset.times),
            reference,
            priors | {REFERENCE: reference},
            {name: PointMap.open(path, cache_bytes=cache_bytes) for name, path in self.maps.items()},
            self.options,
        )


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything a study of one dataset needs.

    scans: the epochs.
    reference: poses held for true, global.
    priors: by name, global; the reference is one of them.
    maps: by name of the variant.
    options: range limits, and gaps of the trajectories to interpolate across.
    """

    scans: Scans
    reference: Trajectory
    priors: dict[str, Trajectory]
    maps: dict[str, PointMap]
    options: DriveOptions

    def check_times(self, prior_names: Sequence[str], numbers: Sequence[int]) -> None:
        """Refuse a prior or a reference that has no pose at any of the epochs, or none inside the map."""
        for name in dict.fromkeys((REFERENCE, *prior_names)):
            poses, times = self.priors[name], self.scans.times[list(numbers)]
            found = [pose_or_none(poses, float(at), self.options.max_gap) for at in times]
            known = [pose for pose in found if pose is not None]
            if known:
                point_map = next(iter(self.maps.values()))
                local = [point_map.frame.pose_to_local(pose) for pose in known]
                check_inside(point_map, local, f"poses of {name}")
            else:
                raise TrajectoryError(
                    f"Expected poses of {name} for the scans, {times[0]:.3f} to {times[-1]:.3f} s, but it has none near"
                    f" any of them ({poses.times[0]:.3f} to {poses.times[-1]:.3f} s). Do both use the same clock?"
                )

    def evaluate(self, prior_name: str, number: int, methods: Sequence[StudyMethod]) -> list[Row]:
        """Return a row for each method: its answer to one epoch, or why there is none.

        prior_name: which prior.
        number: the epoch.
        methods: those of maximum consensus that need the same accumulator share it; each is charged with its time.
        """
        row, prior, reference = self._begun(prior_name, number)
        try:
            raw = self.scans.read(number, self.options.min_range, self.options.max_range)
        except FileError as error:
            failed = {"status": Status.UNREADABLE.value, "reason": str(error)}
            return [row | failed | {"method": method.name} for method in methods]
        row["n_points"] = len(raw.points)
        epoch = _Epoch(scan_of(raw), prior, reference)
        shared = _SharedAccumulators(epoch.scan)
        return [row | {"method": method.name} | self._columns(epoch, method, shared) for method in methods]

    def failed(self, prior_name: str, number: int, methods: Sequence[StudyMethod], reason: str) -> list[Row]:
        """Return a row for each method that says why it never answered an epoch."""
        row, _, _ = self._begun(prior_name, number)
        row |= {"status": Status.FAILED.value, "reason": reason}
        return [row | {"method": method.name} for method in methods]

    def _begun(self, prior_name: str, number: int) -> tuple[dict[str, Any], Pose | None, Pose | None]:
        """Columns of an epoch before any method has seen it; its prior and its reference."""
        at = float(self.scans.times[number])
        row: dict[str, Any] = {"prior": prior_name, "epoch": number, "time": at, "scan": self.scans.name(number)}
        prior = pose_or_none(self.priors[prior_name], at, self.options.max_gap)
        reference = pose_or_none(self.reference, at, self.options.max_gap)
        row |= {"is_localized": False, "is_success": None if reference is None else False}
        row |= reference_columns(prior, reference)
        return row, prior, reference

    def _columns(self, epoch: _Epoch, method: StudyMethod, shared: "_SharedAccumulators") -> dict[str, Any]:
        """Columns of one method in the row of an epoch."""
        point_map = self.maps[method.map_name]
        start = epoch.reference if method.around_reference else epoch.prior
        start = point_map.frame.pose_to_local(start) if start is not None else None
        status = status_without_search(point_map, epoch.scan, start)
        if start is None and method.around_reference:
            return {"status": Status.NO_PRIOR.value, "reason": "no reference pose to start around"}
        if start is None or status is not None:
            return {"status": (status or Status.NO_PRIOR).value}
        reference = point_map.frame.pose_to_local(epoch.reference) if epoch.reference is not None else None
        try:
            answer = _answer(method, epoch.scan, point_map, start, shared)
            return answer_columns(answer, reference, point_map)
        except MissingExtraError:
            raise  # true of every epoch
        except MaxconError as error:
            return {"status": Status.FAILED.value, "reason": str(error)}
        except Exception as error:
            if type(method.method).__module__.startswith("maxcon."):
                raise  # a defect of ours; a user's own method may fail as it likes
            return {"status": Status.FAILED.value, "reason": f"{type(error).__name__}: {error}"}


class _SharedAccumulators:
    """Accumulators of one scan that several objectives share, with the time each took (D5)."""

    def __init__(self, scan: Scan) -> None:
        self._found: dict[tuple[str, MaximumConsensus, Pose], tuple[Accumulator, float]] = {}
        self._scan = scan
        self._normals_ms: float | None = None
        self._thinning_ms: dict[float, float] = {}

    def of(
        self, method: MaximumConsensus, map_name: str, point_map: PointMap, prior: Pose
    ) -> tuple[Accumulator, float]:
        """Return the accumulator of a method, and how long it takes from the scan's points on, ms."""
        if self._normals_ms is None:
            start = time.perf_counter()
            _ = self._scan.normals
            self._normals_ms = 1e3 * (time.perf_counter() - start)
        if method.thinning not in self._thinning_ms:
            start = time.perf_counter()
            self._scan.thinned(method.thinning)
            self._thinning_ms[method.thinning] = 1e3 * (time.perf_counter() - start)
        searched = replace(method, trust=Trust(), refinement=True, wider=0.0, risk=0.5)
        if method.space.n_heights == 1:  # of several heights each objective takes its own
            searched = replace(searched, objective=Helmert())
        key = (map_name, searched, prior)  # what comes after the search does not matter
        if key not in self._found:
            start = time.perf_counter()
            accumulator = method.accumulate(self._scan, point_map, prior)
            self._found[key] = accumulator, 1e3 * (time.perf_counter() - start)
        accumulator, milliseconds = self._found[key]
        return accumulator, self._normals_ms + self._thinning_ms[method.thinning] + milliseconds


def _answer(method: StudyMethod, scan: Scan, point_map: PointMap, start: Pose, shared: _SharedAccumulators) -> Answer:
    """Let a method localize an epoch; where it has scores of given cells, measure how distinct the best one is."""
    if isinstance(method.method, MaximumConsensus) and method.method.search is SearchMethod.EXHAUSTIVE:
        accumulator, taken = shared.of(method.method, method.map_name, point_map, start)
        clock = time.perf_counter()
        estimate = method.method.conclude(accumulator, scan, point_map)
        taken += 1e3 * (time.perf_counter() - clock)
        if estimate.status is Status.NO_MATCH:
            return Answer(estimate, taken)
        return Answer(estimate, taken, _distinctness_or_none(accumulator, method.method.cell_search.objective))
    scan = Scan(scan.points, time=scan.time)  # whatever it needs of the scan is charged to it
    prepare_map(method.method, scan, point_map, start)
    clock = time.perf_counter()
    if isinstance(method.method, MultiStart):
        starts = method.method.estimates(scan, point_map, start)
        estimate = method.method.choose(starts)
    else:
        starts, estimate = [], method.method.localize(scan, point_map, start)
    return Answer(estimate, 1e3 * (time.perf_counter() - clock), starts=tuple(starts))


def prepare_map(method: Method, scan: Scan, point_map: PointMap, start: Pose) -> None:
    """Let a method load its part of the map before it is timed: methods share it, and the first would pay for all."""
    if isinstance(method, MultiStart | Icp | Gicp | CountThenGicp):
        method.prepare(scan, point_map, start)
    elif isinstance(method, MaximumConsensus):
        # Tiles are read, and merged to levels, when they are first searched: which ones, only the search can tell.
        method.localize(scan, point_map, start)


def _distinctness_or_none(accumulator: Accumulator, objective: Objective) -> Distinctness | None:
    """Measures of distinctness; none for scores that they are not defined for, below 0 or infinite."""
    scores = accumulator.score(objective)
    if not (np.isfinite(scores).all() and (scores >= 0.0).all()):
        return None
    return distinctness(accumulator, objective, scores=scores)


@dataclass(frozen=True, slots=True)
class StudyTask:
    """Some epochs of one prior, and the names of the methods that are to answer them."""

    prior: str
    epochs: tuple[int, ...]
    methods: tuple[str, ...]

    @property
    def n_rows(self) -> int:
        """How many rows it makes."""
        return len(self.epochs) * len(self.methods)


@dataclass(frozen=True)
class StudyJob:
    """What the workers of a study do: rows of its table.

    plan: the dataset and maps that each worker opens.
    methods: they stay in each process, and with them what they keep of the map for later epochs.
    """

    plan: BenchPlan
    methods: tuple[StudyMethod, ...]
    name: str = "epochs"

    def open(self) -> Callable[[StudyTask], list[Row]]:
        """Open dataset and maps, and load what is compiled."""
        bench, known = self.plan.open(), {method.name: method for method in self.methods}
        _warm_up()

        def answer(task: StudyTask) -> list[Row]:
            methods = [known[name] for name in task.methods]
            return [row for epoch in task.epochs for row in bench.evaluate(task.prior, epoch, methods)]

        return answer

    def split(self, task: StudyTask) -> Sequence[StudyTask]:
        """Return a task for each row."""
        return [StudyTask(task.prior, (epoch,), (method,)) for epoch in task.epochs for method in task.methods]

    def lost(self, task: StudyTask, reason: str) -> list[Row]:
        """Return the row of an epoch whose worker ended before it was done, with the reason."""
        bench = self.plan.open()
        methods = [method for method in self.methods if method.name in task.methods]
        return [row for epoch in task.epochs for row in bench.failed(task.prior, epoch, methods, reason)]


def _warm_up() -> None:
    """Load what is compiled at first use, so that it is not charged to the first epoch."""
    from maxcon.localizer import MaximumConsensus
    from maxcon.warmup import SPACE, search_room

    search_room(
        MaximumConsensus(SPACE, multiplicity=multiplicity, search="exhaustive")  # what a study looks at: all cells
        for multiplicity in ("points", "occupied")
    )
