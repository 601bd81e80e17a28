# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses, frames and voxels."""

from maxcon.geometry.frame import LocalFrame
from maxcon.geometry.pose import Pose, rotation_matrices, wrap_angle
from maxcon.geometry.voxels import voxel_centers, voxel_indices

__all__ = ["LocalFrame", "Pose", "rotation_matrices", "voxel_centers", "voxel_indices", "wrap_angle"]
