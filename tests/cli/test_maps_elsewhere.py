# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Commands with a map on an S3 server: the same rows as from a folder, one line where it cannot be."""

import csv

import pytest

from s3_buckets import bucket_on, s3_server_here


@pytest.fixture(scope="module")
def server():
    with s3_server_here() as address:
        yield address


@pytest.fixture
def maps(server, monkeypatch):
    """Address of a bucket; credentials and server are in the environment."""
    with bucket_on(server, monkeypatch) as address:
        yield address


def rows(path):
    with path.open() as file:
        return [{name: value for name, value in row.items() if name != "ms"} for row in csv.DictReader(file)]


def test_from_a_copy_to_the_same_poses(maxcon, drive, maps, tmp_path):
    assert maxcon("map", "copy", drive.city, f"{maps}/city").out == f"{maps}/city\n"
    said = maxcon("map", "info", f"{maps}/city", "--check")
    assert said.out == maxcon("map", "info", drive.city, "--check").out
    arguments = (drive.dataset.scans, "--prior", drive.dataset.prior, "--quiet", "-o")
    codes = [
        maxcon("localize", city, *arguments, tmp_path / f"{name}.csv").code
        for name, city in (("here", drive.city), ("there", f"{maps}/city"))
    ]
    assert codes == [0, 0]
    assert rows(tmp_path / "there.csv") == rows(tmp_path / "here.csv")


def test_what_is_not_there(maxcon, drive, maps, refused, tmp_path):
    for city, words in ((f"{maps}/none", "no manifest.json there"), ("s3://nobody/city", "no such bucket")):
        refused(maxcon("map", "info", city), city, words)
        arguments = (drive.dataset.scans, "--prior", drive.dataset.prior, "-o", tmp_path / "poses.csv")
        refused(maxcon("localize", city, *arguments), city, words)
    assert not (tmp_path / "poses.csv").exists()


def test_a_map_is_built_in_a_folder(maxcon, maps, refused, street_npz):
    refused(maxcon("map", "build", street_npz, "-o", f"{maps}/street"), f"map copy FOLDER {maps}/street")


def test_a_map_that_is_there_is_kept(maxcon, drive, maps, refused):
    assert maxcon("map", "copy", drive.city, f"{maps}/city", "-q").code == 0
    refused(maxcon("map", "copy", drive.city, f"{maps}/city", "-q"), f"{maps}/city", "--overwrite")
    assert maxcon("map", "copy", drive.city, f"{maps}/city", "-q", "--overwrite").code == 0
