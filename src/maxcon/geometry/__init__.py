"""Poses, frames and voxels."""

from maxcon.geometry.pose import (
    LocalFrame,
    Pose,
    interpolate_poses,
    rotation_matrices,
    voxel_centers,
    voxel_indices,
    wrap_angle,
)

__all__ = [
    "LocalFrame", "Pose", "interpolate_poses", "rotation_matrices", "voxel_centers", "voxel_indices", "wrap_angle",
]  # fmt: skip
