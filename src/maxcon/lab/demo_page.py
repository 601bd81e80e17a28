# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The page of the demo: what was done, in figures, pictures and a few words."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maxcon._system import Progress
from maxcon._system.atomic import make_folder
from maxcon._system.version import __version__
from maxcon.drive.localize import EpochEstimate, scan_of
from maxcon.geometry import Pose
from maxcon.io.scans import open_scans
from maxcon.lab.demo import MAPPING_WAIT, DemoDrive, MethodResult, WideResult
from maxcon.lab.paper.search_spaces import ComparisonRow, plot_comparison
from maxcon.lab.report import Picture, write_page
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.report.study_statistics import plot_error_distributions
from maxcon.lab.simulation.datasets import CITY_ORIGIN
from maxcon.plotting import plot_drive, plot_epoch
from maxcon.plotting.score_panel import SearchSpaceView
from maxcon.scan import Scan

# Of the whole drive: well before the crossing, in the straight part of the street.
STREET_PART = 0.25


def report_demo(
    folder: Path, drive: DemoDrive, results: Sequence[MethodResult], wide: WideResult, *, seed: int, progress: Progress
) -> Path:
    """Draw the pictures and write `report.html` into `folder`; return its path."""
    pictures = DemoPictures(folder / "pictures", drive, results)
    make_folder(pictures.folder)
    epochs = results[-1].epochs
    street = epochs[int(STREET_PART * (len(epochs) - 1))]
    steps: dict[str, Callable[[], Picture]] = {
        "why": pictures.why,
        "wide": lambda: pictures.wide_priors(wide),
        "errors": pictures.errors,
        "drive": pictures.drive_from_above,
        "epoch": lambda: pictures.epoch(street),
        "spaces": lambda: pictures.street_and_crossing(street, _at_crossing(drive, epochs)),
    }
    drawn = {}
    for number, (name, step) in enumerate(steps.items(), 1):
        drawn[name] = step()
        progress("drawing", number, len(steps))
    path = folder / "report.html"
    page = {
        "title": "maxcon demo: a simulated street",
        "headline": _headline(results[-1]),
        "results": results,
        **drawn,
        "facts": _facts(drive, results[0]),
        "command": f"maxcon demo --epochs {len(epochs)} --seed {seed}",
        "version": __version__,
        "seed": seed,
    }
    write_page(path, "demo.html.j2", page)
    return path


def _at_crossing(drive: DemoDrive, epochs: Sequence[EpochEstimate]) -> EpochEstimate:
    """Return the epoch nearest to the middle of the crossing."""
    middle = drive.point_map.frame.to_local([CITY_ORIGIN])[0]
    references = [drive.reference_at(epoch.raw.time) for epoch in epochs]
    distances = [math.hypot(pose.x - middle[0], pose.y - middle[1]) for pose in references]
    return epochs[int(np.argmin(distances))]


def worst_of_the_count(results: Sequence[MethodResult]) -> int:
    """Return the position of the epoch that the count puts farthest off where Helmert's score of the same is right.

    Where there is none that the count gets wrong, of all epochs.
    """
    is_shown = [
        count is not None and not count.is_success and helmert is not None and helmert.is_success
        for count, helmert in zip(results[0].errors, results[1].errors, strict=True)
    ]
    distances = np.array(results[0].distances)
    return int(np.nanargmax(np.where(is_shown, distances, np.nan) if any(is_shown) else distances))


