# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One epoch from above: the map, the scan at the prior and at the answer, and which points agree."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.plotting.canvas.figure import INK
from maxcon.plotting.canvas.from_above import Window, draw_map, draw_scale_bar, map_patch
from maxcon.scan import Scan
from maxcon.search import consensus_set
from maxcon.search.space import SearchSpace

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

__all__ = ["Scene", "draw_points", "draw_scene", "half_width_of", "is_off_the_ground"]

PRIOR_COLOR, SCAN_COLOR, CONSENSUS_COLOR = "#d55e00", "#56b4e9", "#00468b"
# Horizontal part of a normal above which a surface is no ground: it is inclined by 30 degrees.
STANDING_NORMAL = 0.5
# Points without a normal are drawn from this height above ground on, m: kerbs and the crown of the road are lower.
ABOVE_GROUND = 0.4
# Farther points are few, and would make the street too small to see the search space in it.
MOST_HALF_WIDTH, LEAST_HALF_WIDTH = 45.0, 5.0
ONE_CELL = SearchSpace(half_width=0.0, heading_half_width_deg=0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn of one epoch; poses and points in the local frame, the scan in the sensor frame."""

    scan: Scan
    point_map: PointMap
    prior: Pose
    space: SearchSpace
    estimate: Estimate
    reference: Pose | None = None

    @property
    def has_answer(self) -> bool:
        """Whether anything matched at all."""
        return self.estimate.status is not Status.NO_MATCH

    @property
    def is_matched(self) -> NDArray[np.bool_]:
        """Whether each scan point falls in a voxel of the map at the best cell, or else at the answer, shape (n,)."""
        if not self.has_answer:
            return np.zeros(len(self.scan), bool)
        if self.estimate.cell is not None:
            return consensus_set(self.scan, self.point_map, self.prior, self.space, self.estimate.cell)
        return consensus_set(self.scan, self.point_map, self.estimate.pose, ONE_CELL, (0, 0, 0))

    @property
    def is_drawn(self) -> NDArray[np.bool_]:
        """Whether each scan point is drawn, shape (n,): not those on level ground."""
        return is_off_the_ground(self.scan, self.prior)

    @property
    def window(self) -> Window:
        """The square around the prior that holds nine tenths of the scan, within limits."""
        half_width = max(half_width_of(self.scan, MOST_HALF_WIDTH), 1.25 * self.space.reach)
        return Window.around(self.prior.x, self.prior.y, half_width)


def half_width_of(scan: Scan, most: float) -> float:
    """Half width, m, of the square around the sensor that holds 92 of 100 points of a scan: from 5 m to `most`."""
    ranges = np.abs(scan.points[:, :2]).max(axis=1, initial=0.0)
    half_width = float(np.percentile(ranges, 92)) if len(ranges) else 0.0
    return min(max(half_width, LEAST_HALF_WIDTH), most)


def is_off_the_ground(scan: Scan, pose: Pose) -> NDArray[np.bool_]:
    """Whether each scan point is drawn from above, shape (n,): not those that lie, or may lie, on level ground.

    Points without a normal are drawn if they are higher than the level surfaces below the sensor; all are, if no point
    lies on such a surface.
    """
    normals, heights = scan.normals @ pose.rotation.T, scan.points @ pose.rotation[2]
    has_normal = normals.any(axis=1)
    is_standing = np.hypot(normals[:, 0], normals[:, 1]) > STANDING_NORMAL
    is_ground = has_normal & ~is_standing & (heights < 0.0)
    ground = float(np.median(heights[is_ground])) if is_ground.any() else -np.inf
    return np.asarray(is_standing | (~has_normal & (heights > ground + ABOVE_GROUND)))


def draw_scene(axes: "Axes", scene: Scene) -> list["Artist"]:
    """Draw the scene from above; return what its legend shows, in order."""
    window = scene.window
    draw_map(axes, scene.point_map, window)
    handles: list[Artist] = [map_patch()]
    handles += _draw_scans(axes, scene)
    handles += _draw_start(axes, scene)
    handles += _draw_answer(axes, scene, arrow=0.16 * window.size[0])
    draw_scale_bar(axes, window)
    axes.set_title("From above (scan without level ground)", loc="left")
    return handles


def _draw_scans(axes: "Axes", scene: Scene) -> list["Artist"]:
    """Draw the scan at the prior and, if anything matched, at the answer."""
    is_drawn = scene.is_drawn
    sets = [("scan at the prior", PRIOR_COLOR, scene.prior.apply(scene.scan.points[is_drawn]), 1.3)]
    if scene.has_answer:
        points, is_matched = scene.estimate.pose.apply(scene.scan.points), scene.is_matched
        sets.append(("scan at the answer", SCAN_COLOR, points[~is_matched & is_drawn], 1.3))
        sets.append((f"consensus set ({is_matched.sum():,} points)", CONSENSUS_COLOR, points[is_matched], 2.0))
    return draw_points(axes, sets)


def draw_points(axes: "Axes", sets: Sequence[tuple[str, str, NDArray[np.float64], float]]) -> list["Artist"]:
    """Draw sets of points from above, one over the other; return what the legend shows of them.

    sets : label, colour, points of shape (n, 3), local frame, m, and diameter of a dot, points.
    """
    from matplotlib.lines import Line2D

    handles: list[Artist] = []
    for number, (label, color, points, size) in enumerate(sets):
        style: dict[str, Any] = {"ls": "", "marker": "o", "mew": 0, "color": color}
        axes.plot(*points[:, :2].T, ms=size, zorder=2 + number, rasterized=True, **style)
        handles.append(Line2D([], [], ms=7, label=label, **style))
    return handles


def _draw_start(axes: "Axes", scene: Scene) -> list["Artist"]:
    """Draw the prior and the square of the search space around it."""
    from matplotlib.patches import Rectangle

    prior, half = scene.prior, scene.space.reach
    corner, edge = (prior.x - half, prior.y - half), 2.0 * half
    square = Rectangle(corner, edge, edge, fill=False, ec="black", lw=1.3, label="search space", zorder=6)
    axes.add_patch(square)
    mark = {"marker": "X", "ms": 9, "mfc": PRIOR_COLOR, "mec": "white", "mew": 1.0}
    return [square, *_draw_mark(axes, prior, "prior", mark)]


def _draw_answer(axes: "Axes", scene: Scene, arrow: float) -> list["Artist"]:
    """Draw the sensor with its heading, if anything matched, and the reference, if there is one."""
    handles: list[Artist] = []
    pose = scene.estimate.pose
    if scene.has_answer:
        tip = (pose.x + arrow * math.cos(pose.heading), pose.y + arrow * math.sin(pose.heading))
        line = {"arrowstyle": "-|>", "color": INK, "lw": 2.0, "shrinkA": 0.0}
        axes.annotate("", tip, (pose.x, pose.y), arrowprops=line, zorder=7)
        mark = {"marker": "o", "ms": 8, "mfc": "#f0e442", "mec": "black", "mew": 1.0}
        handles += _draw_mark(axes, pose, "sensor and heading", mark)
    if scene.reference is not None:
        handles += _draw_mark(axes, scene.reference, "reference", {"marker": "+", "ms": 15, "mec": "black", "mew": 1.4})
    return handles


def _draw_mark(axes: "Axes", pose: Pose, label: str, style: dict[str, Any]) -> list["Line2D"]:
    return axes.plot(pose.x, pose.y, ls="", label=label, zorder=8, **style)
