"""`maxcon map georeference`: a map in coordinates of its own gets those of a CRS, and says how well it is placed."""

import csv
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxcon import PointMap, Trajectory
from maxcon.errors import CrsError, OptionError, TrajectoryError
from maxcon.io.crs import GeographicFrame
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.map.manifest import read_manifest
from maxcon.mapping.georeference import georeference, places_of_fixes
from street_of_boxes import CAR, WALL, map_of
from written_maps import run, stored_voxels, write

TO = np.array([458_860.0, 5_429_160.0, 115.0])
TURN = Rotation.from_euler("ZYX", [137.0, 1.5, -1.0], degrees=True)
LEVER = np.array([0.8, -0.4, 1.2])  # of the antenna in the scanner's frame, m
LEVEL = math.radians(0.1)
COMMAND = ("map", "georeference")


def way(kind, n):
    """Places of a drive, (n, 3), m."""
    part = np.linspace(0.0, 1.0, n)
    if kind == "corner":  # 600 m, then 400 m to the left
        columns = np.minimum(1000.0 * part, 600.0), np.maximum(1000.0 * part - 600.0, 0.0), 2.0 * np.sin(5.0 * part)
    elif kind == "line":
        columns = 1000.0 * part, 1.5 * np.sin(30.0 * part), np.sin(11.0 * part)
    else:  # within a few metres
        columns = 3.0 * np.cos(6.0 * part), 3.0 * np.sin(6.0 * part), 0.2 * np.sin(20.0 * part)
    return np.column_stack(columns)


def drive(seed, kind="corner", n=1000, noise=2.0, outliers=0.05, alike=0.0, turn=TURN, lever=0.0, scale=1.0):
    """Poses in the map, ten a second, and fixes of their antenna in the CRS."""
    rng, times, places = np.random.default_rng(seed), 100.0 + 0.1 * np.arange(n), way(kind, n)
    courses = np.gradient(places, axis=0)
    turns = Rotation.from_rotvec(np.arctan2(courses[:, 1], courses[:, 0])[:, None] * [0.0, 0.0, 1.0])
    errors = rng.normal(size=(n, 3))
    for i in range(1, n):
        errors[i] = alike * errors[i - 1] + math.sqrt(1.0 - alike * alike) * errors[i]
    fixes = scale * turn.apply(places + turns.apply(lever * LEVER)) + TO + noise * errors
    is_off = rng.random(n) < outliers
    fixes[is_off] += rng.uniform(-100.0, 100.0, (is_off.sum(), 3))
    poses = Trajectory(times, places, turns.as_quat())
    return poses, Trajectory(times, fixes, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)))


def errors_of(found, places, turn=TURN, scale=1.0):
    """How far the middle of the drive, and that of the answer, are off, (3,), m, and the turns about the axes, rad."""
    middle = places.mean(axis=0)
    ends = np.array([middle, found.middle])
    shifts = found.apply(ends) - turn.apply(scale * middle + ends - middle) - TO
    return *shifts, (Rotation.from_matrix(found.rotation) * turn.inv()).as_rotvec()


@pytest.mark.parametrize(("alike", "scale"), [(0.0, 1.002), (0.9, 1.0)])
def test_a_kilometre_of_poor_fixes_places_a_map_and_tells_how_well(alike, scale):
    """1000 fixes of 2 m, one in 20 of them anywhere within 100 m; sigmas are right within a factor of 1.5.

    The map is 0.2 % too small, or fixes err alike for a second.
    """
    poses = drive(0)[0]
    shifts, turns, sizes = [], [], []
    for seed in range(5):
        found = georeference((places_of_fixes(poses, drive(seed, alike=alike, scale=scale)[1]),))
        shift, own_shift, turn = errors_of(found, poses.positions, scale=scale)
        shifts.append(np.linalg.norm(shift))
        turns.append(np.degrees(np.abs(turn)))
        sizes.append(np.append(own_shift, turn) / np.sqrt(np.diag(found.covariance)))
    if not alike:
        assert np.quantile(shifts, 0.9) < 0.3
        assert np.quantile(np.array(turns)[:, 2], 0.9) < 0.05  # the heading
        assert np.median(np.linalg.norm(turns, axis=1)) < 0.05  # of all turns; the roll about the longer side is worst
    assert 1.0 / 1.5 < np.sqrt(np.mean(np.square(sizes))) < 1.5
    assert found.are_outliers.sum() == pytest.approx(50, abs=15)


