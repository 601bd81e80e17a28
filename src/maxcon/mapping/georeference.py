"""Where a map in coordinates of its own lies: a rigid transform from positions of a receiver, and control points.

A place x of the map is at c + d + s exp(w) R (x - m) in the CRS, with m and c the middles of both sides. d, w and s are
adjusted with Cauchy's weights, from twelve headings, so that no rough transform is needed.
"""

import math
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError, TrajectoryError
from maxcon.io.crs import Operation
from maxcon.io.text import read_pose_table
from maxcon.scan.trajectory import Trajectory

LEAST_FIXES = 10
CONTROL_COLUMNS = ("name", "x", "y", "z", "east", "north", "height")
LARGEST_GAP = 1.0  # s; no antenna's place is interpolated across a larger one
N_HEADINGS = 12  # of the starts
MOST_AT_STARTS = 200  # fixes, evenly over all
CAUCHY = 2.385  # residuals of so many sigmas weigh half: 95 % efficient where all errors are normal
NORMAL_MEDIAN = 0.6745  # median of the absolute value of a standard normal deviate
SINGULAR, UNKNOWN = 1e-9, 1e12  # eigenvalues of the scaled normal matrix below it say nothing: their variance instead
OUTLIER = 4.0  # sigmas; what is farther off is reported as an outlier
STEP = 1e-6  # m and rad, of the derivatives of residuals
LEAST_SIGMA = 1e-3  # of fixes, in stated ones, or m: simulated ones may have no errors
CONTROL_SIGMA = 0.05  # m, of a control point along an axis, where none is stated
LARGEST_MISFIT = 0.05  # mean of the residuals over how far the places reach: beyond, they are not the same places
LARGEST_ANGLE_SIGMA = math.radians(1.0)  # an axis known less well is not determined


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Places that are known both in the map and in the CRS: fixes of a receiver, control points."""

    names: tuple[str, ...]  # (n,): of fixes their times
    local: NDArray[np.float64]  # (n, 3), m
    global_: NDArray[np.float64]  # (n, 3), m
    sigmas: NDArray[np.float64]  # (n, 3): along the axes of the CRS, m, but for a factor where `has_own_scale`
    has_own_scale: bool  # of fixes, whose errors are estimated, and follow each other in time
    operation: Operation | None = None  # by which they came into the CRS; None where they were in it


@dataclass(frozen=True, slots=True, eq=False)
class Georeference:
    """How a map is placed: x_global = to + scale * rotation @ (x_map - middle)."""

    rotation: NDArray[np.float64]
    middle: NDArray[np.float64]
    to: NDArray[np.float64]
    scale: float
    covariance: NDArray[np.float64]  # (6, 6) or (7, 7): of `to` (m), turns about its axes (rad), log of scale
    places: tuple[Places, ...]  # what it is from
    residuals: NDArray[np.float64]  # (n, 3): of all of them, m
    sigmas: NDArray[np.float64]  # (n, 3): of all of them, m
    n_alike: float  # so many fixes in a row err alike
    sigma: float  # of these places along the worst axis, m, in the mean over all

    @property
    def local(self) -> NDArray[np.float64]:
        """All places in the map, shape (n, 3), m."""
        return np.concatenate([each.local for each in self.places])

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places of the map, shape (n, 3), m, in the CRS."""
        return np.asarray(self.to + self.scale * (points - self.middle) @ self.rotation.T)

    def of_poses(self, poses: Trajectory) -> Trajectory:
        """Poses T_map_sensor in the CRS."""
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_matrix(self.rotation) * Rotation.from_quat(poses.quaternions_xyzw)
        return Trajectory(poses.times, self.apply(poses.positions), turned.as_quat())

    @property
    def are_outliers(self) -> NDArray[np.bool_]:
        """Which places lie farther off than errors explain."""
        return np.asarray((np.abs(self.residuals) > OUTLIER * self.sigmas).any(axis=1))

    @property
    def sigmas_of_turns_deg(self) -> tuple[float, float, float]:
        """Standard deviations of the turns about east, north and up, degrees."""
        x, y, z = np.degrees(np.sqrt(np.diag(self.covariance)[3:6])).tolist()
        return x, y, z

    def describe(self) -> Mapping[str, object]:
        """Return its entry in the manifest (docs/map_format.md)."""
        arrays = {name: getattr(self, name).tolist() for name in ("rotation", "middle", "to")}
        turns = [round(value, 5) for value in self.sigmas_of_turns_deg]
        counts = {"n_places": len(self.residuals), "n_outliers": int(self.are_outliers.sum())}
        operation = next((each.operation.describe() for each in self.places if each.operation), None)
        sigmas = {"sigma": round(self.sigma, 4), "sigmas_of_turns_deg": turns}
        return {**arrays, "scale": self.scale, **sigmas, **counts, "operation": operation}


