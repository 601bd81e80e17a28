"""Bench: scans, priors and maps of a dataset, opened; the answers of methods to its epochs as rows."""

import math
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.localize import DriveOptions, Method, check_inside, pose_or_none, scan_of, status_without_search
from maxcon.errors import FileError, MaxconError, MissingExtraError, OptionError, TrajectoryError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import Trust, along_and_across
from maxcon.io.scans import Scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MultiStart
from maxcon.lab.dataset import Dataset
from maxcon.lab.distinctness import Distinctness, distinctness
from maxcon.lab.evaluation import pose_error
from maxcon.lab.study.methods import StudyMethod
from maxcon.lab.study.table import Row
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.scan.trajectory import Trajectory
from maxcon.search.accumulator import Accumulator, SearchMethod
from maxcon.search.objectives import Helmert

REFERENCE = "reference"
"""Name of the reference as a prior: the search space lies around the true pose, as in the paper's figures."""

CACHE_BYTES = 2**30  # of the tile caches of all maps of one process together


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything a study of one dataset needs."""

    scans: Scans  # the epochs
    reference: Trajectory  # poses held for true, global
    priors: dict[str, Trajectory]  # by name, global; the reference is one of them
    maps: dict[str, PointMap]  # by name of the variant
    options: DriveOptions  # range limits, and gaps of the trajectories to interpolate across

    @classmethod
    def open(cls, dataset: Dataset, maps: Mapping[str, Path], options: DriveOptions | None = None) -> "Bench":
        """Open the parts of a dataset, and the maps made of it."""
        reference = read_trajectory(dataset.reference)
        priors = {name: read_trajectory(path) for name, path in dataset.priors.items()}
        cache_bytes = CACHE_BYTES // max(1, len(maps))
        opened = {name: PointMap.open(path, cache_bytes=cache_bytes) for name, path in maps.items()}
        return cls(dataset.open_scans(), reference, priors | {REFERENCE: reference}, opened, options or DriveOptions())

    def check_times(self, prior_names: Sequence[str], numbers: Sequence[int]) -> None:
        """Refuse a prior or a reference that has no pose at any of the epochs, or none inside the map."""
        times, point_map = self.scans.times[list(numbers)], next(iter(self.maps.values()))
        for name in dict.fromkeys((REFERENCE, *prior_names)):
            poses = self.priors[name]
            found = (pose_or_none(poses, float(at), self.options.max_gap) for at in times)
            local = [point_map.frame.pose_to_local(pose) for pose in found if pose is not None]
            if not local:
                raise TrajectoryError(
                    f"Expected poses of {name} for the scans, {times[0]:.3f} to {times[-1]:.3f} s, but it has none near"
                    f" any of them ({poses.times[0]:.3f} to {poses.times[-1]:.3f} s). Do both use the same clock?"
                )
            check_inside(point_map, local, f"poses of {name}")

    def evaluate(self, prior_name: str, number: int, methods: Sequence[StudyMethod]) -> list[Row]:
        """Return a row for each method: its answer to one epoch; a shared accumulator is charged to each."""
        row, prior, reference = self._begun(prior_name, number)
        try:
            raw = self.scans.read(number, self.options.min_range, self.options.max_range)
        except FileError as error:
            return self.failed(prior_name, number, methods, str(error), Status.UNREADABLE)
        row["n_points"] = len(raw.points)
        shared = _SharedAccumulators(scan_of(raw))
        return [row | {"method": one.name} | self._columns(shared, one, prior, reference) for one in methods]

    def failed(
        self, prior_name: str, number: int, methods: Sequence[StudyMethod], reason: str, status: Status = Status.FAILED
    ) -> list[Row]:
        """Return a row for each method that says why it never answered an epoch."""
        row = self._begun(prior_name, number)[0] | {"status": status.value, "reason": reason}
        return [row | {"method": method.name} for method in methods]

    def _begun(self, prior_name: str, number: int) -> tuple[dict[str, Any], Pose | None, Pose | None]:
        """Columns of an epoch before any method has seen it; its prior and its reference."""
        at = float(self.scans.times[number])
        prior = pose_or_none(self.priors[prior_name], at, self.options.max_gap)
        reference = pose_or_none(self.reference, at, self.options.max_gap)
        row: dict[str, Any] = {"prior": prior_name, "epoch": number, "time": at, "scan": self.scans.name(number)}
        row |= {"is_localized": False, "is_success": None if reference is None else False}
        if reference is not None:
            row |= {f"reference_{name}": getattr(reference, name) for name in ("x", "y", "z", "heading")}
        if reference is not None and prior is not None:
            error = pose_error(prior, reference)
            row |= {"prior_distance": error.distance, "prior_heading_error": error.heading}
        return row, prior, reference

    def _columns(
        self, shared: "_SharedAccumulators", method: StudyMethod, prior: Pose | None, reference: Pose | None
    ) -> dict[str, Any]:
        """Columns of one method in the row of an epoch; poses in global coordinates."""
        point_map, scan = self.maps[method.map_name], shared.scan
        prior, reference = (pose and point_map.frame.pose_to_local(pose) for pose in (prior, reference))
        start = reference if method.around_reference else prior
        status = status_without_search(point_map, scan, start)
        if start is None and method.around_reference:
            return {"status": Status.NO_PRIOR.value, "reason": "no reference pose to start around"}
        if start is None or status is not None:
            return {"status": (status or Status.NO_PRIOR).value}
        try:
            return _answer_columns(_answer(method, point_map, start, shared), reference, point_map)
        except (MissingExtraError, OptionError):
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
        self.scan = scan
        self._made: dict[Hashable, tuple[Any, float]] = {}

    def of(
        self, method: MaximumConsensus, map_name: str, point_map: PointMap, prior: Pose
    ) -> tuple[Accumulator, float]:
        """Return the accumulator of a method, and how long it takes from the scan's points on, ms."""
        _, normals_ms = self._once("normals", lambda: self.scan.normals)
        _, thinning_ms = self._once(method.thinning, lambda: self.scan.thinned(method.thinning))
        searched = replace(method, trust=Trust(), refinement=True, wider=0.0, risk=0.5)  # what comes after the search
        if method.space.n_heights == 1:  # of several heights each objective takes its own
            searched = replace(searched, objective=Helmert())
        key = (map_name, searched, prior)
        accumulator, search_ms = self._once(key, lambda: method.accumulate(self.scan, point_map, prior))
        return accumulator, normals_ms + thinning_ms + search_ms

    def _once(self, key: Hashable, make: Callable[[], Any]) -> tuple[Any, float]:
        """Return what is made once for the scan, and how long that took, ms."""
        if key not in self._made:
            start = time.perf_counter()
            self._made[key] = make(), 1e3 * (time.perf_counter() - start)
        return self._made[key]


