"""How good answers are: errors, coverage of sigmas, protection levels, what samples prove."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maxcon.geometry import Pose, wrap_angle

SUCCESS_DISTANCE = 0.3
SUCCESS_HEADING = math.radians(1.0)
SUCCESS_WORDS = f"{SUCCESS_DISTANCE:g} m and {math.degrees(SUCCESS_HEADING):g}°"  # "within ... of the reference"


@dataclass(frozen=True, slots=True)
class PoseError:
    """How far a pose is from the reference, in x, y and heading, signed."""

    along: float  # in the direction of the reference's heading, m
    across: float  # to the left of it, m
    heading: float  # counter-clockwise, rad

    @property
    def distance(self) -> float:
        """Horizontal distance from the reference, m."""
        return math.hypot(self.along, self.across)

    @property
    def is_success(self) -> bool:
        """Within 0.3 m and 1 degree of the reference (design, section 4)."""
        return self.distance <= SUCCESS_DISTANCE and abs(self.heading) <= SUCCESS_HEADING


def pose_error(pose: Pose, reference: Pose) -> PoseError:
    """Return the error of `pose`; both in the same frame."""
    dx, dy = pose.x - reference.x, pose.y - reference.y
    cosine, sine = math.cos(reference.heading), math.sin(reference.heading)
    along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
    return PoseError(along, across, heading=wrap_angle(pose.heading - reference.heading))


@dataclass(frozen=True, slots=True)
class Quantiles:
    """The error that 50, 95, 99 and 100 % of the epochs do not exceed, in its unit; all NaN where there is none."""

    median: float
    p95: float
    p99: float
    worst: float

    @classmethod
    def of(cls, errors: Iterable[float]) -> "Quantiles":
        """Return the quantiles of the absolute values of `errors`; NaN among them makes all NaN."""
        absolute = np.abs(list(errors))
        if len(absolute) == 0:
            return cls(math.nan, math.nan, math.nan, math.nan)
        median, p95, p99, worst = np.quantile(absolute, [0.5, 0.95, 0.99, 1.0])
        return cls(float(median), float(p95), float(p99), float(worst))


CONFIDENCE = 0.95


def clopper_pearson(n_found: int, n_epochs: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the ends, 0 to 1, of Clopper and Pearson's interval of a rate, if epochs are independent; or (0, 1)."""
    if n_epochs == 0:
        return 0.0, 1.0
    from scipy.stats import binomtest

    interval = binomtest(n_found, n_epochs).proportion_ci(confidence, method="exact")
    return float(interval.low), float(interval.high)


def upper_bound(n_found: int, n_epochs: int) -> float:
    """Return the one-sided upper limit, with 95 % confidence, of a rate, 0 to 1: of 0 in n epochs about 3 / n."""
    return clopper_pearson(n_found, n_epochs, 2.0 * CONFIDENCE - 1.0)[1]


def least_to_prove(rate: float) -> int:
    """Return how many epochs, none of them bad, prove with 95 % confidence that at most a fraction `rate` is bad."""
    return math.ceil(math.log(1.0 - CONFIDENCE) / math.log1p(-rate))