def places_of_fixes(antenna: Trajectory, fixes: Trajectory) -> Places:
    """Return where the antenna was at the times of fixes; TrajectoryError if fewer than ten have poses around them."""
    rows, local = list[int](), list[NDArray[np.float64]]()
    for row, time in enumerate(fixes.times.tolist()):
        with suppress(TrajectoryError):
            local.append(antenna.at(time, LARGEST_GAP).position)
            rows.append(row)
    if len(rows) < LEAST_FIXES:
        raise TrajectoryError(
            f"Expected at least {LEAST_FIXES} fixes between poses at most {LARGEST_GAP:g} s apart, got {len(rows)} of"
            f" {len(fixes)}: fixes from {fixes.times[0]:.3f} to {fixes.times[-1]:.3f} s, poses from"
            f" {antenna.times[0]:.3f} to {antenna.times[-1]:.3f} s. Do both use the same clock?"
        )
    sigmas = np.ones((len(rows), 3))
    if fixes.covariances is not None:
        stated = np.sqrt(0.5 * np.trace(fixes.covariances[rows, :2, :2], axis1=1, axis2=2))
        usual = np.nanmedian(stated)
        if usual > 0.0:
            sigmas *= np.where(stated > 0.0, stated / usual, 1.0)[:, None]
    names = tuple(f"{time:.6f}" for time in fixes.times[rows].tolist())
    return Places(names, np.array(local), fixes.positions[rows], sigmas, has_own_scale=True)


def read_control_points(path: str | os.PathLike[str]) -> Places:
    """Return the control points of a CSV file, m; sigma may be missing. FileError or TrajectoryError otherwise."""
    table = read_pose_table(Path(path), "control points")
    missing = [name for name in CONTROL_COLUMNS if name not in table.names]
    if missing:
        table.refuse(
            f"Expected a header with {','.join(CONTROL_COLUMNS)}, got no {missing[0]!r} in"
            f" {','.join(table.names)[:80]!r}. Name the columns so, separated by commas."
        )
    values = table.numbers([*CONTROL_COLUMNS[1:], "sigma"], may_be_empty=True)
    for row in np.flatnonzero(np.isnan(values[:, :6]).any(axis=1) | (values[:, 6] == 0.0)).tolist():
        table.add_fault(row, "Expected numbers in all columns, sigma above 0, got another.")
    (values,) = table.good([values], may_leave_out=False)
    sigmas = np.where(np.isnan(values[:, 6]), CONTROL_SIGMA, values[:, 6])
    return Places(
        tuple(table.texts("name")), values[:, :3], values[:, 3:6], np.tile(sigmas[:, None], 3), has_own_scale=False
    )


