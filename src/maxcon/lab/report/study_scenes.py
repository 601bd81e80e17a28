"""Single epochs of a dataset, searched again for a page: all headings, count beside Helmert."""

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
from maxcon.lab.report import Picture, page_words
from maxcon.lab.report.claims import HELMERT
from maxcon.lab.report.paper_figures import ComparisonRow, plot_comparison
from maxcon.lab.study import MethodRows, Study, known_methods
from maxcon.lab.study.bench import REFERENCE, Bench
from maxcon.lab.study.methods import STANDARD
from maxcon.lab.study.run import check_parts, dataset_parts
from maxcon.lab.study.table import in_common
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
    count, helmert = in_common({"count": count, "helmert": helmert}).values()
    epochs = count.numbers("epoch")
    succeeds = [rows.numbers("is_success") == 1.0 for rows in (count, helmert)]
    is_good, is_lost = succeeds[0] & succeeds[1], ~succeeds[0] & succeeds[1]
    if not is_good.any():
        return {}
    is_near = is_good & (np.nan_to_num(count.numbers("prior_distance")) <= NEAR)
    is_shown = is_near if is_near.any() else is_good
    distinct = np.nan_to_num(count.numbers("kurtosis"))
    errors = np.where(is_lost, np.nan_to_num(count.numbers("distance")), 0.0)
    picked = {
        "crossing": int(epochs[np.argmax(np.where(is_shown, distinct, -1.0))]),
        "street": int(epochs[np.argmin(np.where(is_shown, distinct, np.inf))]),
    }
    return picked | ({"count fails": int(epochs[np.argmax(errors)])} if errors.any() else {})


@dataclass(frozen=True, eq=False)
class Scenes:
    """Epochs of a dataset, searched again for pictures, around the prior of that name, by `method` or another."""

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

    def compare(
        self, path: Path, epochs: Mapping[str, int], methods: Sequence[tuple[str, MaximumConsensus]], title: str
    ) -> None:
        """Draw epochs, by what is special about each, as methods with names see them (the paper's figure 4)."""
        rows = []
        for where, epoch in epochs.items():
            scan, views = Scan(np.empty((0, 3))), []
            for name, method in methods:
                scan, accumulator, _ = self.search(epoch, method)
                views.append(SearchSpaceView(accumulator, method.cell_search.objective, name))
            rows.append(ComparisonRow(f"epoch {epoch}, {where}", scan, self.point_map, self.poses(epoch)[1], views))
        plot_comparison(path, rows, title=title)


def space_of(configuration_methods: Mapping[str, dict[str, object]], name: str) -> SearchSpace | None:
    """Search space of a method in the configuration of a study; None if it has none."""
    method = configuration_methods.get(name, {}).get("method")
    space = method.get("space") if isinstance(method, dict) else None
    if not isinstance(space, dict):
        return None
    return SearchSpace(**{key: float(value) for key, value in space.items() if key != "class" and value is not None})


def open_scenes(
    study: Study, dataset: str | os.PathLike[str] | None, prior: str, notes: list[str], own: Objective | None = None
) -> Scenes | None:
    """Open the dataset of a study, where it is now or, if None, was; None, and a note, if it is not the one studied."""
    # `own` is a user's objective, drawn beside ours.
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
    return Scenes(bench, prior, bench.maps[STANDARD], method if own is None else replace(method, objective=own))


def draw_scenes(folder: Path, scenes: Scenes, methods: Mapping[str, MethodRows], notes: list[str]) -> list[Picture]:
    """Draw headings and comparison into a folder; what cannot be shown, and why, is added to the notes."""
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
    own, because = scenes.objective, page_words()["comparison"]
    objectives = [*(() if isinstance(own, Helmert) else (own,)), Count(), Helmert()]
    compared = [(title_of(each), replace(scenes.method, objective=each)) for each in objectives]
    scores = " beside ".join(name for name, _ in compared)
    rows = "; ".join(f"epoch {epoch}, {because[label]}" for label, epoch in epochs.items())
    headings, comparison, crossing = folder / "headings.svg", folder / "comparison.svg", epochs["crossing"]
    try:
        scenes.draw_epoch(headings, crossing, f"Epoch {crossing}: every heading")
        scenes.compare(comparison, epochs, compared, scores)
    except MaxconError as error:
        notes.append(f"Scenes are missing: {error}")
        return []
    return [
        Picture.of("headings", headings, score=title_of(own)),
        Picture.of("comparison", comparison, rows=rows, scores=scores),
    ]
