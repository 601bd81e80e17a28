"""Road, slopes and plants of the suburb."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError
from maxcon.lab.simulation.drive import Drive, Route, Seed, sway
from maxcon.lab.simulation.furniture import OCTAGON, LasClass, Patch, grid_faces, join, leaves_at, prism, quads

HALF_WIDTH = 3.1  # from the centre line to either kerb, m
GARDEN_LEFT, GARDEN_RIGHT = 4.7, -6.5
"""Where gardens begin, m to the left of the centre line: beyond a sidewalk, on the right beyond a grass verge, too."""
SIDEWALK_RIGHT = -5.0  # where the sidewalk on the right begins, m to the left of the centre line
KERB_HEIGHT = 0.1
CAMBER, SIDEWALK_SLOPE = 0.02, 0.03
"""How much the carriageway falls to its sides, and how much sidewalks rise away from it, rise over run."""
BEYOND = 45.0  # how far the world extends beyond both ends of the road, and to its sides, m
STEP = 0.25  # spacing of the points of the centre line and, along the road, of the ground, m
MIN_RADIUS = 75.0  # radius of the narrowest curve, m: above `BEYOND`, so that (along, left) is unique for each place
STEEPEST = 0.07  # largest slope of the road, rise over run
TRACK, WHEELBASE = 1.5, 2.6  # distances between the wheels of a vehicle, across and along, m
ASPHALT, GRASS = 0.004, 0.03  # roughness: standard deviation of the ground's height, m


@dataclass(frozen=True, slots=True, eq=False)
class ResidentialRoad:
    """A road in a suburb, with the ground around it; along it, 0 is its begin."""

    length: float  # m
    # (k, 2): (x, y) of the centre line every 0.25 m, from `BEYOND` before its begin to `BEYOND` after its end, m
    centers: NDArray[np.float64]
    headings: NDArray[np.float64]  # (k,): direction of the centre line at these points, rad from +x
    heights: NDArray[np.float64]  # (k,): of the centre line, m
    tilts: NDArray[np.float64]  # (k,): cross slope: how much the road rises to the left, rise over run
    # (k, 2): how much the gardens on the left and on the right rise away from the road, rise over run
    banks: NDArray[np.float64]

    @property
    def alongs(self) -> NDArray[np.float64]:
        """Distance along the road of each point of the centre line, shape (k,), m; below 0 before its begin."""
        return np.arange(len(self.centers), dtype=np.float64) * STEP - BEYOND

    def places(self, along: ArrayLike, left: ArrayLike) -> NDArray[np.float64]:
        """Positions (x, y), shape (..., 2), m, of places `along` and to the `left` of the road, shape (...), m."""
        along, left = np.broadcast_arrays(along, left)
        x, y, heading = (np.interp(along, self.alongs, column) for column in (*self.centers.T, self.headings))
        return np.stack([x - left * np.sin(heading), y + left * np.cos(heading)], axis=-1)

    def ground_heights(self, along: ArrayLike, left: ArrayLike) -> NDArray[np.float64]:
        """Heights of the smooth ground, shape (...), m, at places `along` and to the `left` of the road, m."""
        along, left = np.broadcast_arrays(along, left)
        heights, tilts, bank_left, bank_right = (
            np.interp(along, self.alongs, column) for column in (self.heights, self.tilts, *self.banks.T)
        )
        out = np.abs(left)
        heights = heights + tilts * np.clip(left, GARDEN_RIGHT, GARDEN_LEFT)
        heights -= CAMBER * np.minimum(out, HALF_WIDTH)
        heights += KERB_HEIGHT * np.clip((out - HALF_WIDTH) / 0.02, 0.0, 1.0)
        heights += SIDEWALK_SLOPE * np.clip(out - HALF_WIDTH, 0.0, 3.4)
        heights += bank_left * np.maximum(left - GARDEN_LEFT, 0.0)
        heights += bank_right * np.maximum(GARDEN_RIGHT - left, 0.0)
        return np.asarray(heights, dtype=np.float64)

    def laid(self, patch: Patch, along: float, left: float, heading: float = 0.0) -> Patch:
        """Return `patch`, turned by `heading` (rad), bent to follow the road and the slopes of the ground."""
        turned = patch.placed(along, left, heading=heading).corners
        level = self.places(turned[..., 0], turned[..., 1])
        heights = self.ground_heights(turned[..., 0], turned[..., 1]) + turned[..., 2]
        return Patch(np.concatenate([level, heights[..., None]], axis=-1), patch.classes)

    def stood(self, patch: Patch, along: float, left: float, heading: float = 0.0) -> Patch:
        """Return `patch` rigid and upright, as houses stand, its origin on the ground; `heading` is from the road's."""
        (x, y), z = self.places(along, left).tolist(), float(self.ground_heights(along, left))
        return patch.placed(x, y, z, float(np.interp(along, self.alongs, self.headings)) + heading)

    def ground(self, seed: Seed) -> Patch:
        """Return carriageway, kerbs, verges, sidewalks and gardens; grass is rougher than asphalt."""
        rng = np.random.default_rng(seed)
        near = np.arange(GARDEN_LEFT, 14.0, 0.3)
        far = np.arange(14.0, BEYOND + 1.0, 1.0)
        paved = np.array([0.0, 1.0, 2.0, HALF_WIDTH, HALF_WIDTH + 0.02, 3.8])
        verge = np.arange(3.5, -GARDEN_RIGHT, 0.25)
        lefts = np.unique(np.concatenate([paved, near, far, -paved, -verge, -near, -far]).round(3))
        along, left = np.meshgrid(self.alongs, lefts, indexing="ij")
        is_verge = (left < -HALF_WIDTH - 0.1) & (left > SIDEWALK_RIGHT)
        is_grass = is_verge | (left > GARDEN_LEFT) | (left < GARDEN_RIGHT)
        roughness = np.where(is_grass, GRASS, ASPHALT) * rng.standard_normal(along.shape)
        heights = self.ground_heights(along, left) + roughness
        grid = np.concatenate([self.places(along, left), heights[..., None]], axis=-1)
        return quads(grid_faces(grid), LasClass.GROUND)

    def route(self, lane: float, seed: Seed, *, start: float = 0.0, is_back: bool = False) -> Route:
        """Return a wandering route along the road, or back, in a lane (m to the left), `start` (m) past both ends."""
        rng = np.random.default_rng(seed)
        along = np.arange(-start, self.length + start, 0.05)
        lefts = lane + sway(along, 0.2, (40.0, 200.0), rng)
        points = self.places(along, lefts)
        slows_at = float(rng.uniform(0.2, 0.8)) * float(along[-1] - along[0])
        return Route(points[::-1] if is_back else points, slows_at)

    def on_ground(self, drive: Drive) -> Drive:
        """Return a drive on level ground moved onto this one: heights are added, and its slopes to pitch and roll."""
        along, left = self.addresses(drive.positions[:, :2])
        turn = np.cos(drive.angles[:, 2] - np.interp(along, self.alongs, self.headings))
        forward = np.where(turn > 0.0, 1.0, -1.0)
        front, back = (self.ground_heights(along + side * forward * 0.5 * WHEELBASE, left) for side in (1, -1))
        on_left, on_right = (self.ground_heights(along, left + side * forward * 0.5 * TRACK) for side in (1, -1))
        slopes = np.column_stack(
            [np.arctan((on_left - on_right) / TRACK), -np.arctan((front - back) / WHEELBASE), np.zeros(len(along))]
        )
        lift = np.column_stack([np.zeros((len(along), 2)), 0.25 * (front + back + on_left + on_right)])
        return Drive(drive.times, drive.positions + lift, drive.angles + slopes)

    def addresses(self, places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distances along the road and to the left of it, shape (n,) each, m, of places (x, y), shape (n, 2), m."""
        from scipy.spatial import cKDTree

        _, rows = cKDTree(self.centers).query(places)
        away = places - self.centers[rows]
        cosine, sine = np.cos(self.headings[rows]), np.sin(self.headings[rows])
        return (self.alongs[rows] + away[:, 0] * cosine + away[:, 1] * sine, away[:, 1] * cosine - away[:, 0] * sine)


def draw_road(length: float, seed: Seed) -> ResidentialRoad:
    """Return a random road of `length` (m) that winds and climbs; `OptionError` if it is too short or too long."""
    if not 60.0 <= length <= 2000.0:
        raise OptionError(f"Expected a road of 60 to 2000 m, got {length} m. The default is 460 m.")
    rng = np.random.default_rng(seed)
    along = STEP * np.arange(round((length + 2.0 * BEYOND) / STEP) + 1, dtype=np.float64)
    bends = np.zeros(len(along))
    for amplitudes, wavelengths in (((0.35, 0.6), (180.0, 260.0)), ((0.1, 0.2), (70.0, 110.0))):
        amplitude, wavelength, phase = rng.uniform(*amplitudes), rng.uniform(*wavelengths), rng.uniform(0, 6)
        bends += amplitude * np.sin(2.0 * math.pi * along / wavelength + phase)
    bends *= min(1.0, STEP / MIN_RADIUS / np.abs(np.diff(bends)).max())
    headings = bends + rng.uniform(-math.pi, math.pi)
    steps = STEP * np.column_stack([np.cos(headings), np.sin(headings)])
    centers = np.cumsum(steps, axis=0) - steps.sum(axis=0) / 2.0
    heights = STEP * np.cumsum(STEEPEST * sway(along, 1.0, (130.0, 320.0), rng))
    return ResidentialRoad(
        length=length,
        centers=centers,
        headings=headings,
        heights=heights - heights.mean(),
        tilts=sway(along, 0.04, (80.0, 200.0), rng),
        banks=np.column_stack([sway(along, 0.18, (60.0, 160.0), rng) for _ in ("left", "right")]),
    )


HEDGE_STEP = 0.1  # spacing of the points of a hedge's surface, m
BUMPS, TWIGS = 0.1, 0.09
"""Standard deviations of a hedge's surface, m: smooth bumps of its cut, and twigs that stand out or are missing."""
GAPS = 0.3  # ratio of a hedge's surface that is open: light goes on to the twigs inside, or through the hedge
MOVING = 0.5  # ratio of the leaves, and of the roughness of twigs, that differs from day to day


def _survey_class(las_class: LasClass, ratio: float, rng: np.random.Generator) -> LasClass:
    """Return the class that a survey gives to a plant: the right one to this ratio of them, none to the others."""
    return las_class if rng.random() < ratio else LasClass.UNCLASSIFIED


def draw_hedge_row(length: float, height: float, rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Return a hedge of `length` along x and `height` (m): a bumpy surface of twigs, with leaves standing out."""
    las_class = _survey_class(LasClass.MEDIUM_VEGETATION, 0.3, rng)
    half = rng.uniform(0.25, 0.45)
    x = np.linspace(0.0, length, max(2, round(length / HEDGE_STEP)))
    outline = np.array([[half, 0.0], [half, height - 0.1], [half - 0.1, height]])
    outline = np.concatenate([outline, outline[::-1] * np.array([-1.0, 1.0])])
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    around = np.linspace(0.0, reach[-1], round(reach[-1] / HEDGE_STEP))
    y, z = (np.interp(around, reach, column) for column in outline.T)
    middle = 0.5 * height
    outward = np.column_stack([np.sign(y) * (np.abs(z - middle) < middle - 0.12), z > height - 0.12])
    bulge = BUMPS * _bumps(x, around, rng)
    bulge += TWIGS * (MOVING * day.standard_normal(bulge.shape) + (1.0 - MOVING) * rng.standard_normal(bulge.shape))
    surface = np.column_stack([y, z]) + bulge[..., None] * outward
    grid = np.concatenate([np.broadcast_to(x[:, None, None], (*bulge.shape, 1)), surface], axis=-1)
    core = grid[::2, ::2] * np.array([1.0, 0.4, 0.9])
    parts = [_sheet(surface, las_class, rng, day) for surface in (grid, core)]
    n_leaves = int(90 * length * height)
    rows, columns = day.integers(0, len(x), n_leaves), day.integers(0, len(around), n_leaves)
    away = np.zeros((n_leaves, 3))
    away[:, 1:] = outward[columns] * day.exponential(0.1, (n_leaves, 1))
    ends = day.uniform([0.0, -half, 0.0], [0.0, half, height], (int(150 * height), 3))
    ends[::2, 0] = length
    return join([*parts, leaves_at(np.concatenate([grid[rows, columns] + away, ends]), 0.05, las_class, day)])


def draw_bush(rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Return a bush, 0.5 to 2.2 m high."""
    las_class = _survey_class(LasClass.MEDIUM_VEGETATION, 0.3, rng)
    height = rng.uniform(0.5, 2.2)
    half = np.array([*(height * rng.uniform(0.35, 0.6, 2)), 0.5 * height])
    n_leaves = int(320 * height)
    return leaves_at(np.array([0.0, 0.0, half[2]]) + half * _in_ball(n_leaves, rng, day), 0.07, las_class, day)


def draw_garden_tree(rng: np.random.Generator, day: np.random.Generator, height: float) -> Patch:
    """Return a tree of `height` (m): broad-leaved, or a conifer with branches down to the ground."""
    las_class = _survey_class(LasClass.HIGH_VEGETATION, 0.6, rng)
    is_conifer = rng.random() < 0.3
    trunk = 0.1 * height if is_conifer else rng.uniform(0.2, 0.3) * height
    parts = [prism((0.012 * height + 0.05) * OCTAGON, -0.3, 0.8 * height, las_class)]
    for k in range(5):
        part = (k + 0.5) / 5.0
        spread = (1.0 - part) * 0.22 if is_conifer else 0.26 * math.sin(math.pi * (0.25 + 0.65 * part))
        center = np.array([*rng.normal(0.0, 0.05 * height, 2), trunk + part * (height - trunk)])
        half = np.array([spread * height, spread * height, 0.15 * height])
        parts.append(leaves_at(center + half * _in_ball(int(70 * height), rng, day), 0.11, las_class, day))
    return join(parts)


def draw_ivy(width: float, height: float, rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Return ivy on the wall y = 0, `width` along x and up to `height` (m), denser below."""
    las_class = _survey_class(LasClass.HIGH_VEGETATION, 0.2, rng)
    n_leaves = int(120 * width * height)
    x, z = day.uniform(0.0, width, n_leaves), height * (1.0 - np.sqrt(day.random(n_leaves)))
    out = np.abs(day.normal(0.0, 0.1, n_leaves))
    return leaves_at(np.column_stack([x, out, z]), 0.07, las_class, day)


def _in_ball(n: int, rng: np.random.Generator, day: np.random.Generator) -> NDArray[np.float64]:
    """Places in the unit ball, shape (n, 3), denser towards its hull, as leaves are; some differ from day to day."""
    n_moving = round(MOVING * n)
    draws = ((rng, n - n_moving), (day, n_moving))
    directions = np.concatenate([source.normal(size=(k, 3)) for source, k in draws])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radii = np.concatenate([source.random((k, 1)) for source, k in draws])
    return np.asarray(directions * radii**0.3)


def _bumps(x: NDArray[np.float64], y: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Smooth bumps over a grid, shape (len(x), len(y)), with wavelengths of 0.5 to 2 m and standard deviation 1."""
    waves = 2.0 * math.pi / rng.uniform(0.5, 2.0, 6)
    ways, phases = rng.uniform(0.0, math.pi, 6), rng.uniform(0.0, 2.0 * math.pi, 6)
    total = np.zeros((len(x), len(y)))
    for wave, way, phase in zip(waves, ways, phases, strict=True):
        total += np.sin(wave * (math.cos(way) * x[:, None] + math.sin(way) * y) + phase)
    return total / math.sqrt(3.0)


def _sheet(grid: NDArray[np.float64], las_class: LasClass, rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Surface through a grid of points, shape (n, m, 3), m, with gaps, some of which differ from day to day."""
    faces = grid_faces(grid)
    is_moving = day.random(len(faces)) < MOVING
    is_gap = np.where(is_moving, day.random(len(faces)), rng.random(len(faces))) < GAPS
    return quads(faces[~is_gap], las_class)
