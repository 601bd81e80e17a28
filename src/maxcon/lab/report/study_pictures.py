# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Single epochs of a study, searched again for its page: overview, headings, count beside Helmert."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np

from maxcon.drive.localize import DriveOptions, scan_of
from maxcon.errors import FileError, MaxconError
from maxcon.estimate import Estimate
from maxcon.geometry import Pose
from maxcon.lab.dataset import Dataset
from maxcon.lab.paper.claims import HELMERT
from maxcon.lab.paper.distinctness_plots import spaced_epochs
from maxcon.lab.paper.search_spaces import WINDOW_REACHES, ComparisonRow, plot_comparison, plot_overview
from maxcon.lab.report import Picture
from maxcon.lab.report.study_statistics import common_epochs
from maxcon.lab.study import MethodRows, Study, known_methods
from maxcon.lab.study.bench import REFERENCE, Bench
from maxcon.lab.study.methods import STANDARD
from maxcon.lab.study.run import check_parts, dataset_parts
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.plotting import plot_epoch
from maxcon.plotting.score_panel import SearchSpaceView, title_of
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Count, Helmert, Objective
from maxcon.search.space import SearchSpace

# Errors of priors that are near, m: see `pick_epochs`.
NEAR = 1.5


def pick_epochs(count: MethodRows, helmert: MethodRows) -> dict[str, int]:
    """Pick the epochs to show, by the table of the study; none if both count and Helmert's score succeed in none.

    crossing: where the count is the most distinct: surfaces face in several directions.
    street: where the count is right and the least distinct: nearly all surfaces face across.
    count fails: where the count is farthest off while Helmert's score is right, if there is such an epoch.

    Crossing and street are taken from epochs whose prior is within 1.5 m of the reference, if there are any: their
    peak is not at the border of the search space.
    """
    epochs = common_epochs({"count": count, "helmert": helmert}, ("count", "helmert"))
    here = [np.isin(rows.numbers("epoch"), epochs) for rows in (count, helmert)]
    succeeds = [rows.numbers("is_success")[at] == 1.0 for rows, at in zip((count, helmert), here, strict=True)]
    is_good, is_lost = succeeds[0] & succeeds[1], ~succeeds[0] & succeeds[1]
    if not is_good.any():
        return {}
    is_near = is_good & (np.nan_to_num(count.numbers("prior_distance")[here[0]]) <= NEAR)
    is_shown = is_near if is_near.any() else is_good
    distinct = np.nan_to_num(count.numbers("kurtosis")[here[0]])
    errors = np.where(is_lost, np.nan_to_num(count.numbers("distance")[here[0]]), 0.0)
    picked = {
        "crossing": int(epochs[np.argmax(np.where(is_shown, distinct, -1.0))]),
        "street": int(epochs[np.argmin(np.where(is_shown, distinct, np.inf))]),
    }
    return picked | ({"count fails": int(epochs[np.argmax(errors)])} if errors.any() else {})


# Least distance between the middles of two search spaces on the map over their reach: more than a diagonal.
SPACES_APART = 3.0
SHOWN_BECAUSE = {
    "crossing": "where the count is the most distinct",
    "street": "where the count is right and the least distinct",
    "count fails": "where the count is farthest off while Helmert's score is right",
}


