"""How distinct the best cell of an accumulator is: the measures the paper compares objectives by."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError
from maxcon.integrity import is_beyond
from maxcon.search.accumulator import Accumulator, highest
from maxcon.search.objectives import Objective, Scores, checked_scores
from maxcon.search.space import Cell, SearchSpace

GUARD_RADIUS = 0.3  # cells nearer to the peak than this cannot be its rival, the second peak, m (design, section 4)

SPREAD_RATIO = 0.9  # the spread is how far cells go that reach this fraction of the peak's score

# A Laplace distribution of standard deviation sigma falls by exp(-sqrt(2) / sigma) per unit; sigma = 1 cell.
LAPLACE_DECAY = math.sqrt(2.0)

# Rounding, in cells: places on the ray this close to a row or column of cells lie on it, for cos(pi / 2) is not 0.
ON_THE_GRID = 1e-9


@dataclass(frozen=True, slots=True)
class Distinctness:
    """How distinct a peak is, whatever the score's unit (design, section 4); NaN where the highest score is 0."""

    # Score of the second peak, the highest local maximum beyond 0.3 m at any heading, over that of the peak, 0 to 1
    peak_ratio: float
    # Of the scores along the significant ray as a distribution over the offset: 1.8 for many equal scores, 3 for a
    # Gaussian; NaN where a single place has all the score
    kurtosis: float
    divergence: float  # of the same from a Laplace distribution, sigma = 1 cell, nats; NaN where the ray is one cell
    spread: float  # largest horizontal distance from the peak to a cell that reaches 90 % of its score, m


def distinctness(accumulator: Accumulator, objective: Objective, scores: Scores | None = None) -> Distinctness:
    """Return measures of how distinct the best cell is; `scores` are the objective's, where they are known already.

    The ray ends where the search space ends, so kurtosis and divergence depend on where in the space the peak lies:
    compare objectives on the same accumulator. ArrayError if scores are negative or not finite: a fraction of the peak
    needs a zero that means "nothing".
    """
    space = accumulator.space
    scores = _checked(accumulator.score(objective) if scores is None else scores, space)
    peak = highest(scores)
    if scores[peak] == 0.0:
        return Distinctness(math.nan, math.nan, math.nan, math.nan)
    offsets, along = significant_ray(accumulator, scores, peak)
    places, fractions = offsets / space.cell_edge, along / along.sum()
    _, iy, ix = np.nonzero(scores >= SPREAD_RATIO * scores[peak])
    return Distinctness(
        peak_ratio=peak_ratio(scores, peak, space, GUARD_RADIUS),
        kurtosis=_kurtosis(places, fractions),
        divergence=_divergence(places, fractions),
        spread=float(np.hypot(iy - peak[1], ix - peak[2]).max()) * space.cell_edge,
    )


def peak_ratio(scores: Scores, cell: Cell, space: SearchSpace, guard_radius: float) -> float:
    """Score of the second highest peak over that of `cell` (design, section 4).

    The second peak is the highest local maximum over all headings farther than `guard_radius` (m) from `cell`; the
    ratio is 0 where there is none, infinity where `cell` scores 0. `scores` (headings, ny, nx) are not negative.
    """
    if scores[cell] <= 0.0:
        return math.inf
    highest = scores.max(axis=0)
    ny, nx = highest.shape
    padded = np.pad(highest, 1, constant_values=-np.inf)
    around = np.max([padded[y : y + ny, x : x + nx] for y in range(3) for x in range(3)], axis=0)
    is_other = (highest == around) & is_beyond(cell, space, guard_radius)
    return float(highest[is_other].max(initial=0.0) / scores[cell])


def significant_ray(
    accumulator: Accumulator, scores: Scores, cell: Cell
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the scores along the least determined direction through a cell, and where they are (design, section 4).

    The line lies in the heading plane of the cell and points along the eigenvector of N with the smallest eigenvalue;
    where N prefers no direction it is the y axis. Returns distances from the cell, a cell edge apart, shape (k,), m,
    positive towards +x, or +y where the line is the y axis; and the scores there, interpolated bilinearly, shape (k,).
    """
    from scipy.ndimage import map_coordinates

    scores = _checked(scores, accumulator.space)
    heading, iy, ix = cell
    _, ny, nx = scores.shape
    x_step, y_step = _least_determined(accumulator.normal_matrix(cell))
    steps = np.arange(-(nx + ny), nx + ny + 1)
    places = np.array([ix + steps * x_step, iy + steps * y_step])
    x, y = np.where(np.abs(places - np.rint(places)) < ON_THE_GRID, np.rint(places), places)
    is_inside = (x >= 0.0) & (x <= nx - 1) & (y >= 0.0) & (y <= ny - 1)
    along = map_coordinates(scores[heading], [y[is_inside], x[is_inside]], order=1)
    return steps[is_inside] * accumulator.space.cell_edge, along


def _checked(scores: Scores, space: SearchSpace) -> Scores:
    """Scores as float64; ArrayError where fractions of the peak would mean nothing."""
    scores = checked_scores(np.asarray(scores, dtype=np.float64), space.shape)
    lowest, top = scores.min(), scores.max()
    if lowest < 0.0 or not np.isfinite(top):
        raise ArrayError(
            f"Expected finite scores >= 0 to measure how distinct a peak is, got {lowest:g} to {top:g}."
            " Let the objective score 0 where nothing matches."
        )
    return scores


def _least_determined(normal_matrix: NDArray[np.float64]) -> tuple[float, float]:
    """Unit vector (x, y) along the eigenvector of the smallest eigenvalue of N, x > 0 or (0, 1)."""
    (nxx, nxy), (_, nyy) = normal_matrix
    largest = 0.5 * math.atan2(2.0 * nxy, nxx - nyy)  # direction of the largest; 0 where there is none
    x, y = -math.sin(largest), math.cos(largest)
    if abs(x) < ON_THE_GRID:
        return 0.0, 1.0
    return (x, y) if x > 0.0 else (-x, -y)


def _kurtosis(places: NDArray[np.float64], fractions: NDArray[np.float64]) -> float:
    """Fourth central moment over the squared variance of a distribution; NaN where one place has it all."""
    deviations = places - fractions @ places
    variance = float(fractions @ deviations**2)
    if np.count_nonzero(fractions) < 2:
        return math.nan
    return float(fractions @ deviations**4) / variance / variance


def _divergence(places: NDArray[np.float64], fractions: NDArray[np.float64]) -> float:
    """Sum of p log(p / q), nats: p fractions, q Laplace at places in cells from the peak; NaN for one."""
    from scipy.special import log_softmax, xlogy

    if len(places) < 2:
        return math.nan
    log_density = log_softmax(-LAPLACE_DECAY * np.abs(places))  # q underflows some 530 cells from the peak
    return max(0.0, float((xlogy(fractions, fractions) - fractions * log_density).sum()))  # not -1e-17
