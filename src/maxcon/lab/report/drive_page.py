"""The page of one's own drive: where it went, how sure the answers are, which are in doubt; how good, if that is known.

It is made of the table of poses, so that it is the same for a drive that was gone on with or localized by workers.
"""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.version import __version__
from maxcon.drive.localize import DriveOptions, read_epoch, scan_of
from maxcon.drive.poses_table import PROTECTION_LEVELS
from maxcon.errors import TrajectoryError
from maxcon.estimate import Status
from maxcon.export import PoseRow
from maxcon.export.pose_rows import covariance_of
from maxcon.export.scene import ELLIPSE
from maxcon.geometry import Pose
from maxcon.integrity import along_and_across
from maxcon.io.scans import Scans
from maxcon.lab.evaluation import PROMISED, SUCCESS_WORDS, Coverage, PoseError, Quantiles, pose_error
from maxcon.lab.report import Picture, write_page
from maxcon.lab.report.certainty_plots import ErrorRow, plot_timeline
from maxcon.lab.report.charts import Floats
from maxcon.map import PointMap
from maxcon.plotting.epoch import MOST_HALF_WIDTH, PRIOR_COLOR, draw_points, half_width_of, is_off_the_ground
from maxcon.plotting.figure import INK, SERIES, Window, map_figure, round_length
from maxcon.refine.adjustment import planes_near, table_around
from maxcon.refine.patterns import GATE
from maxcon.refine.validation import LEVEL, N_BINS
from maxcon.scan import Scan
from maxcon.scan.trajectory import Trajectory

N_WORST = 10
N_FACED = 20
"""Scans whose walls are compared with the map's once more."""
MOST_LISTED = 50
"""Epochs without a pose that are listed one by one."""
SEEN = 0.03
"""The median ellipse is drawn so large, of the window."""


