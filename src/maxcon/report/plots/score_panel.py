# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The scores of one heading as an image, with (0, 0) at the best cell or the reference, or on the map."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from maxcon.objectives import Scores
from maxcon.report.canvas.from_above import Window
from maxcon.report.plots.search_spaces import COLORS, SearchSpaceView
from maxcon.search_space import SearchSpace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D

__all__ = ["draw_scores", "ground_of", "offset_words", "put_mark", "scale_words", "score_words"]


def ground_of(space: SearchSpace, x: float, y: float) -> Window:
    """Return the ground that the cells of a heading cover, with the prior at (x, y), m."""
    low, high = (
        float(space.offsets[0]) - 0.5 * space.cell_edge,
        float(space.offsets[-1]) + 0.5 * space.cell_edge,
    )
    return Window(x + low, x + high, y + low, y + high)


def draw_scores(
    axes: "Axes", scores: Scores, ground: Window, norm: "Normalize", zorder: float = 1.0
) -> "AxesImage":
    """Draw the scores of a heading, shape (ny, nx), over the ground they cover; keep the axes' limits."""
    limits = axes.get_xlim(), axes.get_ylim()
    image = axes.imshow(
        np.ma.masked_invalid(scores),
        origin="lower",
        extent=ground,
        norm=norm,
        cmap=COLORS,
        interpolation="nearest",
        zorder=zorder,
    )
    axes.set(xlim=limits[0], ylim=limits[1])
    return image


def put_mark(axes: "Axes", mark: "Line2D", x: float, y: float) -> None:
    """Draw a mark at a place of the axes."""
    mark.set_data([x], [y])
    axes.add_line(mark)


def scale_words(views: Iterable[SearchSpaceView]) -> str:
    """Return the label of a colour scale from 0 to 1 that search spaces share, each from 0 to its own highest score."""
    if any(view.limits[0] < 0.0 for view in views):
        return "score, from the lowest (0) to the highest (1) of the square"
    return "score, over the highest of the square"


def score_words(score: float) -> str:
    """Return a score with four digits, or with all digits before the point."""
    words = f"{score:,.0f}" if abs(score) >= 1000.0 else f"{score:.4g}"
    return words.replace("-", "−")


def offset_words(offset: float) -> str:
    """Return an offset (m) to the centimetre, with a minus that is as wide as a digit, and none before 0."""
    return f"{round(offset, 2) + 0.0:.2f}".replace("-", "−")
