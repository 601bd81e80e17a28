"""Motion between two epochs and how well it is known; a pose with its covariance, moved and adjusted by an EKF."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.scan.trajectory import Trajectory

# Of a heading that is wrong by s at the end of a motion and grew evenly or at random, the position at the end is
# off by up to s / sqrt(3) of the way.
WAY_OF_TURN = 1.0 / math.sqrt(3.0)
# Odometry jumps if it is farther from smooth than JUMPS, m and degrees per square root of a second, which is far more
# than wheels slip, and farther than braking and steering all the time explain, m/s^2 and degrees/s^2.
JUMPS, JUMPS_DEG = 0.2, 5.0
HARDEST, HARDEST_TURN_DEG = 2.5, 40.0
PLANAR = [0, 1, 5]  # x, y and heading among x, y, z, roll, pitch and heading


def check_numbers(options: Any, *, may_be_zero: bool) -> None:
    """Refuse a field of a dataclass that is negative or not finite, or 0 where that makes no sense: OptionError."""
    for field in fields(options):
        value = getattr(options, field.name)
        if not 0.0 <= value < math.inf or (value == 0.0 and not may_be_zero):
            least = ">= 0" if may_be_zero else "above 0"
            raise OptionError(f"Expected `{field.name}` {least}, got {value}. The default is {field.default}.")


@dataclass(frozen=True, slots=True)
class Motion:
    """A relative pose with the way and the time it took.

    - pose: T_before_after: where the sensor is afterwards, in its own axes before; m and rad.
    - distance: way driven, m; longer than the straight line where the drive turned.
    - seconds: time taken, s.
    - turned: turns of the heading to either side, added up, rad.
    """

    pose: Pose
    distance: float
    seconds: float
    turned: float

    @classmethod
    def none(cls) -> Self:
        """Return no motion in no time."""
        return cls(Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0)

    @classmethod
    def between(cls, before: Pose, after: Pose, seconds: float) -> Self:
        """Return the motion from one pose to another of the same trajectory, whatever its frame."""
        pose = before.inverse @ after
        return cls(pose, float(np.linalg.norm(pose.position)), seconds, abs(pose.heading))

    def then(self, following: Motion) -> Motion:
        """Return this motion and the following one as one."""
        return Motion(
            self.pose @ following.pose, self.distance + following.distance, self.seconds + following.seconds,
            self.turned + following.turned,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Standard deviations of a relative motion: what grows with the way, and what grows with the time.

    The defaults are those of wheels and a gyroscope as cars have them, doubled. OptionError if one is negative or not
    finite.

    - share: of the position, as a ratio of the way driven, in each direction: wheels are worn, or slip.
    - turn_share: of the heading, as a ratio of its turns.
    - heading_drift_deg: of the heading, degrees per second: the bias of a gyroscope.
    - heading_walk_deg: of the heading, degrees per square root of a second.
    - walk: of the position, m per square root of a second.
    - tilt_deg: of roll and pitch, degrees, however long the motion: gravity holds them.
    """

    share: float = 0.02
    turn_share: float = 0.01
    heading_drift_deg: float = 0.1
    heading_walk_deg: float = 0.2
    walk: float = 0.02
    tilt_deg: float = 0.2

    def __post_init__(self) -> None:
        check_numbers(self, may_be_zero=True)

    @classmethod
    def of_prior(cls, prior: Trajectory) -> Self:
        """Return the noise of a prior trajectory's own motion, measured by how far it is from smooth.

        The root mean square of changes of velocity over three successive poses, over sqrt(2), is held for the error of
        one increment: too much, by the acceleration. Errors that grow slowly do not show; the default noise stands for
        them, and for a prior of less than three poses.
        """
        if len(prior) < 3:
            return cls()
        steps = np.diff(prior.times)
        velocities = np.diff(prior.positions[:, :2], axis=0) / steps[:, None]
        rates = np.diff(np.unwrap(prior.angles[:, 2])) / steps
        per_root_second = np.sqrt(np.minimum(steps[1:], steps[:-1]) / 2.0)  # of two increments, one
        jumps = np.diff(velocities, axis=0) * per_root_second[:, None]
        turns = np.diff(rates) * per_root_second
        walk, turn = (float(np.sqrt(np.mean(errors**2))) for errors in (jumps, turns))
        usual = cls()
        return cls(walk=max(usual.walk, walk), heading_walk_deg=max(usual.heading_walk_deg, math.degrees(turn)))

    @classmethod
    def of_odometry(cls, odometry: Trajectory, share: float | None = None) -> Self:
        """Return the noise of odometry: the usual, with another share of the way, or what is measured where it jumps.

        It jumps where it is farther from smooth than a vehicle's acceleration explains, as a receiver's positions do.
        """
        usual, measured = cls() if share is None else cls(share=share), cls.of_prior(odometry)
        step = float(np.median(np.diff(odometry.times))) if len(odometry) > 1 else 0.0
        by_driving = math.sqrt(0.5 * step) * step * np.array([HARDEST, HARDEST_TURN_DEG])
        limits = np.maximum(by_driving, [JUMPS, JUMPS_DEG])
        jumps = bool((np.array([measured.walk, measured.heading_walk_deg]) > limits).any())
        return replace(measured, share=usual.share) if jumps else usual

    def covariance(self, motion: Motion) -> NDArray[np.float64]:
        """Covariance of a motion's x, y, z, roll, pitch and heading, in its own axes, shape (6, 6), m^2 and rad^2."""
        drift = math.radians(self.heading_drift_deg) * motion.seconds
        walk = math.radians(self.heading_walk_deg) ** 2 * motion.seconds
        heading = drift**2 + walk + (self.turn_share * motion.turned) ** 2
        way = (self.share * motion.distance) ** 2
        aside = way + WAY_OF_TURN**2 * heading * motion.distance**2
        wander = self.walk**2 * motion.seconds
        tilt = math.radians(self.tilt_deg) ** 2
        return np.diag([aside + wander, aside + wander, way + wander, tilt, tilt, heading])


