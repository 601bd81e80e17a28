"""The common style of all figures, and their files (same input, same bytes); the map from above, in greys."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import OptionError, needs_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    from maxcon.map import PointMap

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
    path: str | os.PathLike[str] | None, width: float, height: float, title: str, lines: str
) -> Iterator["Figure"]:
    """Yield a figure of some inches to draw on, with a title; it is written to `path` when the block ends well.

    path: ends in .png, of 120 pixels to the inch, or .svg; None: not written.
    title, lines: written at the top left; a $ in them begins no formula.

    Axes and outer legends share the room below the title by themselves.
    """
    kind = "" if path is None else Path(path).suffix.lower().removeprefix(".")
    if path is not None and kind not in _METADATA:
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
        if path is None:
            return
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


# Squares along the longer side of a window; finer ones than a picture's pixels would only make it larger.
N_SQUARES = 700


class Window(NamedTuple):
    """A rectangle of the ground, local frame, m."""

    west: float
    east: float
    south: float
    north: float

    @classmethod
    def around(cls, x: float, y: float, half_width: float) -> "Window":
        """Return the square around a place."""
        return cls(x - half_width, x + half_width, y - half_width, y + half_width)

    @classmethod
    def with_room(cls, places: NDArray[np.float64]) -> "Window":
        """Return the rectangle around places, (n, 2 or more), m, and 25 m more, at most three times as long as wide."""
        low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
        center, half = 0.5 * (low + high), 0.5 * (high - low) + 25.0
        half = np.maximum(half, half.max() / 3.0)
        return cls(center[0] - half[0], center[0] + half[0], center[1] - half[1], center[1] + half[1])

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m."""
        return self.east - self.west, self.north - self.south


def count_voxels(point_map: "PointMap", window: Window) -> tuple[Window, NDArray[np.int64]]:
    """Count the voxels of a map above each square of the ground, shape (ny, nx), south to north, west to east.

    Returned with the window that the squares cover, which may be a little larger than the one asked for.
    """
    width, height = window.size
    edge = max(point_map.cell, max(width, height) / N_SQUARES)
    nx, ny = max(1, int(np.ceil(width / edge))), max(1, int(np.ceil(height / edge)))
    n_voxels = np.zeros(ny * nx, np.int64)
    center_x, center_y = window.west + 0.5 * width, window.south + 0.5 * height
    for tile in point_map.tiles_within(center_x, center_y, 0.5 * max(width, height)):
        centers = (tile.voxels[:, :2] + 0.5) * point_map.cell
        squares = np.floor((centers - [window.west, window.south]) / edge).astype(np.int64)
        is_inside = ((squares >= 0) & (squares < [nx, ny])).all(axis=1)
        x, y = squares[is_inside].T
        n_voxels += np.bincount(y * nx + x, minlength=ny * nx)
    covered = Window(window.west, window.west + nx * edge, window.south, window.south + ny * edge)
    return covered, n_voxels.reshape(ny, nx)


def draw_map(axes: "Axes", point_map: "PointMap | None", window: Window) -> None:
    """Draw the map, if there is one, in light greys; fix the axes to the window, equal, and say where they begin."""
    if point_map is not None:
        covered, n_voxels = count_voxels(point_map, window)
        top = max(2.0, float(np.percentile(n_voxels[n_voxels > 0], 95))) if n_voxels.any() else 2.0
        shades = 0.28 + 0.72 * np.clip(np.log1p(n_voxels) / np.log1p(top), 0.0, 1.0)
        axes.imshow(
            np.ma.masked_where(n_voxels == 0, shades), origin="lower", extent=covered, cmap="Greys", vmin=0.0, vmax=1.9,
            interpolation="nearest", zorder=0,
        )  # fmt: skip
    axes.set_xlim(window.west, window.east)
    axes.set_ylim(window.south, window.north)
    axes.set_aspect("equal")
    east, north = (0.0, 0.0) if point_map is None else point_map.frame.origin[:2]
    axes.set_xlabel(f"x [m] from {east:.0f} m east" if east else "x [m]")
    axes.set_ylabel(f"y [m] from {north:.0f} m north" if north else "y [m]")


def map_patch() -> "Patch":
    """Return what stands for the map in a legend."""
    from matplotlib.patches import Patch

    return Patch(facecolor="#a9a9a9", label="map (darker: taller)")


def draw_scale_bar(axes: "Axes", window: Window) -> None:
    """Draw a bar of a round length, about a sixth of the window, in its lower left corner."""
    from matplotlib.patches import Rectangle

    width, height = window.size
    length = round_length(width / 6.0)
    margin, thick = 0.02 * width, 0.006 * height
    x, y = window.west + 1.6 * margin, window.south + 0.025 * height
    corner, size = (x - margin, y - 1.6 * thick), (length + 2.0 * margin, 0.065 * height)
    axes.add_patch(Rectangle(corner, *size, facecolor="white", alpha=0.85, edgecolor="none", zorder=8))
    axes.add_patch(Rectangle((x, y), length, thick, facecolor="black", edgecolor="none", zorder=9))
    axes.text(x + 0.5 * length, y + 2.0 * thick, f"{length:g} m", ha="center", va="bottom", fontsize=9.5, zorder=9)


def round_length(length: float) -> float:
    """Return the longest of 1, 2 and 5 times a power of ten that is not above `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= length * (1.0 + 1e-9)))


SIDE = 6.6  # longer side of a map that fills a figure, inches


@contextmanager
def map_figure(
    path: str | os.PathLike[str] | None, window: Window, point_map: "PointMap | None", titles: tuple[str, str],
    side: float = SIDE, axes: "Axes | None" = None, legend_columns: int = 0,
) -> Iterator[tuple["Figure", "Axes"]]:  # fmt: skip
    """Yield a figure with the map of a window, its longer side about so many inches, and its axes.

    axes: the user's own to draw on instead, in the user's style; nothing is written. legend_columns: 0 for no legend.
    """
    if axes is not None:
        if path is not None:
            raise OptionError("Expected either a path or axes, got both. Give None as path, and save your own figure.")
        draw_map(axes, point_map, window)
        axes.set_title(titles[0], loc="left", parse_math=False)
        yield axes.figure, axes  # type: ignore[misc]  # of a subfigure the same may be asked
        draw_scale_bar(axes, window)
        axes.legend()
        return
    width, height = (side * length / max(window.size) for length in window.size)
    with saved_figure(path, max(width + 2.2, 7.4), height + 2.4, *titles) as figure:
        axes = figure.subplots()
        draw_map(axes, point_map, window)
        yield figure, axes
        draw_scale_bar(axes, window)
        if legend_columns:
            figure.legend(loc="outside lower left", ncols=legend_columns)
