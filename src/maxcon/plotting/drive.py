# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A drive from above, each epoch in the colour of its error."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.map import PointMap
from maxcon.plotting.canvas.figure import MUTED, SERIES, draw_titles, saved_figure
from maxcon.plotting.canvas.from_above import Window, as_places, draw_map, draw_scale_bar
from maxcon.plotting.canvas.method_style import as_epoch_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_drive"]


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

    Parameters
    ----------
    path : path
        A .png or .svg to write.
    positions : array_like, shape (n, 2) or (n, 3)
        Reference positions, local frame, m.
    errors : array_like, shape (n,)
        Distance of each estimate to the reference, m; NaN where it did not localize.
    point_map : PointMap, optional
        Drawn below, in grey.
    title : str
        What is written above.
    success : float
        Errors above it are drawn as failures, m.

    Raises
    ------
    ArrayError
        If there is no position, or positions and errors do not fit each other.
    OptionError
        If the name ends in neither .png nor .svg.
    MissingExtraError
        If matplotlib is not installed.
    FileError
        If the file cannot be written.
    """
    places = as_places(positions)
    values = as_epoch_values(errors, "`errors`", 0.0, n_epochs=len(places))
    window = Window.with_room(places)
    side = 6.6 / max(window.size)
    drawn_width, drawn_height = window.size[0] * side, window.size[1] * side
    width, height = max(drawn_width + 2.0, 5.6), drawn_height + 2.35
    with saved_figure(path, width, height) as figure:
        n_good = int((values <= success).sum())
        words = f"{n_good} of {len(values)} epochs within {success:g} m of the reference."
        draw_titles(figure, title, words)
        axes = figure.add_axes((0.85 / width, 1.2 / height, drawn_width / width, drawn_height / height))
        draw_map(axes, point_map, window)
        _draw_epochs(axes, places, values, success)
        draw_scale_bar(axes, window)
        bar = figure.add_axes(((1.0 + drawn_width) / width, 1.2 / height, 0.15 / width, drawn_height / height))
        figure.colorbar(axes.collections[0], cax=bar).set_label("error [m]")
        figure.legend(*axes.get_legend_handles_labels(), loc="lower left", bbox_to_anchor=(0.6 / width, 0.0), ncols=2)


def _draw_epochs(axes: Axes, places: NDArray[np.float64], errors: NDArray[np.float64], success: float) -> None:
    """Draw the drive as a line, epochs that succeeded in the colour of their error, and others with other marks."""
    axes.plot(*places.T, color=MUTED, lw=1.0, zorder=3)
    is_good, is_missing = errors <= success, np.isnan(errors)
    is_wrong = ~is_good & ~is_missing
    axes.scatter(
        places[is_good, 0],
        places[is_good, 1],
        c=errors[is_good],
        cmap="viridis",
        vmin=0.0,
        vmax=success,
        s=42,
        edgecolors="black",
        linewidths=0.5,
        zorder=4,
        label=f"within {success:g} m",
    )
    axes.plot(*places[is_wrong].T, "D", ms=9, mfc=SERIES[1], mec="black", mew=0.8, zorder=5, label="farther: failed")
    axes.plot(*places[is_missing].T, "x", ms=9, mec="black", mew=2.2, zorder=5, label="not localized")
