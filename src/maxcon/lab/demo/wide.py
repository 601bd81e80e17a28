# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What wide priors make of each method, on the demo's own street: why to search at all."""

from dataclasses import dataclass
from pathlib import Path

from maxcon._system.progress import Progress
from maxcon.errors import MissingExtraError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.demo.run import DemoDrive
from maxcon.lab.simulation import PriorErrors
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
from maxcon.mapping.build import build_map

WIDE_LEVELS = (prior_level(3.0, 2.0), prior_level(6.0, 5.0), prior_level(12.0, 10.0))
GROUND_MAP, TABLE = "city-with-ground.map", "prior-error.csv"
MOST_EPOCHS = 8
"""Registration from many starts takes its time: of a longer drive some epochs are shown."""


@dataclass(frozen=True, slots=True)
class WideResult:
    """All trials with wide priors, epoch by epoch; those of GICP only where small_gicp is installed."""

    trials: tuple[PriorTrial, ...]

    @property
    def summaries(self) -> list[TrialSummary]:
        """By level and method."""
        return summarize_trials(self.trials)

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
    return WideResult(tuple(trials))
