# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The page of the demo: what was done, in figures, pictures and a few words."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.atomic import make_folder
from maxcon._system.version import __version__
from maxcon.lab.demo import COUNT_POINTS, DEMO_METHODS, HELMERT, HELMERT_POINTS, MAPPING_WAIT, PRIOR, DemoResults
from maxcon.lab.paper.search_spaces import ComparisonRow, plot_comparison
from maxcon.lab.report import Picture, write_page
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.report.study_pictures import Scenes
from maxcon.lab.report.study_statistics import plot_error_distributions
from maxcon.lab.simulation.datasets import CITY_ORIGIN
from maxcon.lab.study.bench import Bench
from maxcon.lab.study.methods import STANDARD
from maxcon.lab.study.table import MethodRows, MethodStatistics, statistics
from maxcon.plotting import plot_drive
from maxcon.plotting.score_panel import SearchSpaceView

# Of the whole drive: well before the crossing, in the straight part of the street.
STREET_PART = 0.25


def report_demo(folder: Path, bench: Bench, results: DemoResults, *, seed: int, progress: Progress) -> Path:
    """Draw the pictures and write `report.html` into `folder`; return its path."""
    pictures = DemoPictures(folder / "pictures", bench, results)
    make_folder(pictures.folder)
    n_epochs = len(bench.scans)
    street = int(STREET_PART * (n_epochs - 1))
    steps: dict[str, Callable[[], Picture]] = {
        "why": pictures.why,
        "wide": pictures.wide_priors,
        "errors": pictures.errors,
        "drive": pictures.drive_from_above,
        "epoch": lambda: pictures.epoch(street),
        "spaces": lambda: pictures.street_and_crossing(street),
    }
    drawn = {}
    for number, (name, step) in enumerate(steps.items(), 1):
        drawn[name] = step()
        progress("drawing", number, len(steps))
    path, found = folder / "report.html", [statistics(rows) for rows in results.near]
    page = {
        "title": "maxcon demo: a simulated street", "headline": _headline(found[-1]), "methods": DEMO_METHODS,
        "results": found, **drawn, "facts": _facts(bench), "command": f"maxcon demo --epochs {n_epochs} --seed {seed}",
        "version": __version__, "seed": seed,
    }  # fmt: skip
    write_page(path, "demo.html.j2", page)
    return path


def worst_of_the_count(count: MethodRows, helmert: MethodRows) -> int:
    """Return the epoch that the count puts farthest off where Helmert's score of the same is right.

    Where there is none that the count gets wrong, of all epochs.
    """
    distances = count.numbers("distance")
    is_shown = ~np.isnan(distances) & (count.numbers("is_success") == 0.0) & (helmert.numbers("is_success") == 1.0)
    return int(np.nanargmax(np.where(is_shown, distances, np.nan) if is_shown.any() else distances))


@dataclass(frozen=True, eq=False)
class DemoPictures:
    """Pictures of the demo's page with their captions, drawn into a folder."""

    folder: Path
    bench: Bench
    results: DemoResults

    @property
    def scenes(self) -> Scenes:
        """The epochs, searched again by the default method."""
        return Scenes(self.bench, PRIOR, self.bench.maps[STANDARD], DEMO_METHODS[HELMERT])

    @property
    def near(self) -> dict[str, MethodRows]:
        """Answers from near priors by method."""
        return {rows.method: rows for rows in self.results.near}

    def epoch(self, epoch: int) -> Picture:
        """Draw the search space of an epoch, and its scene."""
        path = self.folder / "epoch.png"
        self.scenes.draw_epoch(path, epoch, f"Epoch {epoch}, in the street: {HELMERT}")
        return Picture.of("demo-epoch", path)

    def why(self) -> Picture:
        """Draw the epoch that the count puts farthest off, and say what came out, whatever it is."""
        near = self.near
        epoch = worst_of_the_count(near[COUNT_POINTS], near[HELMERT_POINTS])
        path = self.folder / "why.png"
        plot_comparison(path, [self._row("uneven map", epoch)], title="Why Helmert's point error, and a voxel once")
        off = {name: near[name].numbers("distance")[epoch] for name in near}
        found = [statistics(rows) for rows in self.results.near]
        wrong = "; ".join(f"{one.method}: {one.n_epochs - one.n_success}" for one in found)
        return Picture.of(
            "demo-why", path, wait=MAPPING_WAIT, epoch=epoch, count=off[COUNT_POINTS], helmert=off[HELMERT_POINTS],
            once=off[HELMERT], n_epochs=found[0].n_epochs, wrong=wrong,
        )  # fmt: skip

    def street_and_crossing(self, street: int) -> Picture:
        """Draw the count beside Helmert, on the same matches, in the street and at the crossing."""
        middle = self.scenes.point_map.frame.to_local([CITY_ORIGIN])[0]
        crossing = int(np.argmin(np.linalg.norm(self._references() - middle[:2], axis=1)))
        rows = [self._row("in the street", street), self._row("at the crossing", crossing)]
        path = self.folder / "street-and-crossing.png"
        plot_comparison(path, rows, title="Count beside Helmert")
        return Picture.of("demo-spaces", path)

    def _references(self) -> NDArray[np.float64]:
        """Where the car was at each epoch, shape (n, 2), local frame, m."""
        return np.array([self.scenes.poses(epoch)[1].position[:2] for epoch in range(len(self.bench.scans))])

    def _row(self, where: str, epoch: int) -> ComparisonRow:
        """An epoch by the paper's two methods and the default."""
        views = []
        for name in (COUNT_POINTS, HELMERT_POINTS, HELMERT):
            method = DEMO_METHODS[name]
            scan, accumulator, _ = self.scenes.search(epoch, method)
            views.append(SearchSpaceView(accumulator, method.cell_search.objective, name))
        return self.scenes.row(f"epoch {epoch}, {where}", epoch, views, scan)

    def errors(self) -> Picture:
        """Draw the errors of all methods."""
        errors = {name: rows.numbers("distance") for name, rows in self.near.items()}
        return plot_error_distributions(self.folder / "errors.svg", errors)

    def drive_from_above(self) -> Picture:
        """Draw the drive by the default method."""
        path = self.folder / "drive.png"
        errors = self.near[HELMERT].numbers("distance")
        plot_drive(path, self._references(), errors, point_map=self.scenes.point_map)
        return Picture.of("demo-drive", path, method=HELMERT)

    def wide_priors(self) -> Picture:
        """Draw what wide priors make of each method."""
        path = self.folder / "prior_error.svg"
        plot_prior_error(path, {"the simulated street": self.results.wide})
        return Picture.of("demo-wide", path, words=self.results.wide_words)


def _headline(best: MethodStatistics) -> str:
    return (
        f"{best.n_epochs} simulated VLP-16 scans were localized in a simulated mobile-mapping cloud, from"
        " priors wrong by up to 2.5 m in x and y and 1.8 degrees. Helmert's score, a voxel counting once, put"
        f" {best.n_success} of them within 0.3 m and 1 degree of the reference."
    )


def _facts(bench: Bench) -> dict[str, str]:
    space, n_tiles = DEMO_METHODS[HELMERT].space, len(bench.maps[STANDARD].tile_keys)
    n_headings, ny, nx = space.shape
    return {
        "Map": f"{n_tiles} tiles of voxels of {space.cell_edge:g} m, from clouds of a mapping vehicle",
        "Search": f"{n_headings} headings x {ny} x {nx} cells: {space.n_cells:,} poses per epoch, none left out",
        "Scans": f"{len(bench.scans)} epochs of a VLP-16 with 3 cm noise; other cars are parked than in the map",
    }