def georeference(
    places: tuple[Places, ...], *, with_scale: bool = False, level_sigma: float | None = None
) -> Georeference:
    """Return the transform from a map to the CRS that fits places best; OptionError if they do not determine it.

    `level_sigma`: how well the z axis of the map is known to be up, rad; None: not at all.
    """
    local, global_, stated = (
        np.concatenate([getattr(each, name) for each in places]) for name in ("local", "global_", "sigmas")
    )
    is_fix = np.repeat([each.has_own_scale for each in places], [len(each.names) for each in places])
    middle, centre = np.median(local, axis=0), np.median(global_, axis=0)
    fit = _Fit(local - middle, global_ - centre, level_sigma, 7 if with_scale else 6)
    pose, sigmas = fit.start(stated), stated.copy()
    for _ in range(10):
        for axes in (slice(2), slice(2, 3)) if is_fix.any() else ():  # a receiver's heights are worse
            sizes = np.abs(fit.residuals(pose)[is_fix, axes] / stated[is_fix, axes])
            sigmas[is_fix, axes] = stated[is_fix, axes] * max(float(np.median(sizes)) / NORMAL_MEDIAN, LEAST_SIGMA)
        pose = fit.adjusted(pose, sigmas, "cauchy", CAUCHY)
    covariance, n_alike, sigma = fit.covariance(pose, sigmas, is_fix)
    found = Georeference(
        pose.rotation, middle, centre + pose.shift, pose.scale, covariance, places, fit.residuals(pose), sigmas,
        n_alike, sigma,
    )  # fmt: skip
    _check_determined(found)
    return found


class _Pose(NamedTuple):
    """Rotation (3, 3), shift (3,), m, and scale."""

    rotation: NDArray[np.float64]
    shift: NDArray[np.float64]
    scale: float

    def changed(self, unknowns: NDArray[np.float64]) -> "_Pose":
        """Return it shifted (m), turned about the axes (rad), and stretched (by a logarithm)."""
        from scipy.spatial.transform import Rotation

        rotation = Rotation.from_rotvec(unknowns[3:6]).as_matrix() @ self.rotation
        return _Pose(rotation, self.shift + unknowns[:3], self.scale * math.exp(unknowns[6:].sum()))


class _Fit(NamedTuple):
    """The adjustment: places (n, 3) of the map and of the CRS, both about their middles, m."""

    local: NDArray[np.float64]
    global_: NDArray[np.float64]
    level_sigma: float | None
    n_unknowns: int

    def residuals(self, pose: _Pose) -> NDArray[np.float64]:
        return np.asarray(self.global_ - pose.shift - pose.scale * self.local @ pose.rotation.T)

    def start(self, sigmas: NDArray[np.float64]) -> _Pose:
        """Return the best of the poses found from headings all around, by sums of distances."""
        from scipy.spatial.transform import Rotation

        chosen = np.unique(np.linspace(0, len(self.local) - 1, MOST_AT_STARTS).astype(int))
        part, poses = self._replace(local=self.local[chosen], global_=self.global_[chosen]), list[_Pose]()
        for heading in np.arange(N_HEADINGS) * (2.0 * math.pi / N_HEADINGS):
            rotation = Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix()
            shift = np.median(part.global_ - part.local @ rotation.T, axis=0)
            poses.append(part.adjusted(_Pose(rotation, shift, 1.0), sigmas[chosen], "soft_l1", 1.0))
        return min(poses, key=lambda pose: float(np.linalg.norm(part.residuals(pose), axis=1).sum()))

    def normalized(
        self, unknowns: NDArray[np.float64], pose: _Pose, sigmas: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Residuals of a changed pose, and how far the map's z axis is from up, all in sigmas."""
        changed = pose.changed(unknowns)
        tilt = changed.rotation[:2, 2] / (self.level_sigma or math.inf)  # 0 where it is not known
        return np.append(self.residuals(changed) / sigmas, tilt)

    def adjusted(self, pose: _Pose, sigmas: NDArray[np.float64], loss: str, scale: float) -> _Pose:
        """Return a pose adjusted from another."""
        from scipy.optimize import least_squares

        begin = np.zeros(self.n_unknowns)
        found = least_squares(self.normalized, begin, loss=loss, f_scale=scale, x_scale="jac", args=(pose, sigmas))
        return pose.changed(found.x)

    def covariance(
        self, pose: _Pose, sigmas: NDArray[np.float64], is_fix: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], float, float]:
        """Covariance of the unknowns, how many fixes in a row err alike, and sigma of the places.

        A sandwich of Cauchy's influence (Huber 1981, section 7.6); errors of fixes are autoregressive. Of control
        points, too few to tell, the stated sigmas count, or their residuals where these are larger.
        """
        from scipy.optimize import approx_fprime

        sizes = self.residuals(pose) / sigmas
        weights = 1.0 / (1.0 + (sizes / CAUCHY) ** 2)
        influence, slopes = sizes * weights, (2.0 * weights - 1.0) * weights
        n_alike = _n_alike(influence[is_fix], np.abs(sizes[is_fix]).max(axis=1, initial=0.0) <= OUTLIER)
        n_free = max(sizes.size - self.n_unknowns, 1)
        factor = max(1.0, float((sizes[~is_fix] ** 2).sum()) / n_free)
        variances = np.where(is_fix[:, None], n_alike * influence**2 * sizes.size / n_free, factor)
        slopes[~is_fix] = 1.0
        jacobian = approx_fprime(np.zeros(self.n_unknowns), self.normalized, STEP, pose, sigmas)
        units = np.linalg.norm(jacobian, axis=0)
        scaled, ends = jacobian / units, np.ones(len(jacobian) - sizes.size)
        values, vectors = np.linalg.eigh(scaled.T @ (np.append(slopes, ends)[:, None] * scaled))
        inverse = (vectors / np.maximum(values, SINGULAR)) @ vectors.T
        middle = scaled.T @ (np.append(variances, ends)[:, None] * scaled)
        covariance = inverse @ middle @ inverse + UNKNOWN * vectors @ np.diag(values < SINGULAR) @ vectors.T
        moved = np.einsum("ni,ij,nj->n", scaled, covariance, scaled)[: sizes.size].reshape(-1, 3) * sigmas**2
        return covariance / np.outer(units, units), n_alike, math.sqrt(float(moved.mean(axis=0).max()))


