"""Scores of a search space: which headings are drawn, one heading as an image, its marks, scale and words."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from maxcon.geometry import Pose, wrap_angle
from maxcon.plotting.figure import Window
from maxcon.search.accumulator import Accumulator, highest
from maxcon.search.objectives import Objective, Scores
from maxcon.search.space import Cell, SearchSpace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D

COLORS = "plasma"  # from cold blue to warm yellow, in steps that are even to every eye, and in grey print
COLOR_POWER = 0.5  # exponent of the colour scale: on a linear one all but the peak of Helmert's score is dark


@dataclass(frozen=True, eq=False)
class SearchSpaceView:
    """An accumulator, scored by an objective; `title` is that of its panel, the objective's if empty."""

    accumulator: Accumulator
    objective: Objective
    title: str = ""

    @property
    def space(self) -> SearchSpace:
        """The cells."""
        return self.accumulator.space

    @cached_property
    def scores(self) -> Scores:
        """Score of every cell, shape (headings, ny, nx)."""
        return self.accumulator.score(self.objective)

    @cached_property
    def best(self) -> Cell:
        """The cell with the highest score."""
        return highest(self.scores)

    @property
    def has_best(self) -> bool:
        """Whether any cell scores higher than another."""
        return bool(self.scores[self.best] > self.scores.min())

    @property
    def best_offset(self) -> tuple[float, float]:
        """Offset (x, y) of the best cell from the prior, m."""
        _, iy, ix = self.best
        return float(self.space.offsets[ix]), float(self.space.offsets[iy])

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Scores at the ends of the colour scale: 0 (or the lowest, if negative) and the highest."""
        finite = self.scores[np.isfinite(self.scores)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        low = min(low, 0.0)
        return low, high if high > low else low + 1.0

    @property
    def norm(self) -> "Normalize":
        """The colour scale: the root of the score."""
        from matplotlib.colors import PowerNorm

        return PowerNorm(COLOR_POWER, *self.limits)

    def offset(self, pose: Pose) -> tuple[float, float]:
        """Offset (x, y) of a pose from the prior, m."""
        return pose.x - self.accumulator.prior.x, pose.y - self.accumulator.prior.y

    def heading_nearest(self, pose: Pose, among: Sequence[int]) -> int:
        """Return the index, of those `among`, of the heading nearest to that of a pose."""
        turns = self.space.headings
        turn = wrap_angle(pose.heading - self.accumulator.prior.heading)
        return min(among, key=lambda heading: abs(float(turns[heading]) - turn))


def chosen_headings(n_headings: int, best: int, limit: int = 9) -> list[int]:
    """Return indices of at most `limit` headings, evenly and as widely spaced as fits, with the best among them."""
    widest = max(1, (n_headings - 1) // max(1, limit - 1))
    for step in range(widest, 0, -1):
        chosen = range(best % step, n_headings, step)
        if len(chosen) >= limit:
            break
    return sorted(sorted(chosen, key=lambda heading: abs(heading - best))[:limit])


def title_of(objective: Objective) -> str:
    """Return the title of an objective, or the name of its class if a user's own has none."""
    return str(getattr(objective, "title", type(objective).__name__))


def unit_of(objective: Objective) -> str:
    """Return the unit of an objective's scores, or "score" if it states none."""
    return str(getattr(objective, "unit", "score"))


def ground_of(space: SearchSpace, x: float, y: float) -> Window:
    """Return the ground that the cells of a heading cover, with the prior at (x, y), m."""
    low, high = (float(space.offsets[0]) - 0.5 * space.cell_edge, float(space.offsets[-1]) + 0.5 * space.cell_edge)
    return Window(x + low, x + high, y + low, y + high)


def draw_scores(axes: "Axes", scores: Scores, ground: Window, norm: "Normalize", zorder: float = 1.0) -> "AxesImage":
    """Draw the scores of a heading, shape (ny, nx), over the ground they cover; keep the axes' limits."""
    limits = axes.get_xlim(), axes.get_ylim()
    image = axes.imshow(
        np.ma.masked_invalid(scores), origin="lower", extent=ground, norm=norm, cmap=COLORS, interpolation="nearest",
        zorder=zorder,
    )  # fmt: skip
    axes.set(xlim=limits[0], ylim=limits[1])
    return image


def cell_marks() -> tuple["Line2D", "Line2D"]:
    """Return the marks of the best cell and of the reference: for a panel and for the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke

    best = Line2D([], [], ls="", marker="o", ms=14, mfc="none", mec="white", mew=1.6, label="best cell")
    reference = Line2D([], [], ls="", marker="D", ms=16, mfc="none", mec="#7fffd4", mew=1.4, label="reference")
    for mark in (best, reference):
        mark.set_clip_on(False)
        mark.set_zorder(5)
        mark.set_path_effects([withStroke(linewidth=3.2, foreground="black")])
    return best, reference


def put_mark(axes: "Axes", mark: "Line2D", x: float, y: float) -> None:
    """Draw a mark at a place of the axes."""
    mark.set_data([x], [y])
    axes.add_line(mark)


def turn_words(space: SearchSpace, heading: int) -> str:
    """Return the turn of a heading from the prior's, in degrees."""
    turn_deg = math.degrees(float(space.headings[heading]))
    return f"{turn_deg:+.3g}°".replace("-", "−") if turn_deg else "0°"


def score_words(score: float) -> str:
    """Return a score with four digits, or with all digits before the point."""
    words = f"{score:,.0f}" if abs(score) >= 1000.0 else f"{score:.4g}"
    return words.replace("-", "−")
