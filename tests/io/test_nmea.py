"""Logs of receivers: positions, dates, sigmas and headings, among all that stands between them in real ones."""

import math

import numpy as np
import pytest

from maxcon.errors import CrsError, FileError, OptionError, TrajectoryError
from maxcon.io.crs import GeographicFrame
from maxcon.io.fixes import Heights
from maxcon.io.geographic_priors import is_geographic, is_nmea, read_geographic_prior, read_nmea
from nmea_sentences import clock, gga, rmc, sentence

UTM = "EPSG:25833"
START = 1_626_870_701.0
NEAR = (52.0, 13.0)


def _write(path, lines, end="\r\n"):
    path.write_bytes(b"".join((line if isinstance(line, bytes) else line.encode()) + end.encode() for line in lines))
    return path


def _way(n=20, start=START, **options):
    """Eastwards, 2 m a second."""
    return [
        line
        for i in range(n)
        for line in (gga(start + i, NEAR[0], NEAR[1] + i * 2.92e-5, 60.0, 40.0, **options), rmc(start + i))
    ]


def test_positions_heights_and_times(tmp_path):
    log = read_nmea(_write(tmp_path / "a.nmea", _way(3)))
    np.testing.assert_allclose(log.times, START + np.arange(3), atol=1e-6)
    np.testing.assert_allclose(log.places, [[52.0, 13.0 + i * 2.92e-5, 100.0] for i in range(3)], atol=1e-10)
    assert log.heights is Heights.ELLIPSOIDAL  # altitude and the receiver's own geoid
    np.testing.assert_allclose(log.covariances[0], np.diag([0.04**2] * 2))  # RTK fixed: 5 cm times HDOP
    assert log.orientations is None and "0 of GST, 3 of HDOP" in log.words
    log = read_nmea(_write(tmp_path / "a.nmea", [gga(START, -33.25, -70.5, 1.0, 2.0), rmc(START)]))
    np.testing.assert_allclose(log.places, [[-33.25, -70.5, 3.0]], atol=1e-10)


