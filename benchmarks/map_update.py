# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What does `maxcon map update` find of the cars that left and came, and what is localization worth in its map?

python benchmarks/map_update.py drives FOLDER [--seed 0] [--epochs 101]
python benchmarks/map_update.py objects MAP MAP2 --clouds 'campaign/map/*.laz' --drive SCANS POSES.csv [--seed 0]
python benchmarks/map_update.py localization MAP [MAP2 ...] --drive FOLDER/same-day [--without-new]
python benchmarks/map_update.py picture MAP2 -o picture.png [--area X_MIN,Y_MIN,X_MAX,Y_MAX]

`drives` simulates two more drives through a campaign: on the day of its scans, with other noise, speeds and priors; and
on the day after, when other cars are parked. `objects` holds an updated map against the simulation's truth:

- A voxel of MAP has vanished if at least half of its points are of class vehicle (the clouds say it), and no car of
  the day of the scans is within 15 cm (exact, to its triangles), nor the carriageway. It is in sight if from at least
  three observations of the drive, nearer than 15 m, a ray to its middle meets nothing before 15 cm behind it.
- A voxel is new if on at least three a point of class vehicle fell in it, and MAP has nothing within two voxels.
- A called voxel is right if it has vanished, or lies within 15 cm of a car of the day of the scans.
- A car is found if at least half of its voxels are called. An object called is right if half of its voxels are: called
  voxels in cubes of 24 cm that touch, at least 50 of them.

