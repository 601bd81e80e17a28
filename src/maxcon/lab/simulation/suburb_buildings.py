"""Houses, sheds and fences of the suburb."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation.facades import rain_pipe, relief, steps
from maxcon.lab.simulation.furniture import LasClass, Patch, boxes, grid_faces, join, leaves_at, quads, triangles
from maxcon.lab.simulation.suburb_ground import draw_ivy

FOOT = -1.5  # lower edge of walls, m, below the ground at the origin, so that no house floats on a slope
STOREY = 2.8
CELL = 0.4  # edge of the cells of a wall, each with a depth of its own, m

Window = tuple[float, float, float, float]  # left, right, lower and upper border of a window or door, m


CLADDINGS = ("plaster", "brick", "boards")
"""What a wall is made of, and so how its surface departs from a plane, by centimetres."""


def _depths(cladding: str, n_columns: int, n_rows: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw the depths of the cells of a wall behind its plane, shape (n_columns, n_rows), m."""
    if cladding == "boards":
        rows = 0.012 * (-1.0) ** np.arange(n_rows) + 0.008 * rng.standard_normal(n_rows)
        return np.asarray(rows + 0.003 * rng.standard_normal((n_columns, n_rows)))
    return (0.006 if cladding == "plaster" else 0.015) * rng.standard_normal((n_columns, n_rows))


def _rough_wall(length: float, height: float, windows: list[Window], cladding: str, rng: np.random.Generator) -> Patch:
    """Return a wall along x, from `FOOT` up to `height` (m), with windows behind it and sills before it."""
    x_edges = _edges(0.0, length, [x for window in windows for x in window[:2]])
    z_edges = np.concatenate([[FOOT], _edges(0.0, height, [z for window in windows for z in window[2:]])])
    depths = _depths(cladding, len(x_edges) - 1, len(z_edges) - 1, rng)
    x, z = 0.5 * (x_edges[1:] + x_edges[:-1]), 0.5 * (z_edges[1:] + z_edges[:-1])
    lows, highs = [], []
    for left, right, low, high in windows:
        is_inside = np.outer((x > left) & (x < right), (z > low) & (z < high))
        # Light goes through the glass and comes back from curtains, plants and furniture.
        n = is_inside.sum()
        depths[is_inside] = rng.uniform(0.08, 0.2) + np.where(rng.random(n) < 0.5, rng.exponential(0.3, n), 0.0)
        if low > 0.3:
            lows.append([left - 0.05, 0.0, low - 0.06])
            highs.append([right + 0.05, rng.uniform(0.05, 0.15), low])
    wall = relief(x_edges, z_edges, depths)
    return join([wall, boxes(lows, highs, LasClass.BUILDING)]) if lows else wall


def draw_house(rng: np.random.Generator, day: np.random.Generator) -> tuple[Patch, float, float]:
    """Return a house, its width along the front and its depth, m; only ivy depends on the `day`."""
    width, depth = rng.uniform(8.0, 12.5), rng.uniform(7.0, 10.0)
    height = STOREY * (1 if rng.random() < 0.6 else 2) + rng.uniform(0.1, 0.6)
    cladding = CLADDINGS[rng.integers(3)]
    gable_in_front = bool(rng.random() < 0.4)
    parts = [
        _around(width, depth, height, cladding, rng, n_storeys=int(height / STOREY)),
        _gabled_roof(width, depth, height, rng, gable_in_front=gable_in_front),
        rain_pipe(0.15 if rng.random() < 0.5 else width - 0.15, height),
    ]
    door = rng.uniform(1.5, width - 1.5)
    parts.append(steps(door))
    if rng.random() < 0.6:
        # A roof on two posts.
        out, half, top = rng.uniform(1.0, 1.8), rng.uniform(0.9, 1.6), rng.uniform(2.3, 2.6)
        lows = [[door - half, 0.0, top], [door - half, out - 0.12, FOOT], [door + half - 0.12, out - 0.12, FOOT]]
        highs = [[door + half, out, top + 0.15], [door - half + 0.12, out, top], [door + half, out, top]]
        parts.append(boxes(lows, highs, LasClass.BUILDING))
    if rng.random() < 0.25:
        start, span = rng.uniform(0.0, 0.5 * width), rng.uniform(1.5, 0.5 * width)
        parts.append(draw_ivy(span, rng.uniform(1.5, height), rng, day).placed(start, 0.0))
    if rng.random() < 0.4:
        # A bay with a flat roof before the ground floor.
        start, out, span = rng.uniform(0.5, width - 3.5), rng.uniform(0.5, 1.2), rng.uniform(2.0, 3.0)
        lows = [[start, 0.0, FOOT], [start - 0.1, 0.0, 2.4]]
        highs = [[start + span, out, 2.4], [start + span + 0.1, out + 0.15, 2.5]]
        parts.append(boxes(lows, highs, LasClass.BUILDING))
    chimney = rng.uniform(0.3, 0.7, 2) * np.array([width, -depth])
    lows, highs = [[*(chimney - 0.3), height]], [[*(chimney + 0.3), height + 0.45 * depth + 0.6]]
    parts.append(boxes(lows, highs, LasClass.BUILDING))
    return join(parts), width, depth


