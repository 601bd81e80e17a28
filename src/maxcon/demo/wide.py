# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What wide priors make of each method, on the demo's own street: why to search at all."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from maxcon.baselines import check_small_gicp
from maxcon.demo.run import DemoDrive
from maxcon.errors import MissingExtraError
from maxcon.mapping import build_map, dataset_map_options
from maxcon.progress import Progress
from maxcon.study.bench import BenchPlan
from maxcon.study.methods import StudyMethod
from maxcon.study.prior_levels import GICP_FROM_MANY, MAXCON, methods_at, prior_level
from maxcon.study.prior_trials import PriorTrial, TrialSummary, summarize_trials, try_epoch, write_trials
from maxcon.study.run import spread_epochs

__all__ = ["WIDE_LEVELS", "WIDE_NAMES", "WideResult", "try_wide_priors"]

WIDE_LEVELS = (prior_level(3.0, 2.0), prior_level(6.0, 5.0), prior_level(12.0, 10.0))
WIDE_NAMES = ("city-with-ground.map", "prior-error.csv")
"""What is added to the folder of a demo."""
MOST_EPOCHS = 10
"""A search 24 m wide takes half a second: of a longer drive some epochs are shown."""


@dataclass(frozen=True, slots=True)
class WideResult:
    """All trials with wide priors.

    Parameters
    ----------
    trials : tuple of PriorTrial
        Epoch by epoch.
    has_gicp : bool
        Whether small_gicp is installed, so that its methods stand beside the others.
    """

    trials: tuple[PriorTrial, ...]
    has_gicp: bool

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
            f"{told} What searches the window first can do it too: a coarse count followed by GICP. It needs small_gicp;"
            " to see it here: pip install 'maxcon[baselines]'"
        )


def _methods(has_gicp: bool, level_number: int) -> list[StudyMethod]:
    """Methods of a level: those that small_gicp is not needed for, or all but the many starts, which take too long."""
    found = methods_at(WIDE_LEVELS[level_number], gates=(1.0, 3.0))
    if has_gicp:
        return [method for method in found if method.name != GICP_FROM_MANY]
    return [method for method in found if "GICP" not in method.name]


def try_wide_priors(
    drive: DemoDrive, folder: Path, *, seed: int, progress: Progress, n_epochs: int | None = None
) -> WideResult:
    """Localize some epochs of the drive from ever wider priors and write the trials to `folder`.

    Parameters
    ----------
    drive : DemoDrive
        The simulated drive; the map with ground, for the peers, is built here.
    folder : Path
        Of the demo.
    seed : int
        Of the priors.
    progress : callable
        Called with (step, done, of how many).
    n_epochs : int, optional
        So many, evenly spread; 10 at most if None.
    """
    try:
        check_small_gicp()
        has_gicp = True
    except MissingExtraError:
        has_gicp = False
    ground = folder / WIDE_NAMES[0]
    options = dataset_map_options(drive.dataset, keeps_ground=True)
    build_map(drive.dataset.map_clouds, ground, options, progress=progress)
    bench = BenchPlan(drive.dataset, {"standard": folder / "city.map", "ground": ground}).open()
    n_scans = len(bench.scans)
    epochs = spread_epochs(n_scans, n_epochs or min(n_scans, MOST_EPOCHS))
    by_level: Sequence[list[StudyMethod]] = [
        _methods(has_gicp, number) for number in range(len(WIDE_LEVELS))
    ]
    trials: list[PriorTrial] = []
    for done, epoch in enumerate(epochs, 1):
        for level, methods in zip(WIDE_LEVELS, by_level, strict=True):
            trials += try_epoch(bench, epoch, level, methods, seed)
        progress("localizing from wide priors", done, len(epochs))
    write_trials(folder / WIDE_NAMES[1], trials)
    return WideResult(tuple(trials), has_gicp)
