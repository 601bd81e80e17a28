"""Pictures of an epoch, of poses and of a drive; they need ``pip install 'maxcon[demo]'``."""

from maxcon.plotting.epoch import plot_epoch
from maxcon.plotting.poses import plot_drive, plot_poses

__all__ = ["plot_drive", "plot_epoch", "plot_poses"]