@dataclass(frozen=True, eq=False)
class Scenes:
    """Epochs of a dataset, searched again for pictures.

    bench, prior, point_map: the dataset, opened; the prior's name; the standard map.
    method: searches, if no other is named.
    """

    bench: Bench
    prior: str
    point_map: PointMap
    method: MaximumConsensus

    @property
    def objective(self) -> Objective:
        """What scores are drawn."""
        return self.method.cell_search.objective

    def poses(self, epoch: int) -> tuple[Pose, Pose]:
        """Prior and reference of an epoch, local frame."""
        at, gap = float(self.bench.scans.times[epoch]), self.bench.options.max_gap
        both = (self.bench.priors[self.prior].at(at, gap), self.bench.reference.at(at, gap))
        prior, reference = (self.point_map.frame.pose_to_local(pose) for pose in both)
        return prior, reference

    def search(self, epoch: int, method: MaximumConsensus | None = None) -> tuple[Scan, Accumulator, Estimate]:
        """Search an epoch around its prior; return its scan, its accumulator and the answer."""
        raw = self.bench.scans.read(epoch, self.bench.options.min_range, self.bench.options.max_range)
        scan, method = scan_of(raw), method or self.method
        accumulator = method.accumulate(scan, self.point_map, self.poses(epoch)[0])
        return scan, accumulator, method.conclude(accumulator, scan, self.point_map)

    def draw_epoch(self, path: Path, epoch: int, title: str) -> None:
        """Draw all headings of an epoch, and its scene (the paper's figure 2)."""
        scan, accumulator, estimate = self.search(epoch)
        plot_epoch(
            path, accumulator=accumulator, objective=self.objective, estimate=estimate, scan=scan,
            point_map=self.point_map, title=title, reference=self.poses(epoch)[1],
        )  # fmt: skip

    def row(self, label: str, epoch: int, views: Sequence[SearchSpaceView], scan: Scan) -> ComparisonRow:
        """Return the row of an epoch for a comparison of its search spaces."""
        return ComparisonRow(label, scan, self.point_map, self.poses(epoch)[1], views)


class StudyScenes(Scenes):
    """Epochs of a study; the method is the study's with Helmert's score, or the user's own, in its search space."""

    def overview(self, path: Path, epoch: int, helmert: MethodRows) -> Picture:
        """Draw the map, the scan, the consensus set and the search spaces along the drive (the paper's figure 3)."""
        scan, accumulator, estimate = self.search(epoch)
        others = [self.search(other)[1:] for other in self._neighbours(epoch, helmert)]
        plot_overview(
            path, point_map=self.point_map, scan=scan, estimate=estimate,
            accumulator=accumulator, objective=self.objective, others=others, title=f"Epoch {epoch} and its neighbours",
        )  # fmt: skip
        return Picture.of("overview", path, epoch=epoch, score=title_of(self.objective))

    def headings(self, path: Path, epoch: int) -> Picture:
        """Draw all headings of an epoch, and its scene."""
        self.draw_epoch(path, epoch, f"Epoch {epoch}: every heading")
        return Picture.of("headings", path, score=title_of(self.objective))

    def comparison(self, path: Path, epochs: Mapping[str, int]) -> Picture:
        """Draw crossing and street, and where the count fails, count beside Helmert (the paper's figure 4)."""
        rows, words, own = [], [], self.objective
        objectives = [*(() if isinstance(own, Helmert) else (own,)), Count(), Helmert()]
        for label, epoch in epochs.items():
            scan, accumulator, _ = self.search(epoch)
            views = [SearchSpaceView(accumulator, each) for each in objectives]
            rows.append(self.row(f"{label}, epoch {epoch}", epoch, views, scan))
            words.append(f"epoch {epoch}, {SHOWN_BECAUSE[label]}")
        scores = " beside ".join(title_of(each) for each in objectives)
        plot_comparison(path, rows, title=scores)
        return Picture.of("comparison", path, rows="; ".join(words), scores=scores)

    def _neighbours(self, epoch: int, rows: MethodRows) -> list[int]:
        """Other epochs with an answer whose search spaces can be drawn beside that of this one, the nearest first."""
        has_both = np.isfinite(rows.numbers("x")) & np.isfinite(rows.numbers("reference_x"))
        numbers = rows.numbers("epoch")[has_both].astype(int)
        places = np.array([self.poses(number)[0].position[:2] for number in numbers.tolist()])
        away, reach = places - self.poses(epoch)[0].position[:2], self.method.space.reach
        is_inside = np.abs(away).max(axis=1) <= (WINDOW_REACHES - 1.5) * reach
        order = np.flatnonzero(is_inside)[np.argsort(np.hypot(*away[is_inside].T), kind="stable")]
        return [int(numbers[order[place]]) for place in spaced_epochs(places[order], SPACES_APART * reach)[1:]]


