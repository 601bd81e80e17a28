# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well a map is known, from how far passes of the mapping vehicle differ where they saw one wall (decision 19)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.place_sample import PLACE_EDGE

__all__ = ["PassDifferences", "compare_passes"]

LEAST_PAUSE = 60.0
"""Between two passes at one place, s: a vehicle that waits at a light makes one."""
LEAST_POINTS = 20
"""Of a pass at a place."""
LARGEST_OFFSET = 0.3 * PLACE_EDGE
"""Of a pass's plane from the middle of the place, m: farther out the cube's faces cut noise off, and bias the mean."""
LARGEST_ROUGHNESS = 0.03
"""Root mean square distance of a pass's points from its plane, m."""
LEAST_WIDTH = 0.16 * PLACE_EDGE
"""Root mean square extent of the points along the plane's shorter side, m; 0.29 edges where they fill it evenly."""
OUTLIER = 3.0
"""Robust standard deviations; beyond it something has changed: a door, a parked car, leaves."""
NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal deviate."""
STRETCH = 30.0
"""s; errors of a trajectory within such a stretch are much the same."""
LEAST_STRETCHES = 4
LEAST_PLACES = 50


@dataclass(frozen=True, slots=True)
class PassDifferences:
    """What the comparison of passes found.

    Parameters
    ----------
    n_passes : int
        That left points at a plane, in the median; 0 if there is no plane with times.
    n_places : int
        Where two or more were compared.
    n_stretches : int
        Half minutes of mapping that were compared.
    sigma_of_pass : float
        Standard deviation of the position of one pass along any axis, m.
    sigma_of_map : float
        The same of the mean of all points at a place, which is what the map has, m.
    """

    n_passes: int
    n_places: int = 0
    n_stretches: int = 0
    sigma_of_pass: float = math.nan
    sigma_of_map: float = math.nan

    @property
    def is_enough(self) -> bool:
        """Whether enough was compared to believe the standard deviations."""
        return self.n_places >= LEAST_PLACES and self.n_stretches >= LEAST_STRETCHES

    @property
    def shortcoming(self) -> str:
        """Why it is not enough, in words."""
        if self.n_passes == 0:
            return "no planes of points with times"
        if self.n_places == 0:
            return "one pass only"
        return f"passes meet at {self.n_places:,} places in {self.n_stretches} half minutes only"


@dataclass(frozen=True, slots=True)
class _Visits:
    """What each pass saw of each place, where it left enough points; sorted by place and then by time.

    Parameters
    ----------
    places : array, shape (v,), int64
        From 0, rising.
    times : array, shape (v,)
        Of the first point, s.
    counts : array, shape (v,)
        Points.
    means : array, shape (v, 3)
        Of the points, from the middle of the place, m.
    covariances : array, shape (v, 3, 3)
        Of the points about their mean, m^2.
    n_passes : array, shape (p,)
        That left any points at each place.
    variance_shares : array, shape (p,)
        Variance of the mean of all points of each place, as a share of that of one pass: 1/5 if five left as many each.
    """

    places: NDArray[np.int64]
    times: NDArray[np.float64]
    counts: NDArray[np.float64]
    means: NDArray[np.float64]
    covariances: NDArray[np.float64]
    n_passes: NDArray[np.int64]
    variance_shares: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Offsets:
    """Where each pass saw each plane, along the plane's normal; sorted by place and then by time.

    Parameters
    ----------
    places : array, shape (k,), int64
        Numbers as in `_Visits`.
    times : array, shape (k,)
        s.
    offsets : array, shape (k,)
        m.
    noise : array, shape (k,)
        Variance of the offsets from the noise of the points, m^2.
    """

    places: NDArray[np.int64]
    times: NDArray[np.float64]
    offsets: NDArray[np.float64]
    noise: NDArray[np.float64]


def compare_passes(records: NDArray[np.void]) -> PassDifferences:
    """Find how far passes differ across the planes that several of them saw.

    Parameters
    ----------
    records : array
        Points as `PlaceSample.records` gives them.

    Notes
    -----
    Two offsets of passes with independent errors of standard deviation s along any axis differ by sqrt(2) s, and by
    the noise of the points, which is known and taken off.
    """
    visits = _visits(records)
    if not len(visits.places):
        return PassDifferences(0)
    planes = _offsets(visits)
    at_planes = np.unique(planes.places)
    if not len(at_planes):
        return PassDifferences(0)
    n_passes = int(np.median(visits.n_passes[at_planes]))
    first, second = _pairs(planes.places)
    if not len(first):
        return PassDifferences(n_passes)
    noise = planes.noise[first] + planes.noise[second]
    variance_of_pass = 0.5 * _variance(planes.offsets[first] - planes.offsets[second], noise)
    variance_of_map = variance_of_pass * float(visits.variance_shares[at_planes].mean())
    return PassDifferences(
        n_passes,
        len(np.unique(planes.places[first])),
        len(np.unique(np.floor(planes.times[np.concatenate([first, second])] / STRETCH))),
        math.sqrt(variance_of_pass),
        math.sqrt(variance_of_map),
    )


def _visits(records: NDArray[np.void]) -> _Visits:
    """Moments of each pass at each place, and how the passes share the places."""
    is_new_place = np.diff(records["place"], prepend=~records["place"][:1]) != 0
    is_new_pass = is_new_place | (np.diff(records["time"], prepend=-np.inf) > LEAST_PAUSE)
    starts = np.flatnonzero(is_new_pass)
    counts = np.diff(starts, append=len(records))
    place_of_all = np.cumsum(is_new_place)[starts] - 1
    shares = np.bincount(place_of_all, counts**2.0) / np.bincount(place_of_all, counts) ** 2
    is_used = counts >= LEAST_POINTS
    used, places = np.unique(place_of_all[is_used], return_inverse=True)
    inside = records["inside"].astype(np.float64)[np.repeat(is_used, counts)]
    n = counts[is_used].astype(np.float64)
    means, covariances = _moments(inside, counts[is_used])
    times = records["time"][starts[is_used]]
    return _Visits(places, times, n, means, covariances, np.bincount(place_of_all)[used], shares[used])


def _moments(
    points: NDArray[np.float64], counts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means, shape (v, 3), and covariances, shape (v, 3, 3), of groups of points that follow each other."""
    means, covariances = np.zeros((len(counts), 3)), np.zeros((len(counts), 3, 3))
    if len(counts):
        rows = np.cumsum(counts) - counts
        means = np.add.reduceat(points, rows, axis=0) / counts[:, None]
        centred = points - np.repeat(means, counts, axis=0)
        for one in range(3):
            for other in range(3):
                covariances[:, one, other] = (
                    np.add.reduceat(centred[:, one] * centred[:, other], rows) / counts
                )
    return means, covariances