@dataclass(frozen=True, eq=False)
class DemoPictures:
    """Pictures of the demo's page with their captions, drawn into a folder."""

    folder: Path
    drive: DemoDrive
    results: Sequence[MethodResult]

    def _scan_and_prior(self, epoch: EpochEstimate) -> tuple[Scan, Pose]:
        raw = open_scans(self.drive.dataset.scans).read(epoch.epoch)
        return scan_of(raw), self.drive.point_map.frame.pose_to_local(self.drive.prior.at(raw.time))

    def epoch(self, epoch: EpochEstimate) -> Picture:
        """Draw the search space of an epoch, and its scene."""
        (scan, prior), result = self._scan_and_prior(epoch), self.results[-1]
        method, point_map = result.method.method, self.drive.point_map
        accumulator = method.accumulate(scan, point_map, prior)
        path = self.folder / "epoch.png"
        plot_epoch(
            path,
            accumulator=accumulator,
            objective=method.cell_search.objective,
            estimate=method.conclude(accumulator, scan, point_map),
            scan=scan,
            point_map=point_map,
            title=f"Epoch {epoch.epoch}, in the street: {result.method.name}",
            reference=self.drive.reference_at(epoch.raw.time),
        )
        return Picture(
            "One epoch: every candidate pose, and the answer",
            "Left: the score of every position, one square per heading. Right: the scan at the prior and at the"
            " answer, on the map from above.",
            "Nine search spaces in colours with one bright cell, and a street seen from above.",
            path,
        )

    def why(self) -> Picture:
        """Draw the epoch that the count puts farthest off, and say what came out, whatever it is."""
        position = worst_of_the_count(self.results)
        row = self._row("uneven map", self.results[0].epochs[position])
        path = self.folder / "why.png"
        plot_comparison(path, [row], title="Why Helmert's point error, and a voxel once")
        off = {result.method.slug: result.distances[position] for result in self.results}
        found = [(result.method.name, result.accuracy) for result in self.results]
        wrong = "; ".join(f"{name}: {accuracy.n_epochs - accuracy.n_success}" for name, accuracy in found)
        return Picture(
            "Why Helmert's point error, and a voxel once",
            f"The mapping vehicle stood before a red light for {MAPPING_WAIT:g} s, and the map is denser there. At"
            f" {row.label.split(',')[0]} the count of map points ends {off['count-points']:.2f} m from the reference,"
            f" Helmert's score of the same matches {off['helmert-points']:.2f} m, and Helmert's score with each voxel"
            f" counting once, which is maxcon's default, {off['helmert-occupied']:.3f} m. Wrong by more than 0.3 m or"
            f" 1 degree, of {found[0][1].n_epochs} epochs: {wrong}.",
            "The search space of the best heading, scored by the count and by Helmert's point error.",
            path,
        )

    def street_and_crossing(self, street: EpochEstimate, crossing: EpochEstimate) -> Picture:
        """Draw the count beside Helmert, on the same matches, in the street and at the crossing."""
        rows = [self._row("in the street", street), self._row("at the crossing", crossing)]
        path = self.folder / "street-and-crossing.png"
        plot_comparison(path, rows, title="Count beside Helmert")
        return Picture(
            "Count beside Helmert, in the street and at the crossing",
            "In a street the count leaves a bright ray along the facades: every position on it matches about as many"
            " points. At a crossing facades face both ways: the count's two rays meet in one peak. Helmert's score asks"
            " how well the matches fix the position, and leaves the peak alone.",
            "The search spaces of the best heading, scored by count and by Helmert's point error.",
            path,
        )

    def _row(self, where: str, epoch: EpochEstimate) -> ComparisonRow:
        """An epoch by the paper's two methods and the default."""
        scan, prior = self._scan_and_prior(epoch)
        views = []
        for chosen in (result.method for result in self.results):
            if chosen.slug in ("count-points", "helmert-points", "helmert-occupied"):
                accumulator = chosen.method.accumulate(scan, self.drive.point_map, prior)
                views.append(SearchSpaceView(accumulator, chosen.method.cell_search.objective, chosen.name))
        reference = self.drive.reference_at(epoch.raw.time)
        return ComparisonRow(f"epoch {epoch.epoch}, {where}", scan, self.drive.point_map, reference, views)

    def errors(self) -> Picture:
        """Draw the errors of all methods."""
        errors = {result.method.name: np.array(result.distances) for result in self.results}
        return plot_error_distributions(self.folder / "errors.svg", errors)

    def drive_from_above(self) -> Picture:
        """Draw the drive by the default method."""
        path, result = self.folder / "drive.png", self.results[-1]
        references = [self.drive.reference_at(epoch.raw.time) for epoch in result.epochs]
        positions = np.array([(pose.x, pose.y) for pose in references])
        plot_drive(path, positions, result.distances, point_map=self.drive.point_map)
        return Picture(
            f"The drive from above: {result.method.name}",
            "The map in grey, each epoch in the colour of its error.",
            "The map from above with the drive.",
            path,
        )

    def wide_priors(self, wide: WideResult) -> Picture:
        """Draw what wide priors make of each method."""
        path = self.folder / "prior_error.svg"
        plot_prior_error(path, {"the simulated street": wide.summaries})
        return Picture(
            "Success by the error of the prior",
            f"{wide.words} Registration from one start ends at the nearest minimum, and cannot tell whether it is the"
            " right one; it has the map with ground, which holds its height and tilt. The same epochs and priors for"
            " all.",
            "Share of right answers, of wrong ones called good, and time, for priors wrong by up to 3, 6 and 12 m.",
            path,
        )


def _headline(best: MethodResult) -> str:
    return (
        f"{best.accuracy.n_epochs} simulated VLP-16 scans were localized in a simulated mobile-mapping cloud, from"
        " priors wrong by up to 2.5 m in x and y and 1.8 degrees. Helmert's score, a voxel counting once, put"
        f" {best.accuracy.n_success} of them within 0.3 m and 1 degree of the reference."
    )


def _facts(drive: DemoDrive, result: MethodResult) -> dict[str, str]:
    space, n_tiles = result.method.method.space, len(drive.point_map.tile_keys)
    n_headings, ny, nx = space.shape
    return {
        "Map": f"{len(drive.dataset.map_clouds)} LAZ clouds, {n_tiles} tiles of voxels of {space.cell_edge:g} m",
        "Search": f"{n_headings} headings x {ny} x {nx} cells: {space.n_cells:,} poses per epoch, none left out",
        "Scans": f"{len(result.epochs)} epochs of a VLP-16 with 3 cm noise; other cars are parked than in the map",
    }