SIGMAS = (1.0, 2.0, 3.0)
PROMISED = tuple(math.erf(k / math.sqrt(2.0)) for k in SIGMAS)
"""Fractions of normally distributed errors within 1, 2 and 3 sigma: 68.3, 95.4 and 99.7 %."""
PROMISED_PLANE = tuple(1.0 - math.exp(-0.5 * k * k) for k in SIGMAS)
"""The same for two errors together, within ellipses of 1, 2 and 3 sigma: 39.3, 86.5 and 98.9 %."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """How many errors lie within 1, 2 and 3 of their predicted sigmas."""

    n_epochs: int  # how many errors have a predicted sigma
    n_within: tuple[int, ...]  # of these, how many are at most 1, 2 and 3 sigma
    rms: float  # of errors over sigmas: 1 where the sigmas hold; one gross error makes it large. NaN without errors.

    @classmethod
    def of(cls, errors: ArrayLike, sigmas: ArrayLike) -> "Coverage":
        """Count errors, shape (n,), within their sigmas, shape (n,), same unit; NaN in either is left out."""
        ratios = np.abs(np.asarray(errors, np.float64)) / np.asarray(sigmas, np.float64)
        ratios = ratios[np.isfinite(ratios)]
        if len(ratios) == 0:
            return cls(0, (0,) * len(SIGMAS), math.nan)
        n_within = tuple(int((ratios <= k).sum()) for k in SIGMAS)
        return cls(len(ratios), n_within, float(np.sqrt((ratios**2).mean())))

    @property
    def shares(self) -> tuple[float, ...]:
        """Fractions of the errors within 1, 2 and 3 sigma, 0 to 1; NaN without epochs."""
        return tuple(n / self.n_epochs if self.n_epochs else math.nan for n in self.n_within)

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Ends of the 95 % interval of each fraction (`clopper_pearson`)."""
        return tuple(clopper_pearson(n, self.n_epochs) for n in self.n_within)


ALERT_LIMIT = 0.29
"""Largest error along and across that a car may have on local streets, m (Reid et al., arXiv 1906.01061)."""


@dataclass(frozen=True, slots=True)
class ProtectionCounts:
    """How many epochs lie in each region of the Stanford diagram."""

    n_nominal: int  # error <= protection level <= alert limit: used, and rightly so
    n_misleading: int  # level < error <= alert limit: used, although the error exceeds its level
    n_hazardous: int  # level <= alert limit < error: used, and nobody was warned
    n_large: int  # alert limit < level: not to be used, as the method itself says
    n_withheld: int  # there is no level: the answer is not trusted, or there is no answer

    @classmethod
    def of(cls, errors: ArrayLike, levels: ArrayLike) -> "ProtectionCounts":
        """Count epochs by their worst direction; errors and levels, m, of shape (n,) or (n, k), NaN without a level."""
        wrong, level = (np.asarray(given, dtype=np.float64) for given in (errors, levels))
        wrong, level = (values[:, None] if values.ndim == 1 else values for values in (np.abs(wrong), level))
        has_level = np.asarray((np.isfinite(level) & np.isfinite(wrong)).all(axis=1))
        is_used = has_level & (np.where(has_level[:, None], level, np.inf) <= ALERT_LIMIT).all(axis=1)
        is_hazardous = is_used & (wrong > ALERT_LIMIT).any(axis=1)
        is_misleading = is_used & (wrong > level).any(axis=1) & ~is_hazardous
        return cls(
            n_nominal=int((is_used & ~is_misleading & ~is_hazardous).sum()),
            n_misleading=int(is_misleading.sum()),
            n_hazardous=int(is_hazardous.sum()),
            n_large=int((has_level & ~is_used).sum()),
            n_withheld=int((~has_level).sum()),
        )

    @property
    def n_used(self) -> int:
        """Epochs whose protection level is within the alert limit."""
        return self.n_nominal + self.n_exceeded

    @property
    def n_unavailable(self) -> int:
        """Epochs that are not used: no level, or one beyond the alert limit."""
        return self.n_large + self.n_withheld

    @property
    def n_exceeded(self) -> int:
        """Epochs that are used and whose error exceeds the level, hazardous or not."""
        return self.n_misleading + self.n_hazardous

    @property
    def exceeded_bound(self) -> float:
        """Upper limit, with 95 % confidence, of the rate of exceeded levels among used epochs, 0 to 1."""
        return upper_bound(self.n_exceeded, self.n_used)

    @property
    def hazardous_bound(self) -> float:
        """Upper limit, with 95 % confidence, of the rate of hazardous epochs among used ones, 0 to 1."""
        return upper_bound(self.n_hazardous, self.n_used)
