# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses on the map from above, with the prior they were found from."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maxcon.map import PointMap
from maxcon.plotting.canvas.figure import INK, SERIES, draw_titles, saved_figure
from maxcon.plotting.canvas.from_above import Window, draw_map, draw_scale_bar
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_poses"]

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

    Parameters
    ----------
    path : path
        A .png or .svg to write.
    poses : Trajectory
        T_map_sensor, global coordinates in the CRS of the map, as `read_trajectory` reads them from POSES.csv.
    point_map : PointMap
        Drawn below, in grey.
    prior : Trajectory, optional
        Rough poses, likewise; drawn as a line.
    title : str
        What is written above.

    Raises
    ------
    OptionError
        If the name of the picture ends in neither .png nor .svg.
    MissingExtraError
        If matplotlib is not installed.
    FileError
        If the file cannot be written.
    MapError
        If a tile of the map cannot be read.
    """
    places = point_map.frame.to_local(poses.positions)
    window = Window.with_room(places)
    side = 6.6 / max(window.size)
    drawn_width, drawn_height = window.size[0] * side, window.size[1] * side
    width, height = max(drawn_width + 1.2, 5.6), drawn_height + 2.1
    with saved_figure(path, width, height) as figure:
        east, north, _ = point_map.frame.origin
        of_map = f"Local frame: {east:.0f} m east and {north:.0f} m north are (0, 0)."
        draw_titles(figure, title, f"{len(poses)} poses. {of_map}")
        axes = figure.add_axes((0.85 / width, 0.95 / height, drawn_width / width, drawn_height / height))
        draw_map(axes, point_map, window)
        if prior is not None:
            rough = point_map.frame.to_local(prior.positions)
            axes.plot(*rough[:, :2].T, color=SERIES[1], lw=1.4, zorder=3, label="prior")
        _draw_arrows(axes, places, poses.angles[:, 2], max(window.size))
        draw_scale_bar(axes, window)
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.6 / width, 0.0), ncols=2)


def _draw_arrows(axes: Axes, places: NDArray[np.float64], headings: NDArray[np.float64], extent: float) -> None:
    """Draw all positions as dots, and at most `N_ARROWS` headings as arrows; `extent` of the picture, m."""
    axes.plot(*places[:, :2].T, "o", color=SERIES[0], ms=4.5, mec="white", mew=0.6, zorder=5, label="poses")
    step = -(-len(places) // N_ARROWS)
    axes.quiver(
        places[::step, 0],
        places[::step, 1],
        np.cos(headings[::step]),
        np.sin(headings[::step]),
        color=INK,
        angles="xy",
        scale_units="xy",
        scale=18.0 / extent,
        width=0.004,
        zorder=6,
    )