Cars farther than 10 m from the mapping vehicle's path, in streets that it only passed, count in the lines "anywhere".
"""

import argparse
from pathlib import Path

import laspy
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from maxcon import MaximumConsensus, PointMap, Scan, SearchSpace
from maxcon.drive.localize import DriveOptions
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import open_drives
from maxcon.lab.simulation.datasets import CITY_ORIGIN, write_epochs
from maxcon.lab.simulation.furniture import LasClass, draw_car
from maxcon.lab.simulation.scanners import RotatingScanner
from maxcon.lab.simulation.worlds import EPOCH_STEP, MOST_EPOCHS, SCAN_START, CampaignWorld
from maxcon.map.layout import ALL_BUT_KNOWN, NOT_SEARCHED, SurfaceClass
from maxcon.mapping.build import Area
from maxcon.mapping.update import UpdateOptions
from maxcon.mapping.update.observations import observations_of
from maxcon.search.accumulator import SearchMethod

NEAR, NEAR_ROAD = 0.15, 0.15
SIGHT, LEAST_LOOKS = 15.0, 3
MAPPED = 10.0
LEAST_OBJECT = 50
SPACE = SearchSpace(3.0, 0.06, 3.0, 0.5)  # exhaustively: the runner-up is exact then


def simulate_drives(args):
    world, scanner = CampaignWorld.build(args.seed), RotatingScanner()
    for name, number, day in (("same-day", 1, 1), ("next-day", 2, 2)):
        again = world.again(number, day)
        epochs = again.epochs(args.epochs)
        folder = args.folder / name
        folder.mkdir(parents=True)
        priors = {"prior_gnss.txt": again.gnss_priors(epochs)}
        write_epochs(folder, epochs, (again.scan(epoch, scanner) for epoch in epochs), priors)
        print(f"{folder}: {len(epochs)} scans")


def localize(args):
    """Every epoch of a drive in every map: how many are right, and how distinct."""
    scans, options = open_scans(args.drive / "scans"), DriveOptions()
    method = MaximumConsensus(SPACE, search=SearchMethod.EXHAUSTIVE)
    prior, reference = (read_trajectory(args.drive / f"{name}.txt") for name in ("prior_gnss", "reference"))
    left_out = ALL_BUT_KNOWN if args.without_new else NOT_SEARCHED
    print("map                    localized  wrong   median m    95 % m   runner-up: median      90 %   score")
    for path in args.maps:
        point_map, rows = PointMap.open(path, left_out=left_out), []
        for i in range(0, len(scans), args.every):
            time = float(scans.times[i])
            raw = scans.read(i, options.min_range, options.max_range)
            estimate = method.localize(Scan(raw.points), point_map, point_map.frame.pose_to_local(prior.at(time)))
            truth = point_map.frame.pose_to_local(reference.at(time))
            error = float(np.hypot(estimate.pose.x - truth.x, estimate.pose.y - truth.y))
            rows.append((estimate.is_localized, error, estimate.runner_up, estimate.score))
        is_localized, errors, runners_up, scores = np.array(rows).T
        wrong = int(((errors > 0.3) & (is_localized > 0)).sum())
        print(
            f"{Path(path).name:<20} {int(is_localized.sum()):5} of {len(rows):<4} {wrong:3}"
            f" {np.median(errors):10.3f} {np.quantile(errors, 0.95):9.3f} {np.median(runners_up):16.3f}"
            f" {np.quantile(runners_up, 0.9):13.3f} {np.median(scores):9.1f}",
            flush=True,
        )


def numbers(voxels):
    """One number for each voxel."""
    x, y, z = (voxels.astype(np.int64) + 2**20).T
    return (x << 42) | (y << 21) | z


def is_in(wanted, there):
    """Whether each number is among sorted ones."""
    place = np.minimum(np.searchsorted(there, wanted), len(there) - 1)
    return there[place] == wanted


def voxels_of(path):
    """Indices, counts and classes of all voxels of a map, and the map."""
    point_map = PointMap.open(path, left_out=None)
    tiles = [point_map.tile(key) for key in sorted(point_map.tile_keys)]
    classes = [tile.surface_classes for tile in tiles]
    voxels, counts = (np.concatenate([getattr(tile, name) for tile in tiles]) for name in ("voxels", "counts"))
    return point_map, voxels, counts, np.concatenate(classes)


def vehicle_points(pattern, origin, cell):
    """Numbers of the voxels with points of class vehicle, sorted, and how many points."""
    parts = []
    for path in sorted(Path(pattern).parent.glob(Path(pattern).name)):
        with laspy.open(path) as reader:
            for chunk in reader.chunk_iterator(2_000_000):
                is_vehicle = np.asarray(chunk.classification) == LasClass.VEHICLE
                points = np.column_stack([chunk.x, chunk.y, chunk.z])[is_vehicle] - origin
                parts.append(np.unique(numbers(np.floor(points / cell)), return_counts=True))
    there, which = np.unique(np.concatenate([part[0] for part in parts]), return_inverse=True)
    return there, np.bincount(which, weights=np.concatenate([part[1] for part in parts]))


def distances_to_triangle(points, triangle):
    """Squared distances of points, (n, 3), to a triangle, (3, 3); infinite to one without an area."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    area = normal @ normal
    if area < 1e-16:
        return np.full(len(points), np.inf)
    from_a = points - a
    squared = (from_a @ normal) ** 2 / area
    v = np.cross(b - a, from_a) @ normal / area
    w = -np.cross(c - a, from_a) @ normal / area
    is_beside = np.flatnonzero((v < 0.0) | (w < 0.0) | (v + w > 1.0))
    if len(is_beside):
        squared[is_beside] = np.inf
        for start, end in ((a, b), (b, c), (c, a)):
            way, rest = end - start, points[is_beside] - start
            rest -= np.clip(rest @ way / (way @ way), 0.0, 1.0)[:, None] * way
            squared[is_beside] = np.minimum(squared[is_beside], (rest * rest).sum(axis=1))
    return squared


def nearest_cars(points, city, reach=0.3):
    """Distance of each point, city metres, to the nearest parked car, and its number: inf and -1 beyond reach."""
    distances, cars = np.full(len(points), np.inf), np.full(len(points), -1)
    tree = cKDTree(points[:, :2])
    n_of_car = len(draw_car(np.random.default_rng(0))[0])  # all cars have as many triangles
    for car, triangles in enumerate(city.corners[city.classes == LasClass.VEHICLE].reshape(-1, n_of_car, 3, 3)):
        low, high = triangles.min(axis=(0, 1)) - reach, triangles.max(axis=(0, 1)) + reach
        rows = np.array(tree.query_ball_point((low + high)[:2] / 2, np.linalg.norm((high - low)[:2]) / 2), int)
        rows = rows[((points[rows] >= low) & (points[rows] <= high)).all(axis=1)] if len(rows) else rows
        if len(rows):
            squared = np.min([distances_to_triangle(points[rows], each) for each in triangles], axis=0)
            nearer = (squared < distances[rows] ** 2) & (squared <= reach**2)
            distances[rows[nearer]], cars[rows[nearer]] = np.sqrt(squared[nearer]), car
    return distances, cars