def test_what_the_geometry_does_not_tell_is_refused_unless_it_is_said():
    for kind, noise, words in (("line", 2.0, "its roll about a line at"), ("spot", 2.0, "within")):
        poses, fixes = drive(0, kind, noise=noise)
        with pytest.raises(OptionError, match=words):
            georeference((places_of_fixes(poses, fixes),))
    level = Rotation.from_euler("z", 40.0, degrees=True)
    poses, fixes = drive(0, "line", turn=level)
    found = georeference((places_of_fixes(poses, fixes),), level_sigma=LEVEL)
    shift, _, turn = errors_of(found, poses.positions, level)
    assert np.linalg.norm(shift) < 0.3
    assert np.degrees(np.abs(turn)).max() < 0.1
    with pytest.raises(TrajectoryError, match=r"at least 10 fixes.*got 9 of 9"):
        places_of_fixes(*drive(0, n=9))
    late = Trajectory(fixes.times + 1e4, fixes.positions, fixes.quaternions_xyzw)
    with pytest.raises(TrajectoryError, match=r"got 0 of 1000.*the same clock"):
        places_of_fixes(poses, late)


def test_a_scale_is_found_if_it_is_asked_for():
    poses, fixes = drive(0, noise=0.2, scale=1.002)
    assert georeference((places_of_fixes(poses, fixes),), with_scale=True).scale == pytest.approx(1.002, abs=1e-4)