@dataclass(frozen=True, eq=False)
class ReportedDrive:
    """A drive that was localized, with what it was localized by; poses in global coordinates.

    rows: of POSES.csv, one for each scan, in order. prior: None if there was none. reference: poses held for true.
    """

    rows: Sequence[PoseRow]
    point_map: PointMap
    scans: Scans
    options: DriveOptions
    prior: Trajectory | None = None
    reference: Trajectory | None = None

    def local(self, source: Trajectory | None, epoch: int) -> Pose | None:
        """The pose of a trajectory at an epoch, local frame; None where it has none."""
        try:
            pose = None if source is None else source.at(self.rows[epoch].time, self.options.max_gap)
        except TrajectoryError:
            return None
        return None if pose is None else self.point_map.frame.pose_to_local(pose)

    def answer(self, epoch: int) -> Pose | None:
        """The answer of an epoch, local frame; None unless localized."""
        pose = self.rows[epoch].pose
        return None if pose is None else self.point_map.frame.pose_to_local(pose)

    def scan(self, epoch: int) -> Scan:
        """The scan of an epoch, read again; without points if it cannot be."""
        return scan_of(read_epoch(self.scans, epoch, self.options)[0])

    @cached_property
    def covariances(self) -> Floats:
        """Covariances of x, y, z and the turns, shape (n, 6, 6), axes of the map; NaN where there is none."""
        found = np.array([covariance_of(row) for row in self.rows])
        found[~found.any(axis=(1, 2))] = math.nan
        return found

    def sigmas(self) -> Floats:
        """Standard deviations along and across the heading, m, and of the heading, rad, shape (n, 3)."""
        found = np.full((len(self.rows), 3), math.nan)
        for sigmas, row, covariance in zip(found, self.rows, self.covariances, strict=True):
            if row.pose is not None:
                turned = along_and_across(covariance, row.pose.heading)
                sigmas[:] = np.sqrt([turned[0, 0], turned[1, 1], covariance[5, 5]])
        return found

    @cached_property
    def errors(self) -> Floats:
        """Errors along, across, m, and of the heading, rad, shape (n, 3); NaN without an answer or a reference."""
        found = np.full((len(self.rows), 3), math.nan)
        for epoch, errors in enumerate(found):
            answer, true = self.answer(epoch), self.local(self.reference, epoch)
            if answer is not None and true is not None:
                error = pose_error(answer, true)
                errors[:] = error.along, error.across, error.heading
        return found

    @cached_property
    def is_wrong(self) -> NDArray[np.bool_]:
        """Which answers are not within the limits of success of the reference, shape (n,)."""
        return np.array([not PoseError(*errors).is_success and not math.isnan(errors[0]) for errors in self.errors])

    @cached_property
    def levels(self) -> Floats:
        """Protection levels along and across, m, shape (n, 2); NaN where there is none."""
        return np.array([[row.numbers.get(name, math.nan) for name in PROTECTION_LEVELS] for row in self.rows])

    @property
    def kinds(self) -> list[ErrorRow]:
        """Errors along and across, m, and of the heading, degrees, with what was said of each."""
        (along, across, heading), sigmas = self.errors.T, self.sigmas().T
        none = np.full(len(self.rows), math.nan)
        return [
            ErrorRow("along", "m", along, sigmas[0], self.levels[:, 0]),
            ErrorRow("across", "m", across, sigmas[1], self.levels[:, 1]),
            ErrorRow("heading", "°", np.degrees(heading), np.degrees(sigmas[2]), none),
        ]

    def accuracy(self) -> dict[str, Any]:
        """Errors along, across, of the heading, and in x and y together, and how many the sigmas hold."""
        is_known = np.isfinite(self.errors[:, 0])
        rows: list[dict[str, Any]] = [
            {
                "name": kind.name, "unit": kind.unit, "of": Quantiles.of(kind.errors[is_known]),
                "within": Coverage.of(kind.errors, kind.sigmas).shares,
            }
            for kind in self.kinds
        ]  # fmt: skip
        together = np.hypot(*self.errors[is_known, :2].T)
        rows.append({"name": "x and y", "unit": "m", "of": Quantiles.of(together), "within": ()})
        has_level = np.isfinite(self.levels).all(axis=1) & is_known
        is_beyond = (np.abs(self.errors[:, :2]) > self.levels).any(axis=1) & has_level
        return {
            "rows": rows, "n": int(is_known.sum()), "n_wrong": int(self.is_wrong.sum()),
            "n_levels": int(has_level.sum()), "n_beyond": int(is_beyond.sum()),
        }  # fmt: skip


def write_drive_page(path: str | os.PathLike[str], drive: ReportedDrive, title: str, facts: Mapping[str, str]) -> None:
    """Write the page of a drive as one HTML file, on top the facts: what was assumed and searched, by name."""
    is_wrong, levels, rows = drive.is_wrong, drive.levels, drive.rows
    is_localized = np.array([row.pose is not None for row in rows])
    either, variances = levels.max(axis=1), drive.covariances[:, 0, 0] + drive.covariances[:, 1, 1]
    variances = variances[np.isfinite(variances)]
    numbers = np.flatnonzero(is_localized)
    chosen = numbers[np.linspace(0, len(numbers) - 1, min(N_FACED, len(numbers))).round().astype(int)]
    faced = ((epoch, drive.answer(epoch)) for epoch in chosen.tolist())
    with TemporaryDirectory() as folder:
        drawn = Path(folder)
        page = {
            "title": title,
            "n": len(rows),
            "n_localized": int(is_localized.sum()),
            "n_wrong": int((is_localized & is_wrong).sum()),
            "level": Quantiles.of(either[np.isfinite(either)]),
            "facts": facts,
            "sigma": drive.point_map.sigma,
            "ratio": min(1.0, 2.0 * drive.point_map.sigma**2 / float(np.median(variances))) if len(variances) else None,
            "above": _from_above(drawn / "above.png", drive),
            "statuses": _statuses(rows),
            "left_out": [(n, drive.scans.name(n), rows[n]) for n in np.flatnonzero(~is_localized)[:MOST_LISTED]],
            "n_left_out": int((~is_localized).sum()),
            "timeline": _timeline(drawn / "timeline.svg", drive),
            "facings": facings(((drive.scan(n), pose) for n, pose in faced if pose is not None), drive.point_map),
            "accuracy": None if drive.reference is None else drive.accuracy(),
            "success": SUCCESS_WORDS,
            "promised": PROMISED,
            "worst": [
                _epoch(drawn / f"{epoch}.png", drive, epoch)
                for epoch in worst_epochs(is_localized, is_wrong, np.nanmax(np.nan_to_num(levels), axis=1))
            ],
            "version": __version__,
        }
        write_page(path, "drive.html.j2", page)