class _Answer(NamedTuple):
    """A method's answer to an epoch; poses in the local frame of its map."""

    estimate: Estimate
    milliseconds: float  # from points in memory to the pose
    distinctness: Distinctness | None = None  # of methods that have scores of cells
    starts: Sequence[Estimate] = ()  # where each start of a method with several around the reference ended


def _answer(study_method: StudyMethod, point_map: PointMap, start: Pose, shared: _SharedAccumulators) -> _Answer:
    """Let a method localize an epoch; where it has scores of given cells, measure how distinct the best one is."""
    method, scan = study_method.method, shared.scan
    if isinstance(method, MaximumConsensus) and method.search is SearchMethod.EXHAUSTIVE:
        accumulator, taken = shared.of(method, study_method.map_name, point_map, start)
        clock = time.perf_counter()
        estimate = method.conclude(accumulator, scan, point_map)
        taken += 1e3 * (time.perf_counter() - clock)
        if estimate.status is Status.NO_MATCH:
            return _Answer(estimate, taken)
        objective = method.cell_search.objective
        scores = accumulator.score(objective)
        if not (np.isfinite(scores).all() and (scores >= 0.0).all()):  # the measures are not defined for these
            return _Answer(estimate, taken)
        return _Answer(estimate, taken, distinctness(accumulator, objective, scores=scores))
    scan = Scan(scan.points, time=scan.time)  # whatever it needs of the scan is charged to it
    prepare_map(method, scan, point_map, start)
    clock = time.perf_counter()
    if isinstance(method, MultiStart) and study_method.around_reference:
        starts = method.estimates(scan, point_map, start)
        return _Answer(method.choose(starts), 1e3 * (time.perf_counter() - clock), starts=starts)
    estimate = method.localize(scan, point_map, start)
    return _Answer(estimate, 1e3 * (time.perf_counter() - clock))


