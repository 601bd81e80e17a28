# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The common style of all figures, and their files (same input, same bytes)."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maxcon._system.atomic import atomic_file
from maxcon.errors import OptionError, needs_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, MUTED = "#1f2430", "#5b6270"
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of things that stand side by side; told apart by colour-blind readers too (Okabe and Ito)."""

DOTS_PER_INCH = 120
# Set over matplotlib's own defaults, so that no settings of the user's change what a figure shows.
_STYLE: dict[Any, Any] = {
    "axes.edgecolor": MUTED, "axes.labelcolor": INK, "axes.labelsize": 10.5, "axes.linewidth": 0.8,
    "axes.titlecolor": INK, "axes.titlesize": 11, "figure.dpi": DOTS_PER_INCH, "font.family": "DejaVu Sans",
    "legend.fontsize": 10, "legend.frameon": False, "savefig.dpi": DOTS_PER_INCH, "svg.fonttype": "path",
    "svg.hashsalt": "maxcon", "text.color": INK, "xtick.color": MUTED, "xtick.labelsize": 9.5, "ytick.color": MUTED,
    "ytick.labelsize": 9.5,
}  # fmt: skip
_METADATA: dict[str, dict[str, Any]] = {"png": {"Software": None}, "svg": {"Date": None, "Creator": None}}


def check_matplotlib() -> None:
    """Raise a MissingExtraError if matplotlib is not installed, before the work whose result it is to draw."""
    with needs_extra("matplotlib", "to draw pictures", "demo"):
        import matplotlib  # noqa: F401


@contextmanager
def saved_figure(
    path: str | os.PathLike[str], width: float, height: float, title: str, lines: str
) -> Iterator["Figure"]:
    """Yield a figure of some inches to draw on, with a title; it is written to `path` when the block ends well.

    path: ends in .png, of 120 pixels to the inch, or .svg.
    title, lines: written at the top left; a $ in them begins no formula.

    Axes and outer legends share the room below the title by themselves.
    """
    kind = Path(path).suffix.lower().removeprefix(".")
    if kind not in _METADATA:
        raise OptionError(f"Expected the name of a picture to end in .png or .svg, got {os.fspath(path)!r}. Rename it.")
    check_matplotlib()
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(width, height), facecolor="white")
        FigureCanvasAgg(figure)
        left, top = 0.3 / width, 1.0 - 0.16 / height
        figure.text(left, top, title, fontsize=15, fontweight="bold", va="top", parse_math=False)
        figure.text(left, top - 0.34 / height, lines, fontsize=11, va="top", linespacing=1.35, parse_math=False)
        top_of_axes = 1.0 - (0.62 + 0.2 * (1 + lines.count("\n"))) / height
        rect = (0.12 / width, 0.06 / height, 1.0 - 0.3 / width, top_of_axes - 0.06 / height)
        figure.set_layout_engine("constrained", rect=rect, w_pad=0.08, h_pad=0.06)
        yield figure
        _keep_layout(figure)
        with atomic_file(path) as partial:
            figure.savefig(partial, format=kind, metadata=_METADATA[kind])


def _keep_layout(figure: "Figure") -> None:
    """Lay the axes out, and round where they and parts lie: the last bits differ from one call to the next."""
    from matplotlib.transforms import Bbox

    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for part in figure.subfigs:
        part.bbox_relative.set_points(part.bbox_relative.get_points().round(6))
    for axes in figure.axes:
        axes.set_position(Bbox(axes.get_position(original=True).get_points().round(6)))
