# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Localize one scan in a map made of points with normals: the whole library in thirty lines."""

import numpy as np

import maxcon


def room(spacing: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of a street of 8 m with a house across its end: the map."""
    along, up = (axis.ravel() for axis in np.meshgrid(np.arange(-20, 20, spacing), np.arange(0, 5, spacing)))
    across = np.arange(-4, 4, spacing)
    end, height = (axis.ravel() for axis in np.meshgrid(across, np.arange(0, 5, spacing)))
    points = [np.column_stack([along, np.full_like(along, side), up]) for side in (-4.0, 4.0)]
    points.append(np.column_stack([np.full_like(end, 20.0), end, height]))
    normals = [np.tile([0.0, -side, 0.0], (len(along), 1)) for side in (-1.0, 1.0)]
    normals.append(np.tile([-1.0, 0.0, 0.0], (len(end), 1)))
    return np.concatenate(points), np.concatenate(normals)


def main() -> None:
    points, normals = room()
    point_map = maxcon.PointMap.from_points(points, normals, cell=0.06)

    true_pose = maxcon.Pose(x=5.0, y=0.5, z=1.8, roll=0.0, pitch=0.0, heading=0.4)
    seen = np.random.default_rng(0).choice(len(points), 4000, replace=False)
    points_sensor = (points[seen] - true_pose.position) @ true_pose.rotation
    scan = maxcon.Scan(points_sensor, normals[seen] @ true_pose.rotation)

    prior = maxcon.Pose(x=6.2, y=-0.7, z=1.8, roll=0.0, pitch=0.0, heading=0.4 + np.radians(1.5))
    space = maxcon.SearchSpace(half_width=3.0, cell=0.06, heading_half_width_deg=2.0, heading_step_deg=0.5)
    method = maxcon.MaximumConsensus(space, objective=maxcon.Helmert(), multiplicity="occupied")
    estimate = method.localize(scan, point_map, prior)

    print(f"{estimate.status}: x {estimate.pose.x:.2f} m, y {estimate.pose.y:.2f} m")
    print(f"heading {np.degrees(estimate.pose.heading):.1f} degrees, score {estimate.score:.0f}")
    print(f"the prior was {np.hypot(prior.x - 5.0, prior.y - 0.5):.2f} m off")


if __name__ == "__main__":
    main()
