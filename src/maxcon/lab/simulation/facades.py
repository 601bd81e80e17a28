"""Facades of city houses: windows, pilasters, balconies."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation.furniture import LasClass, Patch, boxes, join, prism, quads, triangles

HOUSE_DEPTH = 12.0  # distance from front to back of every house, m

THRESHOLD, SILL, LINTEL = 0.45, 1.1, 2.6
"""Heights of edges on the ground floor, m: lower edge of doors, lower edge of windows, upper edge of both."""
ARCHWAY_DEPTH = 9.0
DOOR_RECESS = 0.35

Grid = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Edges of columns, shape (nx + 1,), and of rows, (nz + 1,); depths behind the front, (nx, nz); all in m."""


@dataclass(frozen=True, slots=True)
class HouseStyle:
    """The parameters in which houses differ; lengths in m (0 for none), columns are of windows."""

    width: float
    n_storeys: int
    storey_height: float
    n_columns: int
    window_width: float
    window_height: float
    reveal: float
    plinth: float  # how far the foot stands out
    door_column: int
    bay: float  # how far a bay over the door stands out
    balcony_column: int | None  # with balconies on the upper floors
    archway_column: int | None  # with a passage to the yard

    @classmethod
    def drawn(cls, width: float, rng: np.random.Generator) -> Self:
        """Draw the style of an inner-city house of `width` (m)."""
        n_columns = max(2, int(width / rng.uniform(2.3, 3.1)))
        columns = rng.permutation(n_columns)
        draw = rng.random(4)
        return cls(
            width=width, n_storeys=int(rng.integers(3, 6)), storey_height=rng.uniform(3.0, 3.7), n_columns=n_columns,
            window_width=min(rng.uniform(1.0, 1.4), 0.6 * width / n_columns), window_height=rng.uniform(1.4, 1.9),
            reveal=rng.uniform(0.1, 0.25), plinth=rng.uniform(0.03, 0.07) if draw[0] < 0.5 else 0.0,
            door_column=int(columns[0]), bay=rng.uniform(0.5, 0.9) if draw[1] < 0.1 else 0.0,
            balcony_column=int(columns[1]) if draw[2] < 0.4 else None,
            archway_column=int(columns[-1]) if draw[3] < 0.08 and n_columns > 3 else None,
        )  # fmt: skip

    @property
    def floors(self) -> NDArray[np.float64]:
        """Height of each upper floor, m."""
        return np.asarray(self.storey_height + 0.5 + np.arange(self.n_storeys - 1) * self.storey_height)

    @property
    def height(self) -> float:
        """Height of the eaves, m."""
        return self.storey_height + 0.5 + (self.n_storeys - 1) * self.storey_height + 0.4

    def column_center(self, column: int) -> float:
        """Middle of a column of windows, m along the front."""
        return (column + 0.5) * self.width / self.n_columns


def draw_town_house(width: float, rng: np.random.Generator, *, shows_left: bool, shows_right: bool) -> Patch:
    """Return a whole house of `width` (m); its left and right sides have windows where they face a street."""
    style = HouseStyle.drawn(width, rng)
    side = _window_grid(style, HOUSE_DEPTH, max(2, round(HOUSE_DEPTH / 3.0)))
    parts = [relief(*_front_grid(style)), *_roof(style), steps(style.column_center(style.door_column))]
    if style.balcony_column is not None:
        center = style.column_center(style.balcony_column)
        half, out = rng.uniform(1.0, 1.5), rng.uniform(0.9, 1.3)
        parts += [balcony(center, half, out, z) for z in style.floors]
    parts.append(_wall((0.0, -HOUSE_DEPTH), (style.width, -HOUSE_DEPTH), style.height))
    for x, heading, start, shows in (
        (0.0, math.pi / 2.0, -HOUSE_DEPTH, shows_left),
        (style.width, -math.pi / 2.0, 0.0, shows_right),
    ):
        if shows:
            parts.append(relief(*side).placed(x, start, heading=heading))
        else:
            parts.append(_wall((x, 0.0), (x, -HOUSE_DEPTH), style.height))
    parts.append(rain_pipe(0.15 if rng.random() < 0.5 else style.width - 0.15, style.height))
    return join(parts)


def relief(x_edges: NDArray[np.float64], z_edges: NDArray[np.float64], depths: NDArray[np.float64]) -> Patch:
    """Wall of rectangles between edges of columns and rows, each at its own depth behind y = 0, m, shape (nx, nz)."""
    padded = np.pad(depths, 1)
    i, j = (index.ravel() for index in np.indices(depths.shape))
    faces = [_face(x_edges[i], x_edges[i + 1], -depths[i, j], -depths[i, j], z_edges[j], z_edges[j + 1])]
    i, j = np.nonzero(padded[:-1, 1:-1] != padded[1:, 1:-1])
    faces.append(_face(x_edges[i], x_edges[i], -padded[i, j + 1], -padded[i + 1, j + 1], z_edges[j], z_edges[j + 1]))
    i, j = np.nonzero(padded[1:-1, 1:-1] != padded[1:-1, 2:])  # not below the first row: the ground closes the foot
    low, high, z = -padded[i + 1, j + 1], -padded[i + 1, j + 2], z_edges[j + 1]
    left, right = x_edges[i], x_edges[i + 1]
    faces.append(_quads((left, low, z), (right, low, z), (right, high, z), (left, high, z)))
    return quads(np.concatenate(faces), LasClass.BUILDING)


