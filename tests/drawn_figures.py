"""A yard of three walls, a scan of it, the epoch they make, and what is read from figures of it."""

import re
import struct
from functools import cache
from html import unescape
from typing import NamedTuple

import numpy as np

import maxcon

SPACE = maxcon.SearchSpace(half_width=0.6, cell=0.06, heading_half_width_deg=1.0)
HOSTILE = "<script> & $\\frac$"


class Epoch(NamedTuple):
    scan: maxcon.Scan
    point_map: maxcon.PointMap
    prior: maxcon.Pose
    reference: maxcon.Pose

    def accumulate(self, space=SPACE):
        return maxcon.search.exhaustive(self.scan, self.point_map, self.prior, space)

    def conclude(self, space=SPACE, objective=None):
        """All that `plot_epoch` and `plot_overview` take, but for titles."""
        objective = objective or maxcon.Helmert()
        accumulator = self.accumulate(space)
        estimate = maxcon.MaximumConsensus(space, objective).conclude(accumulator, self.scan, self.point_map)
        searched = {"accumulator": accumulator, "objective": objective, "estimate": estimate}
        return searched | {"scan": self.scan, "point_map": self.point_map}


def _walls(generator, n_points):
    """Points on two walls along x and one across, with normals towards the middle."""
    along, up = generator.uniform(-9.0, 9.0, n_points), generator.uniform(-1.0, 3.0, n_points)
    north = np.column_stack([along, np.full(n_points, 5.03), up])
    south = np.column_stack([along, np.full(n_points, -5.03), up])
    east = np.column_stack([np.full(n_points, 9.03), along * 5.0 / 9.0, up])
    normals = np.repeat([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], n_points, axis=0)
    return np.concatenate([north, south, east]), normals


@cache
def yard():
    """The epoch, with the prior 0.18 m west and 0.24 m north of the reference, and turned by -0.5 degrees."""
    generator = np.random.default_rng(5)
    point_map = maxcon.PointMap.from_points(*_walls(generator, 30_000), cell=SPACE.cell_edge)
    points, normals = _walls(generator, 400)
    reference = maxcon.Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    prior = maxcon.Pose(-0.18, 0.24, 0.0, 0.0, 0.0, np.radians(-0.5))
    return Epoch(maxcon.Scan(points, normals), point_map, prior, reference)


@cache
def parts():
    """`yard().conclude()`, made once."""
    return yard().conclude()


class BelowZero:
    """An objective with negative scores, without title and unit, and with the longest words below its colour scale."""

    def score(self, moments):
        return moments[..., 0] - 3.0


def undrawn(monkeypatch):
    """From here on figures are saved empty, and not laid out, which takes its time: of tests of what is beside them."""
    monkeypatch.setattr("maxcon.plotting.figure._keep_layout", lambda figure: None)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, path, **_: path.write_text("<svg/>"))


def words(path):
    """What is written in an SVG: each text is named in a comment before its outlines."""
    return [unescape(text) for text in re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"), flags=re.S)]


def png_size(path):
    """Width and height of a PNG, pixels."""
    head = path.read_bytes()[:24]
    assert head.startswith(b"\x89PNG\r\n\x1a\n")
    return struct.unpack(">II", head[16:24])


def assert_all_fits(figure, *, panels_apart=True):
    """Nothing in a figure is cut off at its edge, no words lie on others or on panels, nor panels on each other."""
    renderer = figure.canvas.get_renderer()
    boxes = {text.get_text(): text.get_window_extent(renderer) for text in figure.texts}
    boxes |= {f"legend {n}": legend.get_window_extent(renderer) for n, legend in enumerate(figure.legends)}
    # With ticks, labels and titles.
    boxes |= {f"panel {n}": axes.get_tightbbox(renderer) for n, axes in enumerate(figure.axes)}
    names = list(boxes)
    for number, name in enumerate(names):
        box = boxes[name]
        assert min(box.x0, box.y0) >= 0.0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, name
        for other in names[:number]:
            if panels_apart or not name.startswith("panel") or not other.startswith("panel"):
                assert not box.overlaps(boxes[other]), (name, other)
