"""`maxcon map build --scans --poses`: a drive becomes a map in which other scans of the street find their place."""

import shutil
from itertools import pairwise

import laspy
import numpy as np
import pytest

from localized_poses import rows_of
from maxcon import PointMap, Pose, Trajectory, open_scans
from maxcon.cli.drive_inputs import placed_scans
from maxcon.cli.options import MappingDrive
from maxcon.errors import FileError, OptionError, TrajectoryError
from maxcon.geometry import wrap_angle
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.simulation.recordings import ODOMETRY, drive_messages
from maxcon.map.layout import SurfaceClass
from maxcon.map.manifest import read_manifest
from maxcon.scan.mounting import sensor_trajectory
from recorded_drives import record_drive, transforms, write_entries
from street_of_boxes import WALL, DriveOfBoxes, inside
from written_maps import run, stored_voxels

PARKED = ((8.0, -3.8, 0.2), (12.0, -2.2, 1.5))
PASSING = (2.5, 4.3)  # y of both sides of a car that passes between the scanner and the wall


def street(seconds):
    x = 8.0 * seconds - 4.0
    return (PARKED, ((x, PASSING[0], 0.2), (x + 4.0, PASSING[1], 1.5)))


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Folder of the scans of a street, with poses as TUM and as KITTI has them."""
    folder = tmp_path_factory.mktemp("drive")
    made = DriveOfBoxes(street)
    made.write(folder)
    write_tum(folder / "poses.tum", Trajectory.from_poses(made.times, made.poses))
    matrices = [np.column_stack([pose.rotation, pose.position]).ravel() for pose in made.poses]
    np.savetxt(folder / "poses.txt", matrices)
    return folder


@pytest.fixture(scope="module")
def built(drive):
    run("map", "build", "--scans", drive / "scans", "--poses", drive / "poses.tum", "-o", drive / "street.map")
    return PointMap.open(drive / "street.map", left_out=None)


def test_what_stands_stays_where_it_is_and_what_passed_is_gone(drive, built):
    points, _, normals, classes = stored_voxels(drive / "street.map")
    is_gone = classes == SurfaceClass.GONE
    assert all(inside(points, box).sum() > 500 for box in (WALL, PARKED))
    assert not any((inside(points, box, margin=0.0) & is_gone).any() for box in (WALL, PARKED))
    trail = (points[:, 1] > PASSING[0] - 0.1) & (points[:, 1] < PASSING[1] + 0.1) & (points[:, 2] > 0.2)
    assert is_gone[trail].mean() > 0.45  # through the rest too few rays went: they lie a degree apart
    facade = inside(points, ((-2.0, 5.95, 1.0), (32.0, 6.05, 4.0)), 0.0) & (np.abs(normals[:, 1]) > 0.9)
    assert (normals[facade, 1] < 0.0).all()  # to the side that the scanner was on
    patch = built.ground_around(*built.frame.to_local([[10.0, -1.0, 0.0]])[0, :2], 1.0)
    assert np.nanmax(np.abs(patch.heights + built.frame.origin[2])) < 0.05
    (said,) = read_manifest(drive / "street.map").build["updates"]
    assert said["drives"][0]["name"] == "poses.tum" and said["n_now_new"] == 0
    assert {path.name for path in (drive / "street.map").iterdir()} == {"manifest.json", "tiles", "ground", "classes"}


def test_poses_by_number_and_those_of_a_recording_make_the_same_map(drive, built, tmp_path):
    """KITTI's poses have no times; a recording has both. Keeping what moves leaves the map of all points."""
    made, poses = open_scans(drive / "scans"), read_trajectory(drive / "poses.tum")
    recording = record_drive(tmp_path / "drive.mcap", made, poses, odometry=poses)
    for scans, given in ((drive / "scans", drive / "poses.txt"), (recording, recording)):
        out = tmp_path / f"{given.name}.map"
        run("map", "build", "--scans", scans, "--poses", given, "-o", out, "--keep-moving")
        found = PointMap.open(out)
        assert "updates" not in read_manifest(out).build
        for one, other in zip(built.all_voxels()[:2], found.all_voxels()[:2], strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_mounting_moves_poses_to_the_scanner_once_whatever_a_recording_says(drive, tmp_path):
    """Poses of a vehicle in a recording whose transforms tell where the scanner is: by these, or by a mounting."""
    scans, true = open_scans(drive / "scans"), read_trajectory(drive / "poses.tum")
    mounted = Pose(1.1, 0.2, 1.9, 0.0, 0.0, 0.3)
    of_vehicle = sensor_trajectory(true, mounted.inverse)
    messages = [transforms(float(scans.times[0]), ("base_link", "sensor", mounted), topic="/tf_static")]
    for entry in drive_messages(scans, true, "EPSG:25832", odometry=of_vehicle):
        of_it = {"child_frame_id": "base_link"} if entry.topic == ODOMETRY else {}
        messages.append(entry._replace(content={**entry.content, **of_it}))
    recording = write_entries(tmp_path / "drive.mcap", messages)
    mounting = tmp_path / "mounting.toml"
    mounting.write_text(
        f"[sensor]\nposition = {mounted.position.tolist()}\nheading_deg = {np.degrees(mounted.heading)}\n[odometry]\n"
    )
    for given in (None, mounting):
        drive = MappingDrive(scans=recording, poses=recording, mounting=given)
        placed = placed_scans(drive, recording, recording, quiet=True)
        found = np.array([pose.position for pose in placed.poses.values()])
        np.testing.assert_allclose(found, true.positions, atol=1e-4)


def test_scans_without_a_pose_are_left_out_and_told(drive, tmp_path):
    poses = (drive / "poses.tum").read_text().splitlines()
    (tmp_path / "half.tum").write_text("\n".join(poses[:19]) + "\n")
    said = run("map", "build", "--scans", drive / "scans", "--poses", tmp_path / "half.tum", "-o", tmp_path / "a.map")
    assert "18 of 40 placed by their poses; 22 have no pose" in said


@pytest.mark.parametrize(("change", "words"), [
    (lambda rows: rows[:-1], "a pose for each of the 40 scans.*got 39"),
    (lambda rows: [row * 2.0 for row in rows], "line 1: Expected a rotation"),
    (lambda rows: [np.column_stack([np.eye(3), np.roll(row[3::4], -1)]).ravel() for row in rows], "KITTI's own do"),
    (lambda rows: [row[:5] for row in rows], "line 1: Expected 8 columns"),
])  # fmt: skip
def test_poses_that_cannot_be_are_refused(drive, tmp_path, change, words):
    rows = np.loadtxt(drive / "poses.txt")
    np.savetxt(tmp_path / "poses.txt", change(list(rows)))
    with pytest.raises(TrajectoryError, match=words):
        run("map", "build", "--scans", drive / "scans", "--poses", tmp_path / "poses.txt", "-o", tmp_path / "a.map")
    assert not (tmp_path / "a.map").exists()


def test_other_clocks_empty_folders_and_half_a_question_are_refused(drive, tmp_path):
    poses, out = read_trajectory(drive / "poses.tum"), tmp_path / "a.map"
    write_tum(tmp_path / "late.tum", Trajectory(poses.times + 1e4, poses.positions, poses.quaternions_xyzw))
    (tmp_path / "none").mkdir()
    scans, given = ("--scans", drive / "scans"), ("--poses", drive / "poses.tum")
    for words, kind, said in (
        ((*scans, "--poses", tmp_path / "late.tum"), TrajectoryError, "use the same clock"),
        (("--scans", tmp_path / "none", *given), FileError, "Expected scans of one kind"),
        (scans, OptionError, "--scans together with --poses"),
        ((*scans, *given, tmp_path), OptionError, "either --scans or clouds"),
        ((*scans, *given, "--deskew"), FileError, "a time for each point"),
        ((*scans, *given, "--deskew", "--turn-time", "10"), OptionError, "of up to 2 s, got 10"),
        ((*scans, *given, "--area", "0,0,1,1", "--max-range", "0.5"), OptionError, "min_range < max_range"),
    ):
        with pytest.raises(kind, match=said):
            run("map", "build", *words, "-o", out)
    assert not out.exists()


# --- real drives ---
def localized(point_map, scans, prior, reference, out):
    """How many epochs there are, how many are localized, and how many of these are within 0.3 m and 1 degree."""
    run("localize", point_map, scans, "--prior", prior, "-o", out, codes=(0, 1))
    rows, truth = rows_of(out), read_trajectory(reference)
    n_right, found = 0, [row for row in rows if row["status"] == "localized"]
    for row in found:
        pose = truth.at(float(row["time"]))
        off = np.hypot(float(row["x"]) - pose.x, float(row["y"]) - pose.y)
        n_right += off <= 0.3 and abs(np.degrees(wrap_angle(float(row["heading"]) - pose.heading))) <= 1.0
    return len(rows), len(found), n_right


def test_every_second_scan_of_a_road_places_the_others(real_data, tmp_path):
    data = real_data("kitti-0013")
    files = sorted((data / "scans").glob("*.bin"))
    times = (data / "scans/times.txt").read_text().split()
    for first, name in enumerate(("map", "drive")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "times.txt").write_text("\n".join(times[first::2]))
        for file in files[first::2]:
            shutil.copy(file, tmp_path / name)
    street, reference = tmp_path / "street.map", data / "reference.txt"
    run("map", "build", "--scans", tmp_path / "map", "--poses", reference, "--crs", "EPSG:25832", "-o", street)
    found = localized(street, tmp_path / "drive", data / "prior_perturbed.txt", reference, tmp_path / "poses.csv")
    assert found == (35, 35, 35)


def test_a_pass_through_a_yard_places_the_next_one(real_data, tmp_path):
    """The first pass of the Livox is kept as a cloud: points of it go back into every second scan of theirs."""
    data = real_data("second-pass/livox-yard")
    cloud, poses = laspy.read(data / "map/map.laz"), read_trajectory(data / "map/trajectory.txt")
    order = np.argsort(cloud.gps_time, kind="stable")
    edges = np.searchsorted(cloud.gps_time[order], [*(poses.times - 0.5), np.inf])
    for i, (first, last) in list(enumerate(pairwise(edges)))[::2]:
        points = poses.pose(i).inverse.apply(cloud.xyz[order[first:last:2]])
        points.astype("<f4").tofile(tmp_path / f"{i:06d}.bin")
    write_tum(tmp_path / "poses.tum", Trajectory(poses.times[::2], poses.positions[::2], poses.quaternions_xyzw[::2]))
    run("map", "build", "--scans", tmp_path, "--poses", tmp_path / "poses.tum", "-o", tmp_path / "yard.map")
    n_epochs, n_localized, n_right = localized(
        tmp_path / "yard.map", data / "scans", data / "prior.txt", data / "reference.txt", tmp_path / "poses.csv"
    )
    assert n_epochs == 14
    assert n_right == n_localized >= 13  # one has a second place nearly as good
