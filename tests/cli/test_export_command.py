# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon export` of what `maxcon localize` wrote."""

import json

import pytest


@pytest.fixture
def poses(maxcon, drive, tmp_path):
    out = tmp_path / "poses.csv"
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", out)
    assert maxcon(*arguments).code == 0
    return out


def test_a_drive_is_exported_in_the_crs_of_its_map(maxcon, refused, poses, drive, tmp_path):
    ended = maxcon("export", poses, "-o", tmp_path / "a.geojson", "--map", drive.city)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out == f"4 of 4 epochs have a pose; written to {tmp_path / 'a.geojson'}\n"
    longitude, latitude = json.loads((tmp_path / "a.geojson").read_text())["features"][0]["geometry"][
        "coordinates"
    ]
    assert 9.0 < longitude < 10.0
    assert 52.0 < latitude < 53.0
    refused(maxcon("export", poses, "-o", tmp_path / "b.kml"), "--map")
    refused(
        maxcon("export", poses, "-o", tmp_path / "b.kml", "--map", drive.city, "--crs", "EPSG:25832"), "both"
    )
    refused(maxcon("export", poses, "-o", poses), "another file")
    refused(maxcon("export", drive.dataset.prior, "-o", tmp_path / "b.tum"), "POSES.csv")
    assert not list(tmp_path.glob("b.*"))
