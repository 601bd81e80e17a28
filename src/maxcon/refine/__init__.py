"""From the best cell to a continuous pose, and how well that is known."""

from maxcon.refine.adjustment import HEIGHT_SIGMA, TILT_SIGMA, Refined, covariance, map_covariance, refine
from maxcon.refine.ground import GroundFit, fit_ground, fit_ground_plane, pose_above_ground
from maxcon.refine.validation import WallShare, least_wall_share, validate

__all__ = [
    "HEIGHT_SIGMA", "TILT_SIGMA", "GroundFit", "Refined", "WallShare", "covariance", "fit_ground", "fit_ground_plane",
    "least_wall_share", "map_covariance", "pose_above_ground", "refine", "validate",
]  # fmt: skip