# --- the command ---
@pytest.fixture(scope="module")
def slam(tmp_path_factory):
    """A street's map in coordinates of its own, the way of the scanner in it, fixes of the antenna, control points."""
    folder = tmp_path_factory.mktemp("slam")
    write(folder / "slam.map", map_of(WALL, CAR), origin=(0.0, 0.0, 0.0))
    poses, fixes = drive(3, n=400, noise=0.02, lever=1.0)
    write_tum(folder / "poses.tum", poses)
    write_tum(folder / "fixes.tum", fixes)
    (folder / "antenna.toml").write_text(f"[sensor]\nposition = [0, 0, 1.8]\n[prior]\nposition = {[0.8, -0.4, 3.0]}\n")
    places = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 1.0], [30.0, 6.0, 5.0], [0.0, 6.0, 2.0]])
    with (folder / "control.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "x", "y", "z", "east", "north", "height"])
        writer.writerows([f"p{i}", *row] for i, row in enumerate(np.hstack([places, TURN.apply(places) + TO]).tolist()))
    return folder


def test_the_new_map_has_the_same_surfaces_where_they_belong(slam, tmp_path):
    """By fixes with a lever arm, and by control points: surfaces within a centimetre, normals and ground with them."""
    gnss = ("--gnss", slam / "fixes.tum", "--trajectory", slam / "poses.tum", "--mounting", slam / "antenna.toml")
    for name, given in (("gnss", gnss), ("control", ("--control", slam / "control.csv"))):
        out = tmp_path / f"{name}.map"
        run(*COMMAND, slam / "slam.map", *given, "--crs", "EPSG:25832", "-o", out)
        before, _, of_before, _ = stored_voxels(slam / "slam.map")
        means, _, normals, _ = stored_voxels(out)
        back = TURN.inv().apply(means - TO)
        on_wall = (np.abs(back[:, 1] - 6.0) < 0.05) & (back[:, 2] > 0.3) & (back[:, 2] < 4.7)
        assert on_wall.sum() >= 0.95 * ((np.abs(before[:, 1] - 6.0) < 0.03) & (before[:, 2] > 0.3)).sum()
        assert np.quantile(np.abs(back[on_wall, 1] - 6.0), 0.98) < 0.01  # beside corners there are others
        assert np.median(TURN.inv().apply(normals[on_wall])[:, 1]) < -0.999
        assert of_before[:, 1].min() < -0.999
        new = PointMap.open(out)
        place = new.frame.to_local([TURN.apply([10.0, 0.0, 0.0]) + TO])[0]
        assert new.ground_around(*place[:2], 0.3).heights[0] == pytest.approx(place[2], abs=0.03)
        said = read_manifest(out)
        assert "ETRS89 / UTM zone 32N" in said.crs
        assert said.build["georeference"]["parent"]["name"] == "slam.map"
        assert said.sigma == pytest.approx(np.hypot(0.02, said.build["georeference"]["sigma"]), abs=1e-4)


def test_residuals_are_a_table_and_a_picture_and_poses_are_moved_along(slam, tmp_path):
    both = ("--gnss", slam / "fixes.tum", "--trajectory", slam / "poses.tum", "--mounting", slam / "antenna.toml")
    table, picture, poses = tmp_path / "residuals.csv", tmp_path / "residuals.png", tmp_path / "poses.tum"
    said = run(
        *COMMAND, slam / "slam.map", *both, "--control", slam / "control.csv", "--crs", "EPSG:25832", "-o",
        tmp_path / "a.map", "--residuals", table, "--picture", picture, "--poses-out", poses,
    )  # fmt: skip
    rows = list(csv.DictReader(table.open(newline="")))
    assert len(rows) == 404 and [row["name"] for row in rows[:4]] == ["p0", "p1", "p2", "p3"]
    n_outliers = sum(row["is_outlier"] == "1" for row in rows)
    assert f"{n_outliers} of 404 places are outliers" in said
    assert n_outliers == pytest.approx(20, abs=10) and picture.read_bytes()[:4] == b"\x89PNG"
    wanted = TURN.apply(read_trajectory(slam / "poses.tum").positions.copy()) + TO
    assert np.abs(read_trajectory(poses).positions - wanted).max() < 0.02


def test_poses_follow_a_map_that_control_points_place_and_outliers_have_names(slam, tmp_path):
    text, poses, moved = (slam / "control.csv").read_text(), slam / "poses.tum", tmp_path / "poses.tum"
    *numbers, height = text.split()[-1].split(",")[1:]
    (tmp_path / "off.csv").write_text(text + ",".join(["p9", *numbers, f"{float(height) + 0.5}"]))
    level = ("--level-sigma-deg", "0.3", "--crs", "EPSG:25832", "-o", tmp_path / "a.map")
    what = ("--control", tmp_path / "off.csv", "--trajectory", poses, "--poses-out", moved)
    said = run(*COMMAND, slam / "slam.map", *what, *level)
    assert "1 of 5 places are outliers (p9)" in said
    wanted = TURN.apply(read_trajectory(poses).positions.copy()) + TO
    assert np.abs(read_trajectory(moved).positions - wanted)[:50].max() < 0.1


@pytest.mark.parametrize(("crs", "accuracy"), [("EPSG:25832", 1.0), ("EPSG:31467", 3.0)])
def test_a_receiver_is_in_the_datum_of_the_crs_unless_its_places_are_moved(slam, tmp_path, crs, accuracy):
    fixes = read_trajectory(slam / "fixes.tum")
    places = GeographicFrame("EPSG:25832").to_geographic(fixes.positions)
    rows = np.column_stack([fixes.times, places])
    header = "time,latitude,longitude,ellipsoidal_height"
    np.savetxt(tmp_path / "gnss.csv", rows, "%.10f", ",", header=header, comments="")
    words = (slam / "slam.map", "--gnss", tmp_path / "gnss.csv", "--trajectory", slam / "poses.tum", "--crs", crs)
    if crs != "EPSG:25832":
        with pytest.raises(CrsError, match=r"gnss\.csv exact to a voxel.*DHDN to WGS 84.*--allow-inexact-crs"):
            run(*COMMAND, *words, "-o", tmp_path / "x.map")
    said = run(*COMMAND, *words, "-o", tmp_path / "x.map", *["--allow-inexact-crs"] * (crs != "EPSG:25832"))
    assert f"put it off by {accuracy:g} m" in said
    assert read_manifest(tmp_path / "x.map").build["georeference"]["operation"]["accuracy"] == accuracy


def test_half_a_question_is_refused(slam, tmp_path):
    two = tmp_path / "two.csv"
    two.write_text("\n".join((slam / "control.csv").read_text().splitlines()[:3]) + "\n")
    other, swapped = tmp_path / "other.csv", tmp_path / "swapped.csv"
    swapped.write_text((slam / "control.csv").read_text().replace("east,north", "north,east"))
    other.write_text("name,x,y,z\np0,1,2,3\n")
    gnss, crs = ("--gnss", slam / "fixes.tum"), ("--crs", "EPSG:25832", "-o", tmp_path / "x.map")
    for words, kind, said in (
        (crs, OptionError, "--gnss or --control"),
        ((*gnss, *crs), OptionError, "--gnss together with --trajectory"),
        ((*gnss, "--trajectory", slam / "poses.tum", "--geoid-height", "46", *crs), OptionError, "latitude and long"),
        (("--control", slam / "control.csv", "--geoid-height", "46", *crs), OptionError, "together with --gnss"),
        (("--control", slam / "control.csv", "--trajectory", slam / "poses.tum", *crs), OptionError, "or --poses-out"),
        (("--control", two, *crs), OptionError, "places that determine"),
        (("--control", swapped, *crs), OptionError, "the same places .* Are all in metres, east and north"),
        (("--control", other, *crs), TrajectoryError, "no 'east'"),
        (("--control", slam / "control.csv", "--crs", "EPSG:4326", "-o", tmp_path / "x.map"), CrsError, "metres"),
        (("--control", slam / "control.csv", "--level-sigma-deg", "0", *crs), OptionError, "above 0"),
    ):
        with pytest.raises(kind, match=said):
            run(*COMMAND, slam / "slam.map", *words)
    assert not (tmp_path / "x.map").exists()
