# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The figures of a study that need its dataset, for searching single epochs again: overview, headings, comparison."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from maxcon.drive.localize import scan_of
from maxcon.estimate import Estimate
from maxcon.geometry import Pose
from maxcon.lab.report.html import Picture
from maxcon.lab.report.plots.comparison_plot import ComparisonRow, plot_comparison
from maxcon.lab.report.plots.headings_plot import plot_headings
from maxcon.lab.report.plots.overview_plot import plot_overview
from maxcon.lab.report.study.picked_epochs import PictureEpochs
from maxcon.lab.study import MethodRows, known_methods
from maxcon.lab.study.bench import Bench
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.plotting.score_panel import SearchSpaceView
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Count, Helmert
from maxcon.search.space import SearchSpace

__all__ = ["StudyScenes", "space_of"]

# Epochs whose search spaces may be drawn on the map: at least this far apart, and at most this far away, m.
SPACE_EVERY, SPACES_REACH = 3.0, 45.0
SHOWN_BECAUSE = {
    "crossing": "where the count is the most distinct",
    "street": "where the count is right and the least distinct",
    "count fails": "where the count is farthest off while Helmert's score is right",
}


@dataclass(frozen=True)
class StudyScenes:
    """Epochs of a study, searched again for its pictures.

    bench: the dataset, opened.
    prior: name of the prior.
    point_map: the standard map.
    space: what was searched.
    multiplicity: `occupied` or `points`: whether a match counts once, or as often as its voxel has map points.
    """

    bench: Bench
    prior: str
    point_map: PointMap
    space: SearchSpace
    multiplicity: str

    @property
    def method(self) -> MaximumConsensus:
        """The study's method with Helmert's score, in its search space."""
        return cast(MaximumConsensus, known_methods(self.space)[f"helmert-{self.multiplicity}"].method)

    def scan(self, epoch: int) -> Scan:
        """Read the scan of an epoch."""
        raw = self.bench.scans.read(epoch, self.bench.options.min_range, self.bench.options.max_range)
        return scan_of(raw)

    def poses(self, epoch: int) -> tuple[Pose, Pose]:
        """Prior and reference of an epoch, local frame."""
        at, gap = float(self.bench.scans.times[epoch]), self.bench.options.max_gap
        both = (self.bench.priors[self.prior].at(at, gap), self.bench.reference.at(at, gap))
        prior, reference = (self.point_map.frame.pose_to_local(pose) for pose in both)
        return prior, reference

    def search(self, epoch: int) -> tuple[Scan, Accumulator, Estimate]:
        """Search an epoch around its prior; return its scan, its accumulator and the answer."""
        scan = self.scan(epoch)
        accumulator = self.method.accumulate(scan, self.point_map, self.poses(epoch)[0])
        return scan, accumulator, self.method.conclude(accumulator, scan, self.point_map)

    def overview(self, path: Path, epoch: int, helmert: MethodRows) -> Picture:
        """Draw the map, the scan, the consensus set and the search spaces along the drive (the paper's figure 3)."""
        scan, accumulator, estimate = self.search(epoch)
        others = [self.search(other)[1:] for other in self._neighbours(epoch, helmert)]
        plot_overview(
            path, point_map=self.point_map, scan=scan, prior=accumulator.prior, estimate=estimate,
            accumulator=accumulator, objective=Helmert(), others=others, title=f"Epoch {epoch} and its neighbours",
        )  # fmt: skip
        return Picture(
            "Map, scan, consensus set and search spaces",
            f"Epoch {epoch} from above: the map, the scan at its prior, and the points that match at the answer. The"
            " squares on the ground are the search spaces of this epoch and of others along the drive, in the colours"
            " of Helmert's score.",
            "A street from above with a scan in it and coloured squares along the drive.",
            path,
        )

    def headings(self, path: Path, epoch: int) -> Picture:
        """Draw all headings of an epoch around its best cell (the paper's figure 2)."""
        _, accumulator, _ = self.search(epoch)
        reference = self.poses(epoch)[1]
        plot_headings(path, accumulator, Helmert(), reference=reference, title=f"Epoch {epoch}: every heading, ±1 m")
        return Picture(
            "All headings",
            "Helmert's score within 1 m of the best cell, a panel for each heading, in one scale of colours: the peak"
            " vanishes as the heading turns away.",
            "Panels of the search space, one for each heading.",
            path,
        )

    def comparison(self, path: Path, epochs: PictureEpochs) -> Picture:
        """Draw crossing and street, and where the count fails, count beside Helmert (the paper's figure 4)."""
        chosen = {"crossing": epochs.crossing, "street": epochs.street, "count fails": epochs.failure}
        rows, words = [], []
        for label, epoch in chosen.items():
            if epoch is None:
                continue
            scan, accumulator, _ = self.search(epoch)
            views = (SearchSpaceView(accumulator, Count()), SearchSpaceView(accumulator, Helmert()))
            reference = self.poses(epoch)[1]
            rows.append(ComparisonRow(f"{label}, epoch {epoch}", scan, self.point_map, reference, views))
            words.append(f"epoch {epoch}, {SHOWN_BECAUSE[label]}")
        plot_comparison(path, rows, title="Count beside Helmert's score")
        return Picture(
            "A crossing and a street, count beside Helmert's score",
            f"Offsets are from the reference: the best cell should be at (0, 0). From above: {'; '.join(words)}.",
            "Rows of epochs: the scan in the map, the search space of the count, and that of Helmert's score.",
            path,
        )

    def _neighbours(self, epoch: int, rows: MethodRows) -> list[int]:
        """Other epochs with an answer, at steps along the drive, after and before this one."""
        numbers = rows.numbers("epoch").astype(int)
        places = np.column_stack([rows.numbers("reference_x"), rows.numbers("reference_y")])
        has_answer = np.isfinite(rows.numbers("x")) & np.isfinite(places).all(axis=1)
        numbers, places = numbers[has_answer], places[has_answer]
        here = places[numbers == epoch][0]
        chosen: list[int] = []
        for side in (numbers[numbers > epoch], numbers[numbers < epoch][::-1]):
            last = here
            for number in side.tolist():
                place = places[numbers == number][0]
                if math.dist(place, here) > SPACES_REACH:
                    break
                if math.dist(place, last) >= SPACE_EVERY:
                    chosen.append(number)
                    last = place
        return chosen


def space_of(configuration_methods: Mapping[str, dict[str, object]], name: str) -> SearchSpace | None:
    """Search space of a method in the configuration of a study; None if it has none."""
    method = configuration_methods.get(name, {}).get("method")
    space = method.get("space") if isinstance(method, dict) else None
    if not isinstance(space, dict):
        return None
    return SearchSpace(**{key: float(value) for key, value in space.items() if key != "class" and value is not None})