def prepare_map(method: Method, scan: Scan, point_map: PointMap, start: Pose) -> None:
    """Let a method load its part of the map before it is timed: methods share it, and the first would pay for all."""
    if isinstance(method, MultiStart | Icp | Gicp | CountThenGicp):
        method.prepare(scan, point_map, start)
    elif isinstance(method, MaximumConsensus):
        # Tiles are read, and merged to levels, when they are first searched: which ones, only the search can tell.
        method.localize(scan, point_map, start)


def _answer_columns(answer: _Answer, reference: Pose | None, point_map: PointMap) -> dict[str, Any]:
    """Pose, errors and measures of an answer, also of one that the method does not trust."""
    estimate = answer.estimate
    columns: dict[str, Any] = {"status": estimate.status.value, "is_localized": estimate.is_localized}
    columns |= {"ms": answer.milliseconds, "score": estimate.score, "share": estimate.share}
    columns |= {"reason": estimate.reason or None, "was_widened": estimate.was_widened}
    columns["runner_up"] = _finite_or_none(estimate.runner_up)
    if answer.starts:
        columns |= {"n_starts": len(answer.starts), "n_converged": 0}
    if estimate.status is Status.NO_MATCH:
        return columns
    pose = point_map.frame.pose_to_global(estimate.pose)
    columns |= {name: getattr(pose, name) for name in ("x", "y", "z", "roll", "pitch", "heading")}
    if answer.distinctness is not None:
        columns |= {name: _finite_or_none(value) for name, value in asdict(answer.distinctness).items()}
    if reference is None:
        return columns | {"n_converged": None}
    error = pose_error(estimate.pose, reference)
    columns |= {"distance": error.distance, "along": error.along, "across": error.across}
    columns |= {"heading_error": error.heading, "height_error": estimate.pose.z - reference.z}
    columns |= {"is_success": error.is_success}
    if answer.starts:
        ends = [start.pose for start in answer.starts if start.status is not Status.NO_MATCH]
        n_converged = sum(pose_error(end, reference).is_success for end in ends)
        columns |= {"n_converged": n_converged, "is_success": n_converged == len(answer.starts)}
    if np.isfinite(estimate.covariance).all():
        columns |= _certainty_columns(estimate, np.array([error.along, error.across]), reference)
    return columns


def _certainty_columns(estimate: Estimate, offset: NDArray[np.float64], reference: Pose) -> dict[str, Any]:
    """Standard deviations, protection level and normalized squared error (NEES), along and across the reference."""
    covariance = along_and_across(estimate.covariance, reference.heading)
    variances = (*np.diag(covariance), estimate.covariance[2, 2], estimate.covariance[5, 5])
    names = ("sigma_along", "sigma_across", "sigma_z", "sigma_heading")
    columns: dict[str, Any] = dict(zip(names, map(math.sqrt, variances), strict=True))
    columns["nees"] = float(offset @ np.linalg.solve(covariance, offset))
    if math.isfinite(estimate.protection_level[0]):
        columns |= dict(zip(("protection_along", "protection_across"), estimate.protection_level, strict=True))
    return columns


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
