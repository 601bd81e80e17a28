"""A street of boxes: what a map of it holds, and what a scanner sees of it on a drive."""

import numpy as np

from maxcon import PointMap, Pose
from maxcon.export import PoseRow
from maxcon.io.raw_scan import RawScan

WALL = ((-2.0, 6.0, 0.0), (32.0, 6.4, 5.0))
ROAD = ((-2.0, -4.0, -0.3), (32.0, 6.0, 0.0))
CAR = ((8.0, 2.5, 0.2), (12.0, 4.3, 1.5))
OTHER_CAR = ((18.0, 2.5, 0.2), (22.0, 4.3, 1.5))
CELL = 0.06


def surface(box, step=0.03):
    """Points on the sides of a box, but for the bottom, and their normals outwards."""
    low, high = np.array(box)
    points, normals = [], []
    for axis in range(3):
        a, b = [other for other in range(3) if other != axis]
        grid = np.stack(
            np.meshgrid(np.arange(low[a], high[a], step), np.arange(low[b], high[b], step), indexing="ij"), -1
        )
        for side, place in ((-1.0, low[axis]), (1.0, high[axis]))[axis == 2 :]:
            face = np.empty((*grid.shape[:2], 3))
            face[..., axis], face[..., a], face[..., b] = place, grid[..., 0], grid[..., 1]
            points.append(face.reshape(-1, 3))
            normal = np.zeros((grid.shape[0] * grid.shape[1], 3))
            normal[:, axis] = side
            normals.append(normal)
    return np.concatenate(points), np.concatenate(normals)


def inside(points, box, margin=0.1):
    low, high = np.array(box)
    return ((points >= low - margin) & (points <= high + margin)).all(axis=1)


def map_of(*boxes):
    """Map of boxes that stand on the road; the road itself is known as ground only."""
    points, normals = (np.concatenate(parts) for parts in zip(*map(surface, boxes), strict=True))
    return PointMap.from_points(points, normals, CELL, ground=road())


def road():
    x, y = np.meshgrid(np.arange(-2.0, 32.0, 0.1), np.arange(-4.0, 6.0, 0.1))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def ranges(origin, directions, boxes):
    """How far rays go until they meet a box; infinite for none."""
    nearest = np.full(len(directions), np.inf)
    for low, high in boxes:
        with np.errstate(divide="ignore", invalid="ignore"):
            one = (np.array(low) - origin) / directions
            other = (np.array(high) - origin) / directions
        enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
        is_met = (enter <= leave) & (enter > 0.0)
        nearest = np.where(is_met, np.minimum(nearest, enter), nearest)
    return nearest


class DriveOfBoxes:
    """Scans along the street, each with its own boxes beside the wall and the road: those of its time."""

    def __init__(self, boxes_at, n=40, seed=0, noise=0.01, start=1000.0):
        self._rng = np.random.default_rng(seed)
        self._boxes_at, self._noise = boxes_at, noise
        self.times = start + 0.25 * np.arange(n)
        self.poses = [Pose(0.75 * i, 0.0, 1.9, 0.0, 0.0, 0.0) for i in range(n)]
        azimuth, elevation = np.meshgrid(np.radians(np.arange(0, 360.0, 0.5)), np.radians(np.arange(-24.0, 10.0, 1.0)))
        self._directions = np.stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1
        ).reshape(-1, 3)

    def __len__(self):
        return len(self.times)

    def name(self, i):
        return f"{i:06d}"

    def points(self, i):
        origin = self.poses[i].position
        far = ranges(origin, self._directions, [WALL, ROAD, *self._boxes_at(self.times[i] - self.times[0])])
        is_met = far < 60.0  # what does not come back is not in a scan
        noise = self._noise * np.random.default_rng([7, i]).standard_normal(is_met.sum())
        return self._directions[is_met] * (far[is_met] + noise)[:, None]

    def read(self, i, min_range=1.0, max_range=120.0):
        points = self.points(i)
        return RawScan(points, float(self.times[i]), self.name(i), len(points), 0, 0)

    def rows(self):
        return tuple((i, PoseRow(float(t), self.poses[i], "localized", "", {})) for i, t in enumerate(self.times))

    def write(self, folder):
        """Write scans and POSES.csv; return both paths."""
        import csv

        from maxcon.drive.poses_table import COLUMNS, UNKNOWNS

        (folder / "scans").mkdir(parents=True)
        for i in range(len(self)):
            points = self.points(i)
            rows = np.column_stack([points, np.zeros(len(points))]).astype("<f4")
            (folder / f"scans/{i:06d}.bin").write_bytes(rows.tobytes())
        (folder / "scans/times.txt").write_text("".join(f"{t:.6f}\n" for t in self.times))
        with (folder / "poses.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            for t, pose in zip(self.times, self.poses, strict=True):
                row = dict.fromkeys(COLUMNS, "") | {"time": f"{t:.9f}", "status": "localized"}
                row |= dict(zip(UNKNOWNS, map(repr, pose.values.tolist()), strict=True))
                writer.writerow(row.values())
        return folder / "scans", folder / "poses.csv"