def _n_alike(influence: NDArray[np.float64], are_good: NDArray[np.bool_]) -> float:
    """How many fixes in a row err alike, by those that are no outliers, (n, 3): as an autoregressive process does."""
    pairs = are_good[1:] & are_good[:-1]
    earlier, later = influence[:-1][pairs], influence[1:][pairs]
    n, total = len(earlier), float((earlier**2 + later**2).sum())
    if n < LEAST_FIXES or total == 0.0:
        return 1.0
    alike = 2.0 * float((earlier * later).sum()) / total
    alike += 2.0 * (1.0 + 3.0 * alike) / n  # what the adjustment took (Kendall 1954), of two unknowns for each axis
    alike = min(max(alike, 0.0), 1.0 - 2.0 / n)
    return (1.0 + alike) / (1.0 - alike)


def _check_determined(found: Georeference) -> None:
    variances, axes = np.linalg.eigh(found.covariance[3:6, 3:6])
    sigma, axis = math.sqrt(max(float(variances[-1]), 0.0)), axes[:, -1]
    if sigma <= LARGEST_ANGLE_SIGMA:
        return
    ends = np.concatenate([each.global_ for each in found.places])
    size, (x, y, _) = float(np.hypot(*np.ptp(found.local[:, :2], axis=0))), np.ptp(ends, axis=0)
    off = float(np.linalg.norm(found.residuals, axis=1).mean())
    if off > LARGEST_MISFIT * size and np.abs(found.residuals / found.sigmas).mean() > OUTLIER:
        raise OptionError(
            f"Expected the same places in the map and in the CRS, got some within {size:.4g} m in the map, {x:.4g} x"
            f" {y:.4g} m in the CRS, that lie {off:.3g} m apart in the mean at best. Are all in metres, east and north"
            " in their places?"
        )
    angle = math.degrees(math.atan2(axis[1], axis[0])) % 180.0
    turn = "heading" if abs(axis[2]) > 0.7 else f"roll about a line at {angle:.0f} degrees from east to north"
    known = f"{math.degrees(sigma):.2g} degrees only" if sigma < 1.0 else "no useful degree"
    raise OptionError(
        f"Expected places that determine how the map is turned, got some within {x:.0f} x {y:.0f} m from which its"
        f" {turn} is known to {known}. Add places off that line (a longer drive, --control), or say how level the map"
        " is (--level-sigma-deg)."
    )