@dataclass(frozen=True, slots=True, eq=False)
class UncertainPose:
    """A pose and how well it is known.

    - pose: T_map_sensor, local frame of the map.
    - covariance: shape (6, 6); of x, y, z, roll, pitch and heading, map axes, m^2, m rad and rad^2.
    """

    pose: Pose
    covariance: NDArray[np.float64]

    @property
    def planar_covariance(self) -> NDArray[np.float64]:
        """Covariance of x, y and heading, shape (3, 3)."""
        return self.covariance[np.ix_(PLANAR, PLANAR)]

    @property
    def sigma(self) -> float:
        """Standard deviation of the position in the direction that is known worst, m."""
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))

    def moved(self, motion: Motion, noise: MotionNoise) -> UncertainPose:
        """Return where the sensor is after a motion: the prediction of the filter, F P F' + G Q G'."""
        moved = self.pose @ motion.pose
        rotation = self.pose.rotation
        way = rotation @ motion.pose.position
        cosine, sine = math.cos(self.pose.heading), math.sin(self.pose.heading)
        axes = np.array([rotation[:, 0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])  # of roll, pitch and heading
        by_state = np.eye(6)
        by_state[:3, 3:] = np.cross(axes, way).T
        # Tilts stay where they are while the sensor turns; to first order in the tilt.
        turn = motion.pose.heading
        by_state[3:5, 3:5] = [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
        by_motion = np.eye(6)
        by_motion[:3, :3] = rotation
        covariance = by_state @ self.covariance @ by_state.T + by_motion @ noise.covariance(motion) @ by_motion.T
        return UncertainPose(moved, covariance)

    def adjusted(self, measured: Pose, covariance: NDArray[np.float64]) -> UncertainPose:
        """Return the pose that a measurement of it leaves: the update of the filter, in Joseph's form.

        - measured: local frame.
        - covariance: shape (6, 6); of the measurement; what it does not measure has an infinite variance.
        """
        known = np.flatnonzero(np.isfinite(np.diag(covariance)))
        observed = np.eye(6)[known]
        noise = covariance[np.ix_(known, known)]
        gain = np.linalg.solve(observed @ self.covariance @ observed.T + noise, observed @ self.covariance).T
        left = np.eye(6) - gain @ observed
        pose = Pose(*(self.pose.values + gain @ measured.less(self.pose)[known]).tolist())
        return UncertainPose(pose, left @ self.covariance @ left.T + gain @ noise @ gain.T)
