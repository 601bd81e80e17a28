"""Real odd files that other programs wrote: each is read rightly, or refused in one line, and nothing is printed."""

import time

import numpy as np
import pytest

from maxcon.errors import MaxconError
from maxcon.io.geographic_priors import read_geographic_prior
from maxcon.io.recordings.opening import is_recording
from maxcon.io.scans import open_scans
from read_clouds import read_cloud


def n_scans(path):
    begin = time.perf_counter()
    n_full = sum(len(raw.points) > 0 for raw in open_scans(path).scans(0.0, 200.0))
    assert time.perf_counter() - begin < 100.0
    return n_full


def n_points(path):
    return int(np.isfinite(read_cloud(path).points).all(axis=1).sum())


COUNTS = {"nmea": lambda path: len(read_geographic_prior(path, "EPSG:3857").trajectory), "recordings": n_scans}
PACKAGES = {"e57": ("pye57",), "recordings": ("rosbags", "mcap", "velodyne_decoder")}
ALL_READ = ("las", "copc", "ply", "pcd")
"""Folders of which every file is read that is not named below."""
KNOWN = {
    "las": {"1.2-with-color-clipped.las": "1065 points in its header, and bytes for 1064"},
    "copc": {},
    "ply": {"no_vertex.ply": "no element 'vertex'"},
    "pcd": {
        "missingheader.pcd": "the header line .*, not VERSION",
        "ascii_empty.pcd": "an empty file",
        "ascii_with_empty_points.pcd": "0 points, WIDTH 0",
    },
    "e57": {
        "A4_moved.e57": 4, "A_B_different_dims.e57": 2, "A_moved_B.e57": 6, "bunnyDouble.e57": 30_571,
        "bunnyInt19.e57": 30_571, "bunnyInt24.e57": 30_571, "cartesian_invalid_state_single.e57": 1,
        "float_intensity_without_min_max.e57": 1, "las2e57_no_images_tag.e57": 153, "original_guids.e57": 1,
        "scaled_integer_intensity.e57": 2, "tiny_pc_and_images.e57": 2, "tiny_spherical.e57": 180,
        "ColouredCubeFloat.e57": 7680, "translationWithoutRotation.e57": 4,
        "empty.e57": "no scan", "PinholeImageWithDistortionParameters.e57": "no scan",
        "ZeroPointsInvalid.e57": "1 scans without any",
    },
    "nmea": {
        "hemi.log": 4,  # of 21 positions, those with a heading
        "nmea-rtk.log": 122, "pygpsdata-nmea4.log": 1, "saab-r4.log": "positions without heights",
        "ublox-f9p-hpnmea.log": "a way of more than 5 m", "ublox-zed-f9r.log": "a way of more than 5 m",
        "pygpsdata-badeof.log": "a way of more than 5 m", "pygpsdata-um981.log": "a way of more than 5 m",
        "trimble_nmea.log": "0 sentences without a fix",
    },
    "recordings": {
        "512x10_raw.bag": "got /os_node0/imu_packets .ouster_ros/msg/PacketMsg", "embag_test.bag": 5,
        **dict.fromkeys(("example-bz2.bag", "example-lz4.bag", "example.bag"), "Expected point clouds .PointCloud2"),
        "rms_1xxx_lms_1xx_movement_off.bag": r"/cloud_radar_track",
        "1673400471837873222": 4, "1673400471837873222_0.db3": 4, "sample_velodyne_vlp16_gps.pcap": 4,
        "OS-0-32-U1_v2.2.0_1024x10-single-packet.pcap": "Expected packets of a Velodyne",
        "OS-0-32-U1_v2.2.0_1024x10.pcap": "Expected packets of a Velodyne",
        "OS-1-128_v2.3.0_1024x10_lb_n3.pcap": "Expected packets of a Velodyne",
    },
}  # fmt: skip
"""How many points or poses a file, or scans a recording has, or the words that say why it is not read."""


@pytest.mark.parametrize("folder", KNOWN)
def test_every_odd_file_is_read_or_refused_in_one_line(folder, real_data, capfd):
    for package in PACKAGES.get(folder, ()):
        pytest.importorskip(package)
    if folder == "recordings":
        files = [path for path in sorted(real_data("recorders").rglob("*")) if is_recording(path)]
    else:
        files = sorted(path for path in real_data(f"recorders/{folder}").rglob("*.*") if path.is_file())
    assert len(files) >= 3 and set(KNOWN[folder]) <= {path.name for path in files}
    for path in files:
        wanted = KNOWN[folder].get(path.name, None if folder in ALL_READ else "")
        try:
            found = COUNTS.get(folder, n_points)(path)
        except MaxconError as error:
            assert path.name in str(error)
            assert isinstance(wanted, str), (path.name, str(error))
            with pytest.raises(MaxconError, match=f"^.*{wanted}.*$"):
                raise
            assert "\n" not in str(error)
        else:
            assert found == wanted or (not wanted and found > 0), path.name
    assert not any(capfd.readouterr())
