"""What maximum consensus is compared with: iterative methods that need a start, all with `localize` (D6)."""

from maxcon.lab.baselines.gicp import CountThenGicp, Gicp, check_small_gicp
from maxcon.lab.baselines.icp import Icp, Residual
from maxcon.lab.baselines.map_targets import MapTargets
from maxcon.lab.baselines.started import Aligner, Choice, MultiStart, StartedMethod

__all__ = [
    "Aligner", "Choice", "CountThenGicp", "Gicp", "Icp", "MapTargets", "MultiStart", "Residual", "StartedMethod",
    "check_small_gicp",
]  # fmt: skip
