# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Residuals of a georeference: from above, and one after the other."""

import os

import numpy as np
from numpy.typing import NDArray

from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure


def plot_residuals(
    path: str | os.PathLike[str],
    places: NDArray[np.float64],
    residuals: NDArray[np.float64],
    are_outliers: NDArray[np.bool_],
    words: str,
) -> None:
    """Draw where places of a map differ from what was measured.

    - path: a .png or .svg to write.
    - places, residuals: shape (n, 3); measured, in the CRS, and less the map's, m.
    - are_outliers: shape (n,); drawn in another colour, and cut at the border.
    - words: a line below the title.
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