def test_the_warts_of_real_logs(tmp_path):
    good = _way(12)
    broken = good[2][:-2] + ("00" if good[2][-2:] != "00" else "01")
    noise = bytes(range(128, 256)) + b"\x00\xb5b\x01\x07"
    lines = [
        "# Name: a receiver", "", sentence("GPHDT", "", "T"), sentence("GPGGA", *[""] * 5, 0, *[""] * 7),
        sentence("GNRMC", "", "V", *[""] * 10), noise + good[0].encode(), good[1], broken, good[3],
        *good[4:], good[4][: len(good[4]) // 2], "!AIVDM,1,1,,B,13aGhtw0R<OJf=6LgQ?Ad1FF05`L,0*24", "$",
    ]  # fmt: skip
    log = read_nmea(_write(tmp_path / "a.txt", lines))
    np.testing.assert_allclose(log.times, START + np.delete(np.arange(12), 1), atol=1e-6)
    assert log.n_left_out == 1
    assert "2 sentences with a wrong checksum, or without, left out" in log.words
    assert log.orientations is None


def test_letters_of_a_base_station_nanoseconds_midnight_and_a_late_date_cost_no_position(tmp_path):
    """The first two are in real logs, and a common parser drops them."""
    place = ("5200.0", "N", "01300.0", "E", 4, 12, 0.8, 60.0, "M", 40.0, "M", "1.0", "TSTR")
    lines = [sentence("GPGGA", f"{clock(START)[0]}789", *place), rmc(START), sentence("PASHR", "", "", "T")]
    np.testing.assert_allclose(read_nmea(_write(tmp_path / "a.nmea", lines)).places, [[52.0, 13.0, 100.0]])
    midnight = 1_626_912_000.0
    lines = [rmc(midnight - 0.4), gga(midnight - 0.2, *NEAR, 1.0, 1.0), gga(midnight + 0.2, *NEAR, 1.0, 1.0)]
    times = read_nmea(_write(tmp_path / "a.nmea", lines)).times
    np.testing.assert_allclose(times, [midnight - 0.2, midnight + 0.2], atol=1e-6)
    day = sentence("GPZDA", clock(START + 3)[0], 21, "07", 2021, "00", "00")
    lines = [*(gga(START + i, *NEAR, 1.0, 1.0) for i in range(3)), day]
    np.testing.assert_allclose(read_nmea(_write(tmp_path / "a.nmea", lines)).times, START + np.arange(3))


@pytest.mark.parametrize(("lines", "kind", "words"), [
    ([gga(START, *NEAR, 1.0, 1.0)], TrajectoryError, "a date"),
    ([rmc(START), gga(START, *NEAR, 1.0, 1.0, quality=0)], TrajectoryError, "1 sentences without a fix"),
    ([rmc(START), gga(START, *NEAR)], TrajectoryError, "positions without heights"),
    (["1.0 2.0"], FileError, "got none"),
    ([gga(START, *NEAR, 1.0, 1.0)[:-3]], FileError, "1 with a wrong checksum, or without"),
])  # fmt: skip
def test_no_date_no_position_no_height_no_sentence(tmp_path, lines, kind, words):
    with pytest.raises(kind, match=words):
        read_nmea(_write(tmp_path / "a.nmea", lines))


@pytest.mark.parametrize("leads", [False, True])
def test_sigmas_of_gst_and_headings_of_hdt_before_or_after_their_position(tmp_path, leads):
    lines = []
    for i in range(3):
        epoch = [
            gga(START + i, *NEAR, 1.0, 1.0),
            sentence("GNGST", clock(START + i)[0], 9, "", "", "", 0.3, 0.2, 0.5),
            sentence("GPHDT", 80.0 + i, "T"),
        ]
        lines += [*(reversed(epoch) if leads else epoch), *([] if i else [rmc(START)])]
    lines += [gga(START + 3, *NEAR, 1.0, 1.0, quality=1, hdop=1.5), gga(START + 4, *NEAR, 1.0, 1.0, quality=6)]
    log = read_nmea(_write(tmp_path / "a.nmea", lines))
    for covariance in log.covariances[:3]:
        np.testing.assert_allclose(covariance, np.diag([0.04, 0.09]))  # east, north
    np.testing.assert_allclose(log.covariances[3], np.diag([7.5**2] * 2))
    assert np.isnan(log.covariances[4]).all() and "3 of GST, 1 of HDOP, 1 unknown" in log.words
    np.testing.assert_allclose(log.orientations.trajectory.times, START + np.arange(3), atol=1e-6)
    np.testing.assert_allclose(np.degrees(log.orientations.trajectory.angles[:, 2]), 10.0 - np.arange(3), atol=1e-9)


def test_orientations_of_pashr(tmp_path):
    """Roll to starboard is to the right, as about x forward; a nose up is a negative turn about y to the left."""
    attitude = sentence("PASHR", clock(START)[0], 100.0, "T", 2.0, 3.0, 0.1, 0.02, 0.02, 0.5, 1, 1)
    log = read_nmea(_write(tmp_path / "a.nmea", [gga(START, *NEAR, 1.0, 1.0), rmc(START), attitude]))
    np.testing.assert_allclose(np.degrees(log.orientations.trajectory.angles[0]), [2.0, -3.0, -10.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(log.orientations.sigmas), [0.5])


def test_poses_in_the_coordinates_of_a_map(tmp_path):
    path = _write(tmp_path / "a.nmea", _way())
    prior = read_geographic_prior(path, UTM)
    places = GeographicFrame(UTM).to_geographic(prior.trajectory.positions)
    np.testing.assert_allclose(places[0], [52.0, 13.0, 100.0], atol=1e-9)
    assert abs(prior.trajectory.angles[10, 2]) < math.radians(2.0)  # grid north is 1.6 degrees off
    assert prior.heights is Heights.ELLIPSOIDAL and not prior.has_orientations
    with pytest.raises(CrsError, match="a map with a CRS"):
        read_geographic_prior(path, None)


def test_heights_above_the_geoid_are_not_mixed_with_ellipsoidal_ones(tmp_path):
    lines = [line for i in range(20) for line in (gga(START + i, 52.0, 13.0 + i * 3e-5, 60.0), rmc(START + i))]
    path = _write(tmp_path / "a.nmea", lines)
    prior = read_geographic_prior(path, UTM)
    np.testing.assert_allclose(prior.trajectory.positions[:, 2], 60.0)
    assert prior.heights is Heights.ORTHOMETRIC and "above the geoid, as they are" in prior.words
    with pytest.raises(OptionError, match="Leave it out"):
        read_geographic_prior(path, UTM, 40.0)
    with_geoid = read_geographic_prior(path, "EPSG:25833+5783")
    np.testing.assert_allclose(with_geoid.trajectory.positions[:, 2], 60.0)
    assert with_geoid.heights is None
    import pyproj

    crs = pyproj.CRS(UTM).to_3d().to_wkt()
    with pytest.raises(CrsError, match="--geoid-height"):
        read_geographic_prior(path, crs)
    np.testing.assert_allclose(read_geographic_prior(path, crs, 40.0).trajectory.positions[:, 2], 100.0, atol=1e-6)


def test_which_files_are_logs(tmp_path):
    assert is_nmea(_write(tmp_path / "a.nmea", [])) and is_nmea(_write(tmp_path / "a.log", []))
    assert is_nmea(_write(tmp_path / "a.txt", ["# a", b"\xff\xfe", *_way(1)]))
    assert not is_nmea(_write(tmp_path / "b.txt", ["# time x y z", "1.0 2.0 3.0 0.0 0.0 0.0 0.0 1.0"]))
    assert not is_nmea(tmp_path / "c.txt") and not is_geographic(tmp_path / "c.tum")


def test_heights_times_and_sigmas_of_a_real_log(real_data):
    path = real_data("recorders/nmea/gpsd/nmea-rtk.log")
    log = read_nmea(path)
    np.testing.assert_allclose(log.places[0], [41 + 34.49795459 / 60, -(93 + 45.03431408 / 60), 246.719])
    assert np.median(np.diff(log.times)) == pytest.approx(0.1, abs=1e-6)
    assert log.covariances[0, 0, 0] == pytest.approx((2.0 * 0.9) ** 2)
