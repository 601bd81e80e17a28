# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon map update` and what `maxcon map info` and `maxcon localize` make of its map."""

import pytest
from typer.testing import CliRunner

from maxcon.cli import app
from maxcon.map.manifest import read_manifest
from street_of_boxes import CAR, OTHER_CAR, WALL, DriveOfBoxes, map_of
from written_maps import write

RUN = CliRunner().invoke


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A street's map with CAR, and a drive when OTHER_CAR is there instead."""
    folder = tmp_path_factory.mktemp("street")
    point_map = map_of(WALL, CAR)
    write(folder / "a.map", point_map, origin=(0.0, 0.0, 0.0))
    DriveOfBoxes(lambda seconds: (OTHER_CAR,)).write(folder)
    return folder


def test_an_updated_map_tells_its_history(folder):
    done = RUN(
        app, ["map", "update", *(str(folder / name) for name in ("a.map", "scans", "poses.csv")),
              "-o", str(folder / "b.map"), "-q"],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    said = RUN(app, ["map", "info", str(folder / "b.map"), "--check"])
    assert said.exit_code == 0, said.output
    assert "update       1 of a.map" in said.output
    assert "poses.csv (40 looks)" in said.output
    last = read_manifest(folder / "b.map").build["updates"][-1]
    assert f"{last['n_gone']:,} voxels" in said.output
    assert last["n_gone"] > 1000
    assert last["n_new"] > 1000
    assert not (folder / "b.map" / "work").exists()
    again = RUN(
        app, ["map", "update", *(str(folder / name) for name in ("a.map", "scans", "poses.csv")),
              "-o", str(folder / "b.map")],
    )  # fmt: skip
    assert "exists" in str(again.exception) or again.exit_code != 0


def test_slips_are_told(folder):
    for drives, words in (
        ([folder / "scans"], "behind it"),
        ([folder / "poses.csv"], "got it alone"),
        ([folder / "none", folder / "poses.csv"], "no such folder"),
    ):
        result = RUN(app, ["map", "update", str(folder / "a.map"), *map(str, drives), "-o", str(folder / "x.map")])
        assert words in str(result.exception)
        assert not (folder / "x.map").exists()
