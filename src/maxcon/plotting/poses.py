# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses, and a drive with its errors, on the map from above."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike

from maxcon.errors import ArrayError
from maxcon.map import PointMap
from maxcon.plotting.figure import INK, MUTED, SERIES
from maxcon.plotting.from_above import Window, map_figure
from maxcon.scan.trajectory import Trajectory

# More arrows than this cover each other.
N_ARROWS = 60


def plot_poses(
    path: str | os.PathLike[str],
    poses: Trajectory,
    point_map: PointMap,
    *,
    prior: Trajectory | None = None,
    title: str = "Poses on the map",
) -> None:
    """Draw poses on the map from above, with their headings.

    - path: a .png or .svg to write.
    - poses: T_map_sensor, global coordinates in the CRS of the map, as `read_trajectory` reads them from POSES.csv.
    - point_map: drawn below, in grey.
    - prior: rough poses, likewise; drawn as a line.
    - title: written above.
    """
    places = point_map.frame.to_local(poses.positions)
    window = Window.with_room(places)
    words = f"{len(poses)} poses."
    with map_figure(path, window, point_map, (title, words)) as (figure, axes):
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
        figure.legend(loc="outside lower left", ncols=2)


def plot_drive(
    path: str | os.PathLike[str],
    positions: ArrayLike,
    errors: ArrayLike,
    *,
    point_map: PointMap | None = None,
    title: str = "The drive from above",
    success: float = 0.3,
) -> None:
    """Draw the drive from above, each epoch in the colour of its error.

    - path: a .png or .svg to write.
    - positions: shape (n, 2) or (n, 3); reference positions, local frame, m.
    - errors: shape (n,); distance of each estimate to the reference, m; NaN where it did not localize.
    - point_map: drawn below, in grey.
    - title: written above.
    - success: errors above it are drawn as failures, m.
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
    with map_figure(path, window, point_map, (title, words)) as (figure, axes):
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
        figure.legend(loc="outside lower left", ncols=3)
