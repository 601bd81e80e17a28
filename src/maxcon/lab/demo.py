# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The demo by the same road as real data (dataset, map, poses), and the same drive from wide priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from maxcon._system import Progress
from maxcon.drive.localize import EpochEstimate, localize_drive
from maxcon.drive.poses_table import write_poses
from maxcon.errors import MissingExtraError
from maxcon.geometry import Pose
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import Accuracy, PoseError, pose_error, summarize
from maxcon.lab.report import check_jinja2
from maxcon.lab.simulation import PriorErrors, simulate
from maxcon.lab.simulation.scanners import check_embreex
from maxcon.lab.study.bench import Bench
from maxcon.lab.study.methods import StudyMethod
from maxcon.lab.study.prior_trials import (
    GICP_FROM_MANY,
    MAXCON,
    PriorTrial,
    TrialSummary,
    methods_at,
    prior_level,
    summarize_trials,
    try_epoch,
    write_trials,
)
from maxcon.lab.study.run import spread_epochs
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.mapping.build import build_map
from maxcon.plotting.figure import check_matplotlib
from maxcon.scan.trajectory import Trajectory
from maxcon.search.objectives import Count, Helmert
from maxcon.search.space import SearchSpace

DEMO_NAMES = (
    "report.html", "dataset", "city.map", "city-with-ground.map", "prior-error.csv", "pictures", "poses-*.csv"
)  # fmt: skip
"""All that the folder of a demo holds."""


@dataclass(frozen=True, slots=True)
class DemoMethod:
    """A method of the demo and the name it goes by."""

    name: str
    slug: str
    method: MaximumConsensus


PAPER = SearchSpace.paper()
MAPPING_WAIT = 10.0
"""The mapping vehicle stands before a red light for so long, s: the map is denser there, as real ones are."""

ALONE = partial(MaximumConsensus, PAPER, wider=0.0)  # what the objective finds by itself

DEMO_METHODS = (
    DemoMethod("Count, every map point", "count-points", ALONE(Count(), multiplicity="points")),
    DemoMethod("Helmert, every map point", "helmert-points", ALONE(Helmert(), multiplicity="points")),
    DemoMethod("Count, a voxel once", "count-occupied", ALONE(Count())),
    DemoMethod("Helmert, a voxel once", "helmert-occupied", ALONE(Helmert())),
)


@dataclass(frozen=True, slots=True)
class DemoDrive:
    """The simulated drive, opened: the map, the scans, the priors and the reference."""

    point_map: PointMap
    dataset: Dataset
    prior: Trajectory
    reference: Trajectory

    def reference_at(self, time: float) -> Pose:
        """Return the reference pose at a time, local frame of the map."""
        return self.point_map.frame.pose_to_local(self.reference.at(time))


@dataclass(frozen=True, slots=True)
class MethodResult:
    """What one method answered over the drive."""

    method: DemoMethod
    epochs: tuple[EpochEstimate, ...]
    errors: tuple[PoseError | None, ...]

    @property
    def distances(self) -> list[float]:
        """Distance of each answer to the reference, m; NaN where there is none."""
        return [math.nan if error is None else error.distance for error in self.errors]

    @property
    def accuracy(self) -> Accuracy:
        """Success, median and worst error."""
        return summarize(self.errors)

    @property
    def n_localized(self) -> int:
        """Epochs the method itself calls localized."""
        return sum(epoch.pose_global is not None for epoch in self.epochs)

    @property
    def median_milliseconds(self) -> float:
        """From points in memory to the pose, the first epoch (compilation, first read of the map) left out."""
        taken = [epoch.milliseconds for epoch in self.epochs]
        return float(np.median(taken[1:] or taken))


def check_extras() -> None:
    """Say what is missing for a demo before a minute is spent on it."""
    check_embreex()
    check_matplotlib()
    check_jinja2()


def prepare_demo(folder: Path, *, n_epochs: int, seed: int, progress: Progress, before: float = 75.0) -> DemoDrive:
    """Simulate the dataset, from `before` (m) the crossing on, and build its map inside `folder`."""
    dataset = simulate(
        folder / "dataset",
        n_epochs=n_epochs,
        seed=seed,
        before=before,
        mapping_wait=MAPPING_WAIT,
        progress=lambda done, total: progress("simulating the city and its drives", done, total),
    )
    build_map(dataset.map_clouds, folder / "city.map", dataset.map_options(), progress=progress)
    return DemoDrive(
        PointMap.open(folder / "city.map"), dataset, read_trajectory(dataset.prior), read_trajectory(dataset.reference)
    )


