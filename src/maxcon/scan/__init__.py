"""Scans: their points, normals and times, how they are mounted, and the trajectories they were taken on."""

from maxcon.scan.scan import Scan, one_per_cube

__all__ = ["Scan", "one_per_cube"]