def are_in_sight(points, origins, caster):
    """Whether each point, city metres, is in plain sight from at least three of the places, and nothing is there."""
    tree, seen = cKDTree(points), np.zeros(len(points), int)
    for origin in origins:
        rows = np.array(tree.query_ball_point(origin, SIGHT), int)
        if len(rows):
            way = points[rows] - origin
            far = np.linalg.norm(way, axis=1)
            directions = (way / far[:, None]).astype(np.float32)
            hits = caster.cast(np.broadcast_to(origin, way.shape).astype(np.float32), directions)
            seen[rows] += (hits.triangles < 0) | (hits.ranges > far + NEAR)
    return seen >= LEAST_LOOKS


def scan_points_on_cars(world, observations, ticks, origin, cell, reach):
    """Numbers of the voxels that points on cars fell in on at least three observations: in truth, sorted."""
    scanner, parts = RotatingScanner(), []
    epochs = world.epochs(MOST_EPOCHS)
    for tick in ticks:
        returns = world.scan(epochs[tick], scanner)
        is_chosen = returns.classes == LasClass.VEHICLE
        is_chosen &= np.linalg.norm(returns.points - returns.origins, axis=1) <= reach
        points = returns.points[is_chosen] + CITY_ORIGIN - origin
        parts.append(np.unique(numbers(np.floor(points / cell))))
    there, n_looks = np.unique(np.concatenate(parts), return_counts=True)
    return there[n_looks >= LEAST_LOOKS]


def voxels_from(there):
    """Voxels of numbers."""
    return np.stack([there >> 42, (there >> 21) & 0x1FFFFF, there & 0x1FFFFF], axis=1) - 2**20


def has_near(voxels, there, reach):
    """Whether any of the voxels with sorted numbers lies so near to each voxel, along each axis."""
    found, span = np.zeros(len(voxels), bool), range(-reach, reach + 1)
    for dx in span:
        for dy in span:
            for dz in span:
                rows = np.flatnonzero(~found)
                found[rows] = is_in(numbers(voxels[rows] + [dx, dy, dz]), there)
    return found


def right_objects(voxels, is_right):
    """How many called objects there are, and how many are right."""
    cubes, cube = np.unique(voxels // 4, axis=0, return_inverse=True)
    pairs = cKDTree(cubes).query_pairs(1.5, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(cubes), len(cubes)))
    members = connected_components(links, directed=False)[1][cube.reshape(-1)]
    sizes, right = np.bincount(members), np.bincount(members, weights=is_right)
    is_object = sizes >= LEAST_OBJECT
    return int(is_object.sum()), int((right[is_object] >= 0.5 * sizes[is_object]).sum())


def found_cars(cars, is_called):
    """How many cars there are by their voxels, at least 50, and how many have at least half of them called."""
    sizes, called = np.bincount(cars), np.bincount(cars, weights=is_called)
    is_car = sizes >= LEAST_OBJECT
    return int(is_car.sum()), int((called[is_car] >= 0.5 * sizes[is_car]).sum())


def print_recall(name, rows, car, is_called):
    is_of_car = rows & (car >= 0)
    n_cars, n_found = found_cars(car[is_of_car], is_called[is_of_car])
    voxels = share(int(is_called[rows].sum()), int(rows.sum()))
    print(f"  recall, {name:<18}: voxels {voxels}, cars {share(n_found, n_cars)}")


def share(part, whole):
    return f"{part:,} of {whole:,} ({part / max(whole, 1):.3f})"


