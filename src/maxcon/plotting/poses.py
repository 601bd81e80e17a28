"""Poses, and a drive with its errors, on the map from above; residuals of a georeference."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.map import PointMap
from maxcon.plotting.figure import INK, MUTED, SERIES, Window, map_figure, saved_figure
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# More arrows than this cover each other.
N_ARROWS = 60


def plot_poses(
    path: str | os.PathLike[str] | None, poses: Trajectory, point_map: PointMap, *, prior: Trajectory | None = None,
    title: str = "Poses on the map", axes: Axes | None = None,
) -> Figure:  # fmt: skip
    """Draw poses on the map from above, with their headings.

    - path: a .png or .svg to write; None: only the figure is returned, as notebooks show it.
    - poses: T_map_sensor, global coordinates in the CRS of the map, as `read_trajectory` reads them from POSES.csv.
    - point_map: drawn below, in grey.
    - prior: rough poses, likewise; drawn as a line.
    - title: written above.
    - axes: matplotlib's, to draw on instead of a figure of its own; the figure that they are in is returned.
    """
    places = point_map.frame.to_local(poses.positions)
    window = Window.with_room(places)
    words = f"{len(poses)} poses."
    with map_figure(path, window, point_map, (title, words), axes=axes, legend_columns=2) as (figure, axes):
        if prior is not None:
            rough = point_map.frame.to_local(prior.positions)
            axes.plot(*rough[:, :2].T, color=SERIES[1], lw=1.4, zorder=3, label="prior")
        axes.plot(*places[:, :2].T, "o", color=SERIES[0], ms=4.5, mec="white", mew=0.6, zorder=5, label="poses")
        step = -(-len(places) // N_ARROWS)
        headings = poses.angles[::step, 2]
        axes.quiver(
            *places[::step, :2].T, np.cos(headings), np.sin(headings), color=INK, angles="xy", scale_units="xy",
            scale=18.0 / max(window.size), width=0.004, zorder=6,
        )  # fmt: skip
    return figure


def plot_drive(
    path: str | os.PathLike[str] | None, positions: ArrayLike, errors: ArrayLike, *, point_map: PointMap | None = None,
    title: str = "The drive from above", success: float = 0.3, axes: Axes | None = None,
) -> Figure:  # fmt: skip
    """Draw the drive from above, each epoch in the colour of its error.

    - path: a .png or .svg to write; None: only the figure is returned, as notebooks show it.
    - positions: shape (n, 2) or (n, 3); reference positions, local frame, m.
    - errors: shape (n,); distance of each estimate to the reference, m; NaN where it did not localize.
    - point_map: drawn below, in grey.
    - title: written above.
    - success: errors above it are drawn as failures, m.
    - axes: as of `plot_poses`.
    """
    places, values = np.asarray(positions, np.float64), np.asarray(errors, np.float64)
    if places.ndim != 2 or not len(places) or places.shape[1] not in (2, 3) or not np.isfinite(places).all():
        raise ArrayError(f"Expected `positions` to have shape (n, 2) or (n, 3), finite, got {places.shape}.")
    if values.shape != (len(places),):
        raise ArrayError(f"Expected `errors` to have shape ({len(places)},), got {values.shape}.")
    places = places[:, :2]
    is_good, is_missing = values <= success, np.isnan(values)
    words = f"{int(is_good.sum())} of {len(values)} epochs within {success:g} m of the reference."
    window = Window.with_room(places)
    with map_figure(path, window, point_map, (title, words), axes=axes, legend_columns=3) as (figure, axes):
        axes.plot(*places.T, color=MUTED, lw=1.0, zorder=3)
        colors = axes.scatter(
            places[is_good, 0], places[is_good, 1], c=values[is_good], cmap="viridis", vmin=0.0, vmax=success, s=42,
            edgecolors="black", linewidths=0.5, zorder=4, label=f"within {success:g} m",
        )  # fmt: skip
        is_wrong = ~is_good & ~is_missing
        axes.plot(
            *places[is_wrong].T, "D", ms=9, mfc=SERIES[1], mec="black", mew=0.8, zorder=5, label="farther: failed"
        )
        axes.plot(*places[is_missing].T, "x", ms=9, mec="black", mew=2.2, zorder=5, label="not localized")
        figure.colorbar(colors, ax=axes, label="error [m]")
    return figure


def plot_residuals(
    path: str | os.PathLike[str], places: NDArray[np.float64], residuals: NDArray[np.float64],
    are_outliers: NDArray[np.bool_], words: str,
) -> None:  # fmt: skip
    """Draw where places of a map differ from what was measured; outliers in another colour, and cut at the border.

    places, residuals: shape (n, 3); measured, in the CRS, and less the map's, m. words: a line below the title.
    """
    with saved_figure(path, 11.0, 6.0, "Residuals of the georeference", words) as figure:
        above, *rows = figure.subplot_mosaic([["above", "x"], ["above", "y"], ["above", "z"]]).values()
        inliers = places[~are_outliers]
        low, high = inliers.min(axis=0), inliers.max(axis=0)
        at, size = places - low, max(10.0, float((high - low)[:2].max()))
        usual = float(np.quantile(np.abs(residuals[~are_outliers]), 0.95)) or 1.0
        for chosen, colour, label in ((~are_outliers, SERIES[0], "residual"), (are_outliers, SERIES[1], "outlier")):
            arrows = np.clip(residuals[chosen, :2], -4.0 * usual, 4.0 * usual)
            above.quiver(
                *(at - residuals)[chosen, :2].T, *arrows.T, color=colour, angles="xy", scale_units="xy",
                scale=25.0 * usual / size, width=0.002, zorder=3,
            )  # fmt: skip
            for axis, name, values in zip(rows, ("east", "north", "up"), residuals.T, strict=True):
                axis.plot(np.flatnonzero(chosen), values[chosen], ".", color=colour, ms=3, label=label)
                axis.set_ylim(-5.0 * usual, 5.0 * usual)
                axis.set_ylabel(f"{name} [m]")
                axis.axhline(0.0, color=MUTED, lw=0.6)
        above.plot(*(at - residuals)[:, :2].T, ".", color=INK, ms=1.5)
        above.set_xlim(-0.1 * size, 1.1 * size)
        above.set_ylim(-0.1 * size, 1.1 * size)
        above.set_aspect("equal")
        above.set_xlabel(f"m east of {low[0]:.0f}; arrows of {usual:.2g} m are a 25th of the side")
        above.set_ylabel(f"m north of {low[1]:.0f}")
        rows[-1].set_xlabel("number of the fix or control point")
        rows[0].legend(loc="upper right", ncols=2)