def _offsets(visits: _Visits) -> _Offsets:
    """Fit a plane to every place, with one normal for all passes and an offset for each."""
    firsts = np.flatnonzero(np.diff(visits.places, prepend=-1))
    weights = visits.counts[:, None, None]
    pooled = np.add.reduceat(weights * visits.covariances, firsts) / np.add.reduceat(weights, firsts)
    extents, axes = np.linalg.eigh(pooled)
    normals = axes[visits.places, :, 0]
    offsets = np.einsum("vi,vi->v", normals, visits.means)
    roughness = np.einsum("vi,vij,vj->v", normals, visits.covariances, normals)
    is_plane = (extents[:, 1] >= LEAST_WIDTH**2)[visits.places]
    is_plane &= (np.abs(offsets) <= LARGEST_OFFSET) & (roughness <= LARGEST_ROUGHNESS**2)
    noise = roughness / visits.counts
    return _Offsets(visits.places[is_plane], visits.times[is_plane], offsets[is_plane], noise[is_plane])


def _variance(differences: NDArray[np.float64], noise: NDArray[np.float64]) -> float:
    """Variance of differences (m) less that of their noise (m^2), without those of things that changed, m^2.

    The median gives the scale; of the differences within three of it the mean square is taken. Two passes d apart are
    both within `LARGEST_OFFSET` of a cube's middle the less often the larger d is, and count the more for it. Beyond
    0.9 of the most that can be seen there is nothing to weigh.
    """
    sizes, widest = np.abs(differences), 2.0 * LARGEST_OFFSET
    is_usual = sizes <= min(OUTLIER * float(np.median(sizes)) / NORMAL_MEDIAN, 0.9 * widest)
    weights = 1.0 / (widest - sizes[is_usual])
    return max(0.0, float(np.average((differences**2 - noise)[is_usual], weights=weights)))


def _pairs(places: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Numbers of all pairs of rows with one place; `places` is sorted."""
    first: list[NDArray[np.intp]] = [np.empty(0, np.intp)]
    second: list[NDArray[np.intp]] = [np.empty(0, np.intp)]
    for lag in range(1, len(places)):
        pair = np.flatnonzero(places[lag:] == places[:-lag])
        if not len(pair):
            break
        first.append(pair)
        second.append(pair + lag)
    return np.concatenate(first), np.concatenate(second)