def worst_epochs(is_localized: NDArray[np.bool_], is_wrong: NDArray[np.bool_], levels: Floats) -> list[int]:
    """Return at most ten epochs: wrong and localized first, then not localized, then of the largest levels, m."""
    # Those that are not localized are taken evenly from the drive: neighbours look alike.
    wrong = np.flatnonzero(is_wrong & is_localized)[:N_WORST]
    without = np.flatnonzero(~is_localized)
    n_without = min(len(without), N_WORST - len(wrong))
    chosen = without[np.linspace(0, len(without) - 1, n_without).round().astype(int)] if n_without else without[:0]
    others = np.flatnonzero(is_localized & ~is_wrong)
    others = others[np.argsort(-levels[others], kind="stable")]
    return [*wrong.tolist(), *chosen.tolist(), *others.tolist()][:N_WORST]


def _statuses(rows: Sequence[PoseRow]) -> list[dict[str, Any]]:
    """Each status that occurs: how often, what it means, and the first reason beside it; localized first."""
    found = []
    for word in sorted({row.status for row in rows}, key=lambda word: (word != Status.LOCALIZED, word)):
        reasons = [row.reason for row in rows if row.status == word]
        reason = next(filter(None, reasons), "")
        found.append({"status": word, "n": len(reasons), "meaning": Status(word).explanation, "reason": reason})
    return found


class Facing(NamedTuple):
    """Walls of one direction: how those of scans lie on those of the map."""

    first_deg: float  # azimuths of their normals, degrees from +x, both sides of a wall alike
    last_deg: float
    n_points: int  # wall points of the scans
    found: float  # which ratio of them has a wall of the map beside it, 0 to 1
    offset: float  # median of where the map's walls lie beside the scans', along the azimuth, m
    p95: float  # of the distances, m


def facings(scans: Iterable[tuple[Scan, Pose]], point_map: PointMap) -> list[Facing]:
    """Return the facings of scans at poses, local frame, those with wall points."""
    azimuths, offsets = [np.empty(0)], [np.empty(0)]
    for scan, pose in scans:
        sample, table = scan.sample, table_around(scan.sample, point_map, [pose])
        is_wall = sample.normals.any(axis=1) & (np.abs(sample.normals @ pose.rotation[2]) < LEVEL)
        points, normals = sample.points[is_wall], sample.normals[is_wall]
        planes, distances = planes_near(points, normals, pose, GATE, point_map, table)
        azimuth = np.arctan2(normals @ pose.rotation[1], normals @ pose.rotation[0]) % np.pi
        towards = planes[:, 0] * np.cos(azimuth) + planes[:, 1] * np.sin(azimuth)
        azimuths.append(azimuth)
        offsets.append(distances * np.where(towards < 0.0, -1.0, 1.0))
    bins = np.minimum(np.concatenate(azimuths) * N_BINS / np.pi, N_BINS - 1).astype(int)
    found, width = [], 180.0 / N_BINS
    for k in range(N_BINS):
        of_facing = np.concatenate(offsets)[bins == k]
        near = of_facing[np.isfinite(of_facing)]
        if len(near):
            p95, share = float(np.quantile(np.abs(near), 0.95)), len(near) / len(of_facing)
            found.append(Facing(k * width, (k + 1) * width, len(of_facing), share, float(np.median(near)), p95))
    return found