def draw_shed(rng: np.random.Generator, *, is_garage: bool) -> Patch:
    """Return a garage, or a smaller shed of boards, with its door in front."""
    width, depth = (rng.uniform(2.8, 3.4), rng.uniform(5.2, 6.5)) if is_garage else rng.uniform(1.8, 3.0, 2)
    height = rng.uniform(2.3, 2.7)
    cladding = CLADDINGS[rng.integers(3)] if is_garage else "boards"
    door = (0.3, width - 0.3, 0.0, 2.1) if is_garage else (0.4, 1.2, 0.0, 1.9)
    walls = _around(width, depth, height, cladding, rng, n_storeys=0, door=door)
    roof = boxes([[-0.2, -depth - 0.2, height]], [[width + 0.2, 0.2, height + 0.15]], LasClass.BUILDING)
    return join([walls, roof])


def _edges(low: float, high: float, between: list[float]) -> NDArray[np.float64]:
    """Edges of cells from `low` to `high`, with all of `between` among them, at most about `CELL` apart, m."""
    fixed = np.unique(np.clip([low, high, *between], low, high).round(3))
    runs = [np.linspace(a, b, max(1, round((b - a) / CELL)), endpoint=False) for a, b in pairwise(fixed)]
    return np.concatenate([*runs, [high]])


def _around(
    width: float, depth: float, height: float, cladding: str, rng: np.random.Generator, *, n_storeys: int,
    door: Window | None = None,
) -> Patch:  # fmt: skip
    """Four walls with different windows; the front has the door, too."""
    walls: list[Patch] = []
    for x, y, heading, length in (
        (0.0, 0.0, 0.0, width),
        (0.0, -depth, 0.5 * math.pi, depth),
        (width, 0.0, -0.5 * math.pi, depth),
        (width, -depth, math.pi, width),
    ):
        windows = _draw_windows(length, n_storeys, rng)
        if door is not None and not walls:
            windows.append(door)
        wall = _rough_wall(length, height, windows, cladding, rng)
        walls.append(wall.placed(x, y, heading=heading))
    return join(walls)


def _draw_windows(length: float, n_storeys: int, rng: np.random.Generator) -> list[Window]:
    """Draw the windows of one wall: a few per storey."""
    windows: list[Window] = []
    for storey in range(n_storeys):
        n_windows = int(rng.integers(1, max(2, int(length / 2.6)) + 1))
        pitch = length / n_windows
        for k in range(n_windows):
            half, center = 0.5 * min(rng.uniform(0.7, 2.2), pitch - 0.6), (k + 0.5) * pitch
            low = storey * STOREY + (0.1 if rng.random() < 0.15 else rng.uniform(0.8, 1.1))
            windows.append((center - half, center + half, low, storey * STOREY + rng.uniform(2.0, 2.3)))
    return windows


def _gabled_roof(width: float, depth: float, height: float, rng: np.random.Generator, *, gable_in_front: bool) -> Patch:
    """Two rough slopes of tiles with eaves, and the gables below them."""
    span, length = (width, depth) if gable_in_front else (depth, width)
    eaves, rise = 0.4, rng.uniform(0.35, 0.5) * span
    x = np.linspace(-eaves, length + eaves, round(length / 0.4))
    part = np.linspace(0.0, 1.0, round(span / 0.7))
    parts = []
    for side in (-1.0, 1.0):
        y = side * (0.5 * span + eaves) * (1.0 - part)
        z = height + rise * part - eaves * rise / (0.5 * span) * (1.0 - part)
        rough = z + 0.02 * rng.standard_normal((len(x), len(z)))
        grid = np.stack([*np.broadcast_arrays(x[:, None], y, rough)], axis=-1)
        parts.append(quads(grid_faces(grid), LasClass.BUILDING))
    gables = [[[at, -0.5 * span, height], [at, 0.5 * span, height], [at, 0.0, height + rise]] for at in (0, length)]
    parts.append(triangles(gables, LasClass.BUILDING))
    roof = join(parts)
    if gable_in_front:
        return roof.placed(0.5 * width, -depth, heading=math.pi / 2.0)
    return roof.placed(0.0, -0.5 * depth)


