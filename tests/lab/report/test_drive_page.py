"""The page of one's own drive: rows made by hand, whose numbers are known, walls by facing, and a browser's view."""

import math
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

import maxcon
from drawn_figures import HOSTILE, undrawn, yard
from maxcon.drive.localize import DriveOptions
from maxcon.drive.poses_table import COVARIANCES
from maxcon.export import PoseRow
from maxcon.lab.report.drive_page import ReportedDrive, facings, worst_epochs, write_drive_page
from maxcon.scan.trajectory import Trajectory
from opened_pages import assert_whole

pytest.importorskip("jinja2", reason="the extra demo is not installed")
TRUE = maxcon.Pose(0.0, 0.0, 0.0, 0.0, 0.0, math.pi / 2)


def row(time, pose=None, status="localized", reason=""):
    """0.02 m along x, 0.01 m along y, and 0.1 degrees, without a pose nothing."""
    if pose is None:
        return PoseRow(time, None, status, reason, {"ms": 5.0})
    numbers = dict.fromkeys(COVARIANCES, 0.0) | {"cov_x_x": 4e-4, "cov_y_y": 1e-4}
    numbers |= {"cov_heading_heading": math.radians(0.1) ** 2, "protection_along": 0.03, "protection_across": 0.06}
    return PoseRow(time, pose, status, reason, numbers)


@pytest.fixture
def drive(tmp_path):
    """Right; 5 mm ahead and 1 degree off less a bit; wrong by 1 m to the left; not localized."""
    scan, point_map = yard()[:2]
    for time in range(4):
        np.savez(tmp_path / f"{time}.5.npz", points=scan.points)
    rows = [
        row(0.5, TRUE), row(1.5, TRUE.translated([0.0, 0.005, 0.0])), row(2.5, TRUE.translated([-1.0, 0.0, 0.0])),
        row(3.5, None, "ambiguous", HOSTILE),
    ]  # fmt: skip
    truth = Trajectory.from_poses([0.5, 1.5, 2.5, 3.5], [TRUE] * 4)
    scans = maxcon.open_scans(tmp_path)
    return ReportedDrive(rows, point_map, scans, DriveOptions(), prior=truth, reference=truth)


@pytest.fixture
def page(tmp_path):
    """Write the page of a drive; its text without tags, blanks once."""

    def write(drive):
        write_drive_page(tmp_path / "page.html", drive, "monday in city.map", {"Sigma of the map": "0.02 m, assumed"})
        html = (tmp_path / "page.html").read_text(encoding="utf-8")
        assert HOSTILE not in html and html.count("<img") == 2 + len(drive.rows)
        return " ".join(unescape(re.sub(r"<(style|head).*?</\1>|<[^>]+>", " ", html, flags=re.DOTALL)).split())

    return write


def test_sigmas_are_along_and_across_the_heading(drive):
    np.testing.assert_allclose(drive.sigmas()[:3], [[0.01, 0.02, math.radians(0.1)]] * 3, atol=1e-12)
    assert np.isnan(drive.sigmas()[3]).all()


def test_the_page_says_what_was_found_and_how_good_it_is(drive, page):
    text = page(drive)
    assert "3 of 4 scans are localized. Protection levels: 0.06 m in the median, 0.06 m at most." in text
    assert "Horizontally from the reference: 0.005 m in the median, 95 % within 0.900 m. Farther than" in text
    assert "0.02 m, assumed" in text and f"{HOSTILE}" in text and "Another place scores nearly as high" in text
    assert "along m 0.000 0.005 0.005 100.0 100.0 100.0" in text
    assert "across m 0.000 0.900 1.000 66.7 66.7 66.7" in text
    assert "with a reference: 3; farther than 0.3 m and 1° from it: 1." in text and "is exceeded in 1 of 3" in text
    assert text.index("Epoch 2,") < text.index("Epoch 3,") < text.index("Epoch 0,")


def test_without_a_reference_nothing_is_called_right_or_wrong_and_the_maps_part_is_told(drive, page, monkeypatch):
    undrawn(monkeypatch)
    drive.point_map.sigma = 0.01  # in x and in y of variances of 4e-4 and 1e-4
    text = page(replace(drive, reference=None))
    assert "sigma of 0.01 m: it makes 40 % of the variance" in text
    assert "only a reference tells: --reference POSES" in text and "How far from the reference" not in text
    assert "arther than" not in text


def test_a_drive_of_which_nothing_is_localized_has_its_page(drive, page, tmp_path):
    (tmp_path / "3.5.npz").write_bytes(b"none")  # nor can it be read
    rows = [row(0.5 + number, None, "few matches") for number in range(4)]
    text = page(replace(drive, rows=rows, prior=None, reference=None))
    assert "0 of 4 scans are localized." in text and "No answer has a covariance." in text


def test_the_worst_are_the_wrong_then_those_without_a_pose_then_the_least_sure():
    is_localized, is_wrong = np.ones(40, bool), np.zeros(40, bool)
    is_localized[20:], is_wrong[5] = False, True
    levels = np.arange(40.0)
    assert worst_epochs(is_localized, is_wrong, levels) == [5, 20, 22, 25, 27, 30, 32, 34, 37, 39]
    is_localized[:] = True
    assert worst_epochs(is_localized, is_wrong, levels) == [5, *range(39, 30, -1)]
    assert worst_epochs(is_localized[:2], is_wrong[:2], levels[:2]) == [1, 0]


# --- walls by facing ---
def walls(off):
    """Points on two walls, normals at 15 and at 105 degrees from +x, the second off along that by so much; normals."""
    rng, turn = np.random.default_rng(0), np.radians(15.0)
    flat = np.column_stack([rng.uniform(-8.0, 8.0, 40_000), rng.uniform(0.0, 4.0, 40_000)])
    first = np.column_stack([np.full(40_000, 10.0), flat])
    second = np.column_stack([flat[:, 0], np.full(40_000, -6.0 + off), flat[:, 1]])
    normals = np.repeat([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 40_000, axis=0)
    axes = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([first, second]) @ axes.T, normals @ axes.T


def test_a_wall_that_is_off_is_shown_in_its_direction():
    point_map = maxcon.PointMap.from_points(*walls(0.04))
    points, normals = (part[::20] for part in walls(0.0))
    pose = maxcon.Pose(1.0, 0.5, 1.8, 0.0, 0.0, 0.7)
    scan = maxcon.Scan(pose.inverse.apply(points), normals @ pose.rotation)
    first, second = facings([(scan, pose), (scan, pose)], point_map)
    assert (first.first_deg, first.last_deg, second.first_deg, second.last_deg) == (0.0, 30.0, 90.0, 120.0)
    assert min(first.n_points, second.n_points) > 800 and min(first.found, second.found) > 0.95
    assert (first.offset, second.offset) == (pytest.approx(0.0, abs=0.004), pytest.approx(0.04, abs=0.004))
    assert second.p95 < 0.06 and facings([], point_map) == []


@pytest.mark.browser
@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1280, "light")])
def test_the_page_opens_whole(drive, page, tmp_path, width, scheme):
    page(drive)
    assert_whole(tmp_path / "page.html", width, scheme, n_images=6)