def hold_against_truth(args):
    world, options = CampaignWorld.build(args.seed), UpdateOptions()
    point_map, voxels, counts, _ = voxels_of(args.map)
    _, after, _, classes = voxels_of(args.map2)
    origin, cell = np.array(point_map.frame.origin), point_map.cell
    to_city = origin - CITY_ORIGIN
    drives = open_drives(args.drive)
    observations = observations_of(drives, point_map.frame, options)
    ticks = [round((each.time - SCAN_START) / EPOCH_STEP) for each in observations]
    references = [epoch.reference.position for epoch in world.epochs(MOST_EPOCHS)]
    path = cKDTree(np.array([pose.position[:2] for pose in world.mapping.poses()[1][::25]]))
    known = np.sort(numbers(voxels))

    there, n_points = vehicle_points(args.clouds, origin, cell)
    place = np.minimum(np.searchsorted(there, numbers(voxels)), len(there) - 1)
    is_car = (there[place] == numbers(voxels)) & (2 * n_points[place] >= counts)
    middles = (voxels[is_car] + 0.5) * cell + to_city
    distances, _ = nearest_cars(middles, world.scan_caster.city)
    has_vanished = (distances > NEAR) & (middles[:, 2] > NEAR_ROAD)
    vanished, middles = voxels[is_car][has_vanished], middles[has_vanished]
    _, car = nearest_cars(middles, world.mapping.caster.city)
    is_near_path = path.query(middles[:, :2])[0] <= MAPPED
    in_sight = are_in_sight(middles, [references[tick] for tick in ticks], world.scan_caster)
    gone = after[classes == SurfaceClass.GONE]
    is_called = is_in(numbers(vanished), np.sort(numbers(gone)))
    is_right = is_in(numbers(gone), np.sort(numbers(vanished)))
    is_of_car = is_in(numbers(gone), np.sort(numbers(voxels[is_car])))
    print(
        f"gone: {len(gone):,} voxels called, {int((~is_of_car).sum()):,} of them of what is no car;"
        f" {len(voxels) - int(is_car.sum()):,} voxels are of none"
    )
    print("  precision, voxels ", share(int(is_right.sum()), len(gone)))
    print("  precision, objects", share(*right_objects(gone, is_right)[::-1]))
    for name, rows in (
        ("in sight", in_sight & is_near_path),
        ("in sight, anywhere", in_sight),
        ("all", is_near_path),
        ("all, anywhere", in_sight | True),
    ):
        print_recall(name, rows, car, is_called)

    new = after[classes == SurfaceClass.NEW]
    middles = (new + 0.5) * cell + to_city
    is_right = nearest_cars(middles, world.scan_caster.city)[0] <= NEAR
    print(f"new: {len(new):,} voxels called")
    print("  precision, voxels ", share(int(is_right.sum()), len(new)))
    print("  precision, objects", share(*right_objects(new, is_right)[::-1]))
    seen = voxels_from(scan_points_on_cars(world, observations, ticks, origin, cell, options.reach))
    seen = seen[~has_near(seen, known, 2)]
    middles = (seen + 0.5) * cell + to_city
    _, car = nearest_cars(middles, world.scan_caster.city)
    is_near_path = path.query(middles[:, :2])[0] <= MAPPED
    is_called = has_near(seen, np.sort(numbers(new)), 1)
    for name, rows in (("seen", is_near_path), ("seen, anywhere", is_near_path | True)):
        print_recall(name, rows, car, is_called)


def draw(args):
    """From above: what is known grey, what is gone red, what is new green."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    point_map, voxels, _, classes = voxels_of(args.map2)
    x, y = ((voxels[:, :2] + 0.5) * point_map.cell).T
    if args.area:
        is_inside = Area.parse(args.area).contains(np.column_stack([x, y]))
        x, y, classes = x[is_inside], y[is_inside], classes[is_inside]
    figure, axes = plt.subplots(figsize=(9.0, 9.0), layout="constrained")
    for which, colour, size in (
        (SurfaceClass.KNOWN, "0.72", 0.15), (SurfaceClass.GONE, "#d55e00", 0.4), (SurfaceClass.NEW, "#0072b2", 0.4),
    ):  # fmt: skip
        rows = classes == which
        axes.scatter(x[rows], y[rows], s=size, c=colour, linewidths=0, rasterized=True, label=which.name.lower())
    axes.set(aspect="equal", xlabel="x, m", ylabel="y, m")
    axes.legend(markerscale=20, loc="upper right")
    figure.savefig(args.out, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("drives")
    one.add_argument("folder", type=Path)
    one.add_argument("--epochs", type=int, default=101)
    one.set_defaults(run=simulate_drives)
    two = commands.add_parser("objects")
    two.add_argument("map")
    two.add_argument("map2")
    two.add_argument("--clouds", required=True)
    two.add_argument("--drive", nargs="+", required=True)
    two.set_defaults(run=hold_against_truth)
    for each in (one, two):
        each.add_argument("--seed", type=int, default=0)
    three = commands.add_parser("localization")
    three.add_argument("maps", nargs="+")
    three.add_argument("--drive", type=Path, required=True)
    three.add_argument("--every", type=int, default=1)
    three.add_argument("--without-new", action="store_true")
    three.set_defaults(run=localize)
    four = commands.add_parser("picture")
    four.add_argument("map2")
    four.add_argument("-o", "--out", required=True)
    four.add_argument("--area")
    four.set_defaults(run=draw)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
