# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The page of the demo: what was done, in figures, pictures and a few words."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from maxcon._system.atomic import make_folder
from maxcon._system.progress import Progress
from maxcon._system.version import __version__
from maxcon.drive.localize import EpochEstimate, scan_of
from maxcon.geometry import Pose
from maxcon.io.scans import open_scans
from maxcon.lab.demo.run import MAPPING_WAIT, DemoDrive, MethodResult
from maxcon.lab.demo.wide import WideResult
from maxcon.lab.report import (
    DemoPage,
    MethodSummary,
    Picture,
    SearchSpaceView,
    plot_drive,
    plot_epoch,
    plot_errors,
    plot_prior_error,
    plot_search_spaces,
    write_demo_page,
)
from maxcon.lab.simulation.dataset_files import CITY_ORIGIN
from maxcon.scan import Scan

__all__ = ["report_demo"]

# Of the whole drive: well before the crossing, in the straight part of the street.
STREET_PART = 0.25


def report_demo(
    folder: Path, drive: DemoDrive, results: Sequence[MethodResult], wide: WideResult, *, seed: int, progress: Progress
) -> Path:
    """Draw the pictures and write `report.html` into `folder`; return its path."""
    pictures = folder / "pictures"
    make_folder(pictures)
    epochs = results[-1].epochs
    fooled = _worst_of_the_count(results)
    street, crossing = epochs[int(STREET_PART * (len(epochs) - 1))], _at_crossing(drive, epochs)
    steps: list[Callable[[], Picture]] = [
        lambda: _why_picture(pictures, drive, results, fooled),
        lambda: _epoch_picture(pictures, drive, results[-1], street),
        lambda: _spaces_picture(pictures, drive, results, street, "street"),
        lambda: _spaces_picture(pictures, drive, results, crossing, "crossing"),
        lambda: _errors_picture(pictures, results),
        lambda: _drive_picture(pictures, drive, results[-1]),
        lambda: _wide_picture(pictures, wide),
    ]
    drawn = []
    for number, step in enumerate(steps, 1):
        drawn.append(step())
        progress("drawing", number, len(steps))
    page = DemoPage(
        title="maxcon demo: a simulated street",
        headline=_headline(results),
        methods=tuple(_summary(result) for result in results),
        why=drawn[0],
        epochs=tuple(drawn[1:4]),
        errors=drawn[4],
        drive=drawn[5],
        wide=drawn[6],
        facts=_facts(drive, results),
        command=f"maxcon demo --epochs {len(epochs)} --seed {seed}",
        version=__version__,
        seed=seed,
    )
    path = folder / "report.html"
    write_demo_page(path, page)
    return path


def _at_crossing(drive: DemoDrive, epochs: Sequence[EpochEstimate]) -> EpochEstimate:
    """Return the epoch nearest to the middle of the crossing."""
    middle = drive.point_map.frame.to_local([CITY_ORIGIN])[0]

    def distance(epoch: EpochEstimate) -> float:
        reference = drive.reference_at(epoch.raw.time)
        return math.hypot(reference.x - middle[0], reference.y - middle[1])

    return min(epochs, key=distance)


def _worst_of_the_count(results: Sequence[MethodResult]) -> int:
    """Return the position of the epoch that the count puts farthest off where Helmert's score of the same is right.

    Where there is none that the count gets wrong, of all epochs.
    """
    of_count, of_helmert = results[0].errors, results[1].errors
    is_shown = [
        count is not None and not count.is_success and helmert is not None and helmert.is_success
        for count, helmert in zip(of_count, of_helmert, strict=True)
    ]
    distances = np.array(_distances(results[0]))
    return int(np.nanargmax(np.where(is_shown, distances, np.nan) if any(is_shown) else distances))


def _scan_and_prior(drive: DemoDrive, epoch: EpochEstimate) -> tuple[Scan, Pose]:
    raw = open_scans(drive.dataset.scans).read(epoch.epoch)
    return scan_of(raw), drive.point_map.frame.pose_to_local(drive.prior.at(raw.time))


def _epoch_picture(folder: Path, drive: DemoDrive, result: MethodResult, epoch: EpochEstimate) -> Picture:
    scan, prior = _scan_and_prior(drive, epoch)
    method = result.method.method
    accumulator = method.accumulate(scan, drive.point_map, prior)
    path = folder / "epoch.png"
    plot_epoch(
        path,
        accumulator=accumulator,
        objective=method.cell_search.objective,
        estimate=method.conclude(accumulator, scan, drive.point_map),
        scan=scan,
        point_map=drive.point_map,
        title=f"Epoch {epoch.epoch}, in the street: {result.method.name}",
        reference=drive.reference_at(epoch.raw.time),
    )
    return Picture(
        "One epoch: every candidate pose, and the answer",
        "Left: the score of every position, one square per heading. Right: the scan at the prior and at the"
        " answer, on the map from above.",
        "Nine search spaces in colours with one bright cell, and a street seen from above.",
        path,
    )


def _why_picture(folder: Path, drive: DemoDrive, results: Sequence[MethodResult], position: int) -> Picture:
    """Draw the epoch that the count puts farthest off, and say what came out, whatever it is."""
    epoch = results[0].epochs[position]
    path = folder / "why.png"
    _plot_spaces(path, drive, results, epoch, "where the map is denser in one place")
    off = {result.method.slug: _distances(result)[position] for result in results}
    wrong = [f"{result.method.name}: {result.accuracy.n_epochs - result.accuracy.n_success}" for result in results]
    return Picture(
        "Why Helmert's point error, and a voxel once",
        f"The mapping vehicle stood before a red light for {MAPPING_WAIT:g} s, and the map is denser there. At"
        f" epoch {epoch.epoch} the count of map points ends {off['count-points']:.2f} m from the reference, Helmert's"
        f" score of the same matches {off['helmert-points']:.2f} m, and Helmert's score with each voxel counting"
        f" once, which is maxcon's default, {off['helmert-occupied']:.3f} m. Wrong by more than 0.3 m or 1 degree, of"
        f" {results[0].accuracy.n_epochs} epochs: {'; '.join(wrong)}.",
        "The search space of the best heading, scored by the count and by Helmert's point error.",
        path,
    )