def localize_demo(
    drive: DemoDrive, folder: Path, methods: Sequence[DemoMethod], *, progress: Progress
) -> list[MethodResult]:
    """Localize the drive with each method and write its poses to `folder`."""
    scans = open_scans(drive.dataset.scans)
    results = []
    for number, method in enumerate(methods):
        epochs: list[EpochEstimate] = []
        errors: list[PoseError | None] = []
        for epoch in localize_drive(drive.point_map, scans, drive.prior, method.method):
            epochs.append(epoch.without_points())
            # Of the answer, whether the method trusts it or not.
            found, reference = epoch.estimate, drive.reference_at(epoch.raw.time)
            errors.append(None if found is None else pose_error(found.pose, reference))
            progress("localizing", number * len(scans) + len(epochs), len(methods) * len(scans))
        write_poses(folder / f"poses-{method.slug}.csv", epochs)
        results.append(MethodResult(method, tuple(epochs), tuple(errors)))
    return results


WIDE_LEVELS = (prior_level(3.0, 2.0), prior_level(6.0, 5.0), prior_level(12.0, 10.0))
GROUND_MAP, TABLE = "city-with-ground.map", "prior-error.csv"
MOST_EPOCHS = 8
"""Registration from many starts takes its time: of a longer drive some epochs are shown."""


@dataclass(frozen=True, slots=True)
class WideResult:
    """Results from wide priors, by level and method; those of GICP only where small_gicp is installed."""

    summaries: list[TrialSummary]

    @property
    def widest(self) -> list[TrialSummary]:
        """Those of the widest level, maximum consensus first."""
        offset = max(one.offset for one in self.summaries)
        return [one for one in self.summaries if one.offset == offset]

    @property
    def words(self) -> str:
        """What came out at the widest level, in plain sentences that are fair to the peers."""
        found = {one.method: one for one in self.widest}
        ours = found.pop(MAXCON)
        one_start = [one for name, one in found.items() if "gate" in name]
        rights = sorted(one.n_right for one in one_start)
        n_false = sum(one.n_wrong_but_good for one in one_start)
        told = (
            f"From priors wrong by up to {ours.offset:g} m and {ours.heading_deg:g} degrees maximum consensus is right"
            f" in {ours.n_right} of {ours.n_epochs} epochs; registration from one start in {rights[0]} to"
            f" {rights[-1]}, by method and gate, and {n_false} of its"
            f" {sum(one.n_epochs - one.n_right for one in one_start)} wrong answers call themselves good."
        )
        others = [one for one in found.values() if one not in one_start]
        if others:
            fair = "; ".join(
                f"{one.method}, is right in {one.n_right}, in {one.median_ms:.0f} ms an epoch against our"
                f" {ours.median_ms:.0f}"
                for one in others
            )
            return f"{told} What searches the window first can do it too: {fair}."
        return (
            f"{told} What searches the window first can do it too: a coarse count followed by GICP. It needs"
            " small_gicp; to see it here: pip install 'maxcon[baselines]'"
        )


def _methods(level: PriorErrors) -> list[StudyMethod]:
    """Methods of a level that can run here, without the many starts, which take too long."""
    try:
        check_small_gicp()
        left_out = GICP_FROM_MANY
    except MissingExtraError:
        left_out = "GICP"
    return [method for method in methods_at(level, gates=(1.0, 3.0)) if left_out not in method.name]


def try_wide_priors(drive: DemoDrive, folder: Path, *, seed: int, progress: Progress) -> WideResult:
    """Localize some epochs of the drive from ever wider priors; write trials and the map with ground to `folder`."""
    options = drive.dataset.map_options(keeps_ground=True)
    build_map(drive.dataset.map_clouds, folder / GROUND_MAP, options, progress=progress)
    maps = {"standard": folder / "city.map", "ground": folder / GROUND_MAP}
    bench = Bench.open(drive.dataset, maps)
    epochs = spread_epochs(len(bench.scans), min(len(bench.scans), MOST_EPOCHS))
    by_level = [(level, _methods(level)) for level in WIDE_LEVELS]
    trials: list[PriorTrial] = []
    for done, epoch in enumerate(epochs, 1):
        for level, methods in by_level:
            trials += try_epoch(bench, epoch, level, methods, seed)
        progress("localizing from wide priors", done, len(epochs))
    write_trials(folder / TABLE, trials)
    return WideResult(summarize_trials(trials))