def _from_above(path: Path, drive: ReportedDrive) -> Picture:
    from matplotlib.patches import Ellipse

    def places(poses: Iterable[Pose | None]) -> Floats:
        nowhere = np.full(2, math.nan)
        return np.array([nowhere if pose is None else pose.position[:2] for pose in poses])

    epochs = range(len(drive.rows))
    found, rough = places(map(drive.answer, epochs)), places(drive.local(drive.prior, epoch) for epoch in epochs)
    known = np.concatenate([found, rough])
    known = known[np.isfinite(known[:, 0])]
    window = Window.with_room(known if len(known) else np.zeros((1, 2)))
    values, vectors = np.linalg.eigh(np.nan_to_num(drive.covariances[:, :2, :2]))
    axes_of = ELLIPSE * np.sqrt(np.maximum(values, 0.0))
    largest = axes_of[:, 1]
    median = float(np.median(largest[largest > 0.0])) if (largest > 0.0).any() else 1.0
    factor = round_length(max(1.0, SEEN * max(window.size) / (2.0 * median)))
    words = f"Ellipses of 95 %, {factor:g} times as large as they are."
    with map_figure(path, window, drive.point_map, ("The drive from above", words), side=8.2) as (figure, axes):
        if np.isfinite(rough).any():
            axes.plot(*rough.T, color=PRIOR_COLOR, lw=1.0, zorder=3, label="prior")
        axes.plot(*found.T, "o", color=SERIES[0], ms=3.5, zorder=5, label="localized")
        for epoch in np.flatnonzero(largest > 0.0):
            height, width = 2.0 * factor * axes_of[epoch]
            angle = math.degrees(math.atan2(vectors[epoch, 1, 1], vectors[epoch, 0, 1]))
            axes.add_patch(
                Ellipse(found[epoch], width, height, angle=angle, fill=False, ec=SERIES[0], lw=0.8, zorder=4)
            )
        lost = rough[np.isnan(found[:, 0])]
        if np.isfinite(lost).any():
            axes.plot(*lost.T, "X", mfc=SERIES[4], mec=INK, ms=8, zorder=6, label="not localized, at its prior")
        figure.legend(loc="outside lower left", ncols=3)
    return Picture.of("drive-above", path, factor=factor)


def _timeline(path: Path, drive: ReportedDrive) -> Picture:
    words = [row.status for row in drive.rows]
    plot_timeline(path, np.arange(float(len(words))), words, drive.is_wrong, drive.kinds, title="Scan by scan")
    return Picture.of("drive-timeline", path)


def _epoch(path: Path, drive: ReportedDrive, epoch: int) -> Picture:
    """The scan of an epoch on the map, at its prior and, if it is localized, at the answer."""
    row, name = drive.rows[epoch], drive.scans.name(epoch)
    prior, answer = drive.local(drive.prior, epoch), drive.answer(epoch)
    at = answer or prior or Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    scan = drive.scan(epoch)
    points = scan.points[is_off_the_ground(scan, at)]
    sets = [("scan at the prior", PRIOR_COLOR, prior.apply(points), 1.3)] if prior is not None else []
    if answer is not None:
        sets.append(("scan at the answer", SERIES[0], answer.apply(points), 1.6))
    window = Window.around(at.x, at.y, half_width_of(scan, MOST_HALF_WIDTH))
    titles = f"Epoch {epoch}: {row.status}", name
    with map_figure(path, window, drive.point_map, titles, side=4.6) as (figure, axes):
        figure.legend(handles=draw_points(axes, sets), loc="outside lower left", ncols=2)
    level = max((row.numbers.get(name, 0.0) for name in PROTECTION_LEVELS), default=0.0)
    known = [f"protection level {level:.2f} m" if level else "", row.reason]
    words = "; ".join(filter(None, known)) or "no reason beside it"
    return Picture("", f"Epoch {epoch}, {name}: {row.status}; {words}.", "A scan on the map from above.", path)