PIECE = 0.5  # length of the pieces of rails, m: short, so that a fence can follow the road and its slopes


def draw_picket_fence(length: float, rng: np.random.Generator) -> Patch:
    """Return pickets with gaps between them, on two rails; some stand askew."""
    height, pitch = rng.uniform(0.8, 1.3), rng.uniform(0.11, 0.17)
    x = np.arange(0.0, length - 0.08, pitch)
    tops = height + rng.normal(0.0, 0.015, len(x))
    y = rng.normal(0.0, 0.01, len(x))
    pickets = _boxes(x, x + rng.uniform(0.06, 0.09), y, y + 0.02, 0.05, tops)
    return join([pickets, _rail(length, 0.3), _rail(length, height - 0.25)])


def draw_wire_fence(length: float, rng: np.random.Generator) -> Patch:
    """Return posts and wires, through which nearly all light goes."""
    height = rng.uniform(1.0, 1.4)
    x = np.arange(0.0, length, 2.2)
    posts = _boxes(x, x + 0.05, -0.025, 0.025, 0.0, height)
    return join([posts, *(_rail(length, z, thickness=0.006) for z in np.linspace(0.15, height, 8))])


def draw_garden_wall(length: float, rng: np.random.Generator) -> Patch:
    """Return a low wall of stones that stand out of it by some centimetres."""
    height, n_courses = rng.uniform(0.4, 1.1), 4
    stones = []
    for course in range(n_courses):
        edges = np.unique(np.clip(np.cumsum(rng.uniform(0.2, 0.5, 2 + int(length / 0.2))), 0.0, length))
        edges = np.concatenate([[0.0], edges])
        out = 0.12 + rng.normal(0.0, 0.015, (2, len(edges) - 1))
        low, top = course * height / n_courses - (0.3 if course == 0 else 0.0), (course + 1) * height / n_courses
        stones.append(_boxes(edges[:-1], edges[1:], -out[0], out[1], low, top))
    return join(stones)


def draw_mail_box(rng: np.random.Generator) -> Patch:
    """Return a box on a post."""
    half, z = rng.uniform(0.12, 0.22), rng.uniform(0.9, 1.2)
    lows = [[-0.03, -0.03, 0.0], [-half, -0.15, z]]
    highs = [[0.03, 0.03, z], [half, 0.15, z + rng.uniform(0.25, 0.4)]]
    return boxes(lows, highs, LasClass.UNCLASSIFIED)


def draw_bin(rng: np.random.Generator) -> Patch:
    """Return a bin on wheels, which stands elsewhere on another day."""
    half = rng.uniform(0.24, 0.34)
    return boxes([[-half, -half, 0.05]], [[half, half, rng.uniform(0.95, 1.15)]], LasClass.UNCLASSIFIED)


def draw_weeds(length: float, day: np.random.Generator) -> Patch:
    """Return high grass and flowers along x, at the foot of something of `length` (m); others every `day`."""
    n = int(25 * length)
    places = np.column_stack([day.uniform(0.0, length, n), day.normal(0.0, 0.15, n), day.exponential(0.12, n)])
    return leaves_at(places, 0.06, LasClass.LOW_VEGETATION, day)


def _rail(length: float, z: float, thickness: float = 0.04) -> Patch:
    """A rail at the height `z` (m)."""
    x = np.linspace(0.0, length, 1 + max(1, round(length / PIECE)))
    half = 0.5 * thickness
    return _boxes(x[:-1], x[1:], -half, half, z - half, z + half)


def _boxes(x0: NDArray[np.float64], *others: NDArray[np.float64] | float) -> Patch:
    """Return unclassified boxes from x0 to x1, y0 to y1 and z0 to z1, given in this order, (n,) or one for all, m."""
    x0, x1, y0, y1, z0, z1 = np.broadcast_arrays(x0, *others)
    return boxes(np.column_stack([x0, y0, z0]), np.column_stack([x1, y1, z1]), LasClass.UNCLASSIFIED)