def _quads(*corners: tuple[NDArray[np.float64], ...]) -> NDArray[np.float64]:
    """Four corners of many faces, each given as columns (x, y, z), in one array of shape (n, 4, 3)."""
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1)


def _face(*edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Upright rectangles from (x0, y0) to (x1, y1) between z0 and z1, given as x0, x1, y0, y1, z0, z1."""
    x0, x1, y0, y1, z0, z1 = edges
    return _quads((x0, y0, z0), (x1, y1, z0), (x1, y1, z1), (x0, y0, z1))


def _wall(foot: tuple[float, float], end: tuple[float, float], top: float) -> Patch:
    """Plain wall from the ground up to `top`."""
    return quads([[[*foot, 0.0], [*end, 0.0], [*end, top], [*foot, top]]], LasClass.BUILDING)


def _window_grid(style: HouseStyle, length: float, n_columns: int) -> Grid:
    """Relief with windows in columns and storeys: in odd columns, and in every second row from the third."""
    pitch = length / n_columns
    centers = (np.arange(n_columns) + 0.5) * pitch
    half = 0.5 * style.window_width
    x_edges = np.concatenate([[0.0], np.stack([centers - half, centers + half], 1).ravel(), [length]])
    sills = style.floors + 0.85
    upper = np.stack([sills, sills + style.window_height], 1).ravel()
    z_edges = np.concatenate([[0.0, THRESHOLD, SILL, LINTEL], upper, [style.height]])
    depths = np.zeros((len(x_edges) - 1, len(z_edges) - 1))
    depths[1::2, 2::2] = style.reveal
    return x_edges, z_edges, depths


def _front_grid(style: HouseStyle) -> Grid:
    """Return the relief of a front: windows, plinth, bay, door and archway."""
    x_edges, z_edges, depths = _window_grid(style, style.width, style.n_columns)
    door = 2 * style.door_column + 1
    depths[:, :2] = -style.plinth
    depths[door - 1 : door + 2, 3:] -= style.bay
    depths[door, 1:3] = DOOR_RECESS
    if style.archway_column is not None:
        depths[2 * style.archway_column + 1, :3] = ARCHWAY_DEPTH
    return x_edges, z_edges, depths


def steps(center: float) -> Patch:
    """Return two door steps, their middle at `center` (m) along the front."""
    lows = [[center - 0.8, -DOOR_RECESS, 0.0], [center - 0.8, -DOOR_RECESS, 0.0]]
    highs = [[center + 0.8, 0.6, 0.15], [center + 0.8, 0.3, 0.3]]
    return boxes(lows, highs, LasClass.BUILDING)


def balcony(center: float, half: float, out: float, z: float) -> Patch:
    """Return a balcony of slab and parapets, `half` to either side of `center`, `out` before the front, at `z` (m)."""
    wall = 0.06
    lows = [[center - half, 0.0, z - 0.15], [center - half, out - wall, z]]
    highs = [[center + half, out, z], [center + half, out, z + 1.0]]
    lows += [[center - half, 0.0, z], [center + half - wall, 0.0, z]]
    highs += [[center - half + wall, out - wall, z + 1.0], [center + half, out - wall, z + 1.0]]
    return boxes(lows, highs, LasClass.BUILDING)


def rain_pipe(x: float, height: float) -> Patch:
    """Return a pipe, 10 cm in diameter, at `x` (m) along the front, up to `height` (m)."""
    angles = np.arange(8) * math.pi / 4.0
    outline = np.stack([x + 0.05 * np.cos(angles), 0.09 + 0.05 * np.sin(angles)], axis=1)
    return prism(outline, 0.0, height, LasClass.BUILDING)


def _roof(style: HouseStyle) -> list[Patch]:
    """Two slopes with eaves over front and back, and the gables."""
    eaves, middle = 0.35, -0.5 * HOUSE_DEPTH
    ridge = style.height + 0.35 * HOUSE_DEPTH
    corners, gables = [], []
    for y, foot in ((eaves, 0.0), (-HOUSE_DEPTH - eaves, -HOUSE_DEPTH)):
        eave_z = style.height - 0.7 * eaves
        corners.append([[0.0, y, eave_z], [style.width, y, eave_z], [style.width, middle, ridge], [0.0, middle, ridge]])
        gables += [[[x, foot, style.height], [x, middle, style.height], [x, middle, ridge]] for x in (0.0, style.width)]
    return [quads(corners, LasClass.BUILDING), triangles(gables, LasClass.BUILDING)]
