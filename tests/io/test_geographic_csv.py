"""Tables with latitude, longitude and a height: columns by name, heights told apart, headings of either kind."""

import math

import numpy as np
import pytest

from maxcon.errors import TrajectoryError
from maxcon.io.crs import GeographicFrame
from maxcon.io.fixes import Heights
from maxcon.io.geographic_priors import is_geographic, read_geographic_csv, read_geographic_prior
from maxcon.io.trajectories import read_trajectory

UTM = "EPSG:25833"


def _write(tmp_path, header, *rows):
    path = tmp_path / "gnss.csv"
    path.write_text("\n".join(["# a comment", header, *rows]) + "\n")
    return path


def _way(tmp_path, header="", values=""):
    rows = [f"{100 + i},52.0,{13.0 + i * 3e-5:.8f},60.5{values}" for i in range(10)]
    return _write(tmp_path, f"time,latitude,longitude,ellipsoidal_height{header}", *rows)


def test_positions_alone(tmp_path):
    path = _way(tmp_path)
    assert is_geographic(path)
    rows = read_geographic_csv(path)
    np.testing.assert_allclose(rows.times, 100.0 + np.arange(10))
    np.testing.assert_allclose(rows.places[3], [52.0, 13.00009, 60.5])
    assert np.isnan(rows.covariances).all() and rows.orientations is None
    prior = read_geographic_prior(path, UTM)
    np.testing.assert_allclose(GeographicFrame(UTM).to_geographic(prior.trajectory.positions), rows.places, atol=1e-9)
    assert "course over ground" in prior.words and "gnss.csv" in prior.words


def test_heights_by_their_name(tmp_path):
    for names, kind in (
        ("ellipsoidal_height,ignored", Heights.ELLIPSOIDAL),
        ("height,ignored", Heights.ELLIPSOIDAL),
        ("orthometric_height,height", Heights.ORTHOMETRIC),
    ):
        log = read_geographic_csv(_write(tmp_path, f"time,latitude,longitude,{names}", "1,52,13,60,20"))
        assert log.heights is kind and log.places[0, 2] == 60.0


@pytest.mark.parametrize(
    ("columns", "values"), [("azimuth_deg", "89.0"), ("heading_deg", "1.0"), ("heading", str(math.radians(1.0)))]
)
def test_headings_of_a_compass_or_counter_clockwise(tmp_path, columns, values):
    path = _way(tmp_path, f",roll_deg,pitch_deg,{columns},sigma_heading_deg", f",1.0,-2.0,{values},0.5")
    rows = read_geographic_csv(path)
    np.testing.assert_allclose(np.degrees(rows.orientations.trajectory.angles[4]), [1.0, -2.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(rows.orientations.sigmas), 0.5)
    trajectory = read_geographic_prior(path, UTM).trajectory
    convergence = GeographicFrame(UTM).convergence(rows.places[4:5])[0]
    assert trajectory.angles[4, 2] == pytest.approx(math.radians(1.0) + convergence, abs=1e-4)


def test_sigmas_of_east_and_north(tmp_path):
    path = _way(tmp_path, ",azimuth_deg,sigma_east,sigma_north,sigma_heading_deg", ",90,0.3,0.4,1.0")
    covariances = read_geographic_prior(path, UTM).trajectory.covariances
    np.testing.assert_allclose(covariances[2], np.diag([0.09, 0.16, math.radians(1.0) ** 2]), atol=1e-12)


def test_rows_without_a_position_or_a_sigma(tmp_path):
    path = _write(
        tmp_path, "Time,Latitude,Longitude,Height,sigma_east,sigma_north",
        "1,,,,,", "2,52,13,60,0.1,0.2", "3,52,13,60,,", "4,52,13,x,,", "5,52,13,60,0.1,", "6,52,1",
    )  # fmt: skip
    rows = read_geographic_csv(path)
    np.testing.assert_allclose(rows.times, [2, 3, 5])
    assert rows.n_left_out == 1
    np.testing.assert_allclose(rows.covariances[0], np.diag([0.01, 0.04]))
    assert np.isnan(rows.covariances[1:]).all()
    assert [f"line {number}:" in words for number, words in zip((6, 8), rows.left_out, strict=True)] == [True] * 2


@pytest.mark.parametrize(("header", "row", "words"), [
    ("time,latitude,longitude", "1,52,13", "ellipsoidal_height or orthometric_height.*got none"),
    ("time,latitude,longitude,altitude", "1,52,13,60", "got 'altitude', which may be either"),
    ("latitude,longitude,height", "52,13,60", "no 'time'"),
    ("time,latitude,longitude,height,height", "1,52,13,60,60", "more than one 'height'"),
    ("time,latitude,longitude,height,yaw", "1,52,13,60,1", "got 'yaw', which may be either"),
    ("time,latitude,longitude,height,heading,azimuth_deg", "1,52,13,60,1,1", "got both"),
    ("time,latitude,longitude,height,roll", "1,52,13,60,1", "both roll and pitch"),
    ("time,latitude,longitude,height", "1,520000,130000,60", "degrees as latitude and longitude"),
    ("time,latitude,longitude,height,heading", "1,52,13,60,90", "within one turn"),
    ("time,latitude,longitude,height,sigma_east,sigma_north", "1,52,13,60,-1,1", ">= 0"),
    ("time,latitude,longitude,height", "1,,,", "at least one pose"),
    ("time,latitude,longitude,height", "2,52,13,60\n1,52,13,60", "line 4: Expected times that increase"),
])  # fmt: skip
def test_what_is_not_clear_is_refused(tmp_path, header, row, words):
    with pytest.raises(TrajectoryError, match=words) as error:
        read_geographic_csv(_write(tmp_path, header, row))
    assert "gnss.csv" in str(error.value) and "\n" not in str(error.value)


def test_each_kind_of_table_is_told_from_the_other(tmp_path):
    assert not is_geographic(_write(tmp_path, "time,x,y,z,roll,pitch,heading", "1,2,3,4,0,0,0"))
    assert not is_geographic(_write(tmp_path, ""))
    with pytest.raises(TrajectoryError, match="only be the --prior of"):
        read_trajectory(_write(tmp_path, "time,latitude,longitude,height", "1,52,13,60"))