def space_of(configuration_methods: Mapping[str, dict[str, object]], name: str) -> SearchSpace | None:
    """Search space of a method in the configuration of a study; None if it has none."""
    method = configuration_methods.get(name, {}).get("method")
    space = method.get("space") if isinstance(method, dict) else None
    if not isinstance(space, dict):
        return None
    return SearchSpace(**{key: float(value) for key, value in space.items() if key != "class" and value is not None})


def open_scenes(
    study: Study, dataset: str | os.PathLike[str] | None, prior: str, notes: list[str], own: Objective | None = None
) -> StudyScenes | None:
    """Open the dataset of a study for its scenes; None, and a note, if it is missing or not the one studied.

    study: what was run.
    dataset: where the dataset is now; where it was if None.
    prior: name of the prior of the pictures.
    notes: what cannot be shown, and why, is added.
    own: a user's objective, drawn beside ours.
    """
    configuration, names = study.configuration, (HELMERT, "helmert-occupied")
    name = next((name for name in names[:: 1 if own is None else -1] if name in configuration.methods), None)
    space = space_of(configuration.methods, name or "")
    if name is None or space is None:
        notes.append("No scenes: the study has neither helmert-points nor helmert-occupied.")
        return None
    try:
        opened = Dataset.open(dataset or configuration.dataset)
        check_parts(configuration.parts, dataset_parts(opened))
        if prior not in (*opened.priors, REFERENCE):
            raise FileError(f"Expected the prior {prior} in {opened.path}, got {', '.join(opened.priors)}.")
        path = opened.map_path or study.folder / "maps" / f"{STANDARD}.map"
        bench = Bench.open(opened, {STANDARD: path}, DriveOptions(**configuration.options))
        if len(bench.scans) != configuration.n_scans:
            raise FileError(
                f"Expected the {configuration.n_scans} scans of the study in {opened.scans}, got {len(bench.scans)}."
            )
    except MaxconError as error:
        if dataset is not None:
            raise
        notes.append(f"No scenes: {error} If the dataset was moved: maxcon report --dataset DATASET.")
        return None
    multiplicity = name.partition("-")[2]
    method = cast(MaximumConsensus, known_methods(space)[f"helmert-{multiplicity}"].method)
    return StudyScenes(bench, prior, bench.maps[STANDARD], method if own is None else replace(method, objective=own))


def draw_scenes(
    folder: Path, scenes: StudyScenes, methods: Mapping[str, MethodRows], notes: list[str]
) -> list[Picture]:
    """Draw overview, headings and comparison into a folder; what cannot be shown, and why, is added to the notes."""
    multiplicity = scenes.method.multiplicity
    helmert, count = (methods.get(f"{name}-{multiplicity}") for name in ("helmert", "count"))
    names = (f"count-{multiplicity}", f"helmert-{multiplicity}")
    if count is None or helmert is None:
        lacking = " and ".join(each for each, rows in zip(names, (count, helmert), strict=True) if rows is None)
        notes.append(f"No scenes: {lacking} not studied.")
        return []
    epochs = pick_epochs(count, helmert)
    if not epochs:
        notes.append(f"No scenes: no epoch where both {names[0]} and {names[1]} succeed.")
        return []
    try:
        return [
            scenes.overview(folder / "scene.svg", epochs["street"], helmert),
            scenes.headings(folder / "headings.svg", epochs["crossing"]),
            scenes.comparison(folder / "comparison.svg", epochs),
        ]
    except MaxconError as error:
        notes.append(f"Scenes are missing: {error}")
        return []
