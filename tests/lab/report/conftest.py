# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Three walls with bumps, a scan of them, and the epoch they make."""

import struct
import xml.etree.ElementTree as ElementTree
from typing import NamedTuple

import numpy as np
import pytest

import maxcon

CELL = 0.06


class Epoch(NamedTuple):
    scan: maxcon.Scan
    point_map: maxcon.PointMap
    prior: maxcon.Pose
    reference: maxcon.Pose

    def accumulate(self, space):
        return maxcon.search.exhaustive(self.scan, self.point_map, self.prior, space)

    def conclude(self, space, objective=None):
        """Accumulator, objective and estimate, as `plot_epoch` takes them."""
        objective = objective or maxcon.Helmert()
        accumulator = self.accumulate(space)
        estimate = maxcon.MaximumConsensus(space, objective).conclude(accumulator, self.scan, self.point_map)
        return {"accumulator": accumulator, "objective": objective, "estimate": estimate}


def _walls(generator, n_points):
    """Points on two walls along x and one across, with normals towards the middle."""
    along, up = generator.uniform(-9.0, 9.0, n_points), generator.uniform(-1.0, 3.0, n_points)
    north = np.column_stack([along, np.full(n_points, 5.03), up])
    south = np.column_stack([along, np.full(n_points, -5.03), up])
    east = np.column_stack([np.full(n_points, 9.03), along * 5.0 / 9.0, up])
    normals = np.repeat([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], n_points, axis=0)
    return np.concatenate([north, south, east]), normals


@pytest.fixture(scope="session")
def epoch():
    generator = np.random.default_rng(5)
    point_map = maxcon.PointMap.from_points(*_walls(generator, 30_000), cell=CELL)
    points, normals = _walls(generator, 400)
    reference = maxcon.Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    prior = maxcon.Pose(-0.18, 0.24, 0.0, 0.0, 0.0, np.radians(-0.5))
    return Epoch(maxcon.Scan(points, normals), point_map, prior, reference)


@pytest.fixture(scope="session")
def space():
    return maxcon.SearchSpace(half_width=0.6, cell=CELL, heading_half_width_deg=1.0)


@pytest.fixture(scope="session")
def tiny_png(tmp_path_factory):
    from maxcon.lab.report import plot_errors

    path = tmp_path_factory.mktemp("picture") / "tiny.png"
    plot_errors(path, [0.0, 1.0], {"a": [0.1, 0.2]})
    return path


@pytest.fixture
def png_size():
    """Width and height of a PNG, pixels."""

    def read(path):
        head = path.read_bytes()[:24]
        assert head.startswith(b"\x89PNG\r\n\x1a\n")
        return struct.unpack(">II", head[16:24])

    return read


@pytest.fixture
def svg_root():
    """The root of an SVG, parsed."""

    def read(path):
        root = ElementTree.fromstring(path.read_bytes())
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        return root

    return read


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved, as they were drawn."""
    from matplotlib.figure import Figure

    figures = []
    save = Figure.savefig

    def keep(self, *args, **options):
        figures.append(self)
        save(self, *args, **options)

    monkeypatch.setattr(Figure, "savefig", keep)
    return figures