def _spaces_picture(
    folder: Path, drive: DemoDrive, results: Sequence[MethodResult], epoch: EpochEstimate, place: str
) -> Picture:
    """Draw the paper's figure: the count beside Helmert, on the same matches."""
    path = folder / f"{place}.png"
    _plot_spaces(path, drive, results, epoch, "at the crossing" if place == "crossing" else "in the street")
    captions = {
        "street": "In a street the count leaves a bright ray along the facades: every position on it matches about"
        " as many points. Helmert's score asks how well the matches fix the position, and leaves a peak.",
        "crossing": "At a crossing facades face both ways: the count's two rays meet in one peak, and Helmert's"
        " score keeps the peak alone.",
    }
    return Picture(
        f"Count beside Helmert, {'at the crossing' if place == 'crossing' else 'in the street'}",
        captions[place],
        "The search space of the best heading, scored by count and by Helmert's point error.",
        path,
    )


def _plot_spaces(
    path: Path, drive: DemoDrive, results: Sequence[MethodResult], epoch: EpochEstimate, where: str
) -> None:
    scan, prior = _scan_and_prior(drive, epoch)
    views = []
    for result in results:
        if result.method.slug in ("count-points", "helmert-points", "helmert-occupied"):
            accumulator = result.method.method.accumulate(scan, drive.point_map, prior)
            views.append(SearchSpaceView(accumulator, result.method.method.cell_search.objective, result.method.name))
    reference = drive.reference_at(epoch.raw.time)
    plot_search_spaces(path, views, title=f"Epoch {epoch.epoch}, {where}", reference=reference)


def _distances(result: MethodResult) -> list[float]:
    return [error.distance if error is not None else math.nan for error in result.errors]


def _errors_picture(folder: Path, results: Sequence[MethodResult]) -> Picture:
    path = folder / "errors.svg"
    times = [epoch.raw.time for epoch in results[0].epochs]
    plot_errors(path, times, {result.method.name: _distances(result) for result in results})
    return Picture(
        "Errors over the drive",
        "Distance of each answer to the reference: the best cell, of 6 cm, adjusted to the surfaces of the map.",
        "Errors of each method over time, and their distribution.",
        path,
    )


def _drive_picture(folder: Path, drive: DemoDrive, result: MethodResult) -> Picture:
    path = folder / "drive.png"
    references = [drive.reference_at(epoch.raw.time) for epoch in result.epochs]
    positions = np.array([(pose.x, pose.y) for pose in references])
    plot_drive(path, positions, _distances(result), point_map=drive.point_map)
    return Picture(
        f"The drive from above: {result.method.name}",
        "The map in grey, each epoch in the colour of its error.",
        "The map from above with the drive.",
        path,
    )


def _wide_picture(folder: Path, wide: WideResult) -> Picture:
    path = folder / "prior_error.svg"
    plot_prior_error(path, {"the simulated street": wide.summaries})
    return Picture(
        "Success by the error of the prior",
        f"{wide.words} Registration from one start ends at the nearest minimum, and cannot tell whether it is the"
        " right one; it has the map with ground, which holds its height and tilt. The same epochs and priors for all.",
        "Share of right answers, of wrong ones called good, and time, for priors wrong by up to 3, 6 and 12 m.",
        path,
    )


def _summary(result: MethodResult) -> MethodSummary:
    accuracy = result.accuracy
    method = result.method.method
    return MethodSummary(
        name=type(method.objective).__name__,
        multiplicity=str(method.multiplicity),
        n_epochs=accuracy.n_epochs,
        n_localized=result.n_localized,
        n_success=accuracy.n_success,
        median_error=accuracy.distance.median,
        worst_error=accuracy.distance.worst,
        worst_heading_error_deg=math.degrees(accuracy.heading.worst),
        median_ms=result.median_milliseconds,
    )


def _headline(results: Sequence[MethodResult]) -> str:
    best = results[-1]
    accuracy = best.accuracy
    return (
        f"{accuracy.n_epochs} simulated VLP-16 scans were localized in a simulated mobile-mapping cloud, from priors"
        " wrong by up to 2.5 m in x and y and 1.8 degrees. Helmert's score, a voxel counting once, put"
        f" {accuracy.n_success} of them within 0.3 m and 1 degree of the reference."
    )


def _facts(drive: DemoDrive, results: Sequence[MethodResult]) -> tuple[tuple[str, str], ...]:
    space = results[0].method.method.space
    n_headings, ny, nx = space.shape
    n_tiles = len(drive.point_map.tile_keys)
    return (
        ("Map", f"{len(drive.dataset.map_clouds)} LAZ clouds, {n_tiles} tiles of voxels of {space.cell_edge:g} m"),
        ("Search", f"{n_headings} headings x {ny} x {nx} cells: {space.n_cells:,} poses per epoch, none left out"),
        (
            "Scans",
            f"{len(results[0].epochs)} epochs of a VLP-16 with 3 cm noise; other cars are parked than in the map",
        ),
    )
