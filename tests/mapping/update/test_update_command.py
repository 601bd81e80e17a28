# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon map update` and what `maxcon map info` and `maxcon localize` make of its map."""

from typer.testing import CliRunner

from maxcon.cli import app
from maxcon.map.manifest import read_manifest
from street_of_boxes import CAR, OTHER_CAR, WALL, DriveOfBoxes, map_of
from written_maps import write

RUN = CliRunner().invoke


def test_an_updated_map_tells_its_history(tmp_path):
    """A street's map with CAR, and a drive when OTHER_CAR is there instead."""
    write(tmp_path / "a.map", map_of(WALL, CAR), origin=(0.0, 0.0, 0.0))
    scans, poses = DriveOfBoxes(lambda seconds: (OTHER_CAR,)).write(tmp_path)
    command = ["map", "update", *map(str, (tmp_path / "a.map", scans, poses, "-o", tmp_path / "b.map")), "-q"]
    done = RUN(app, command)
    assert done.exit_code == 0, done.output
    said = RUN(app, ["map", "info", str(tmp_path / "b.map"), "--check"])
    assert said.exit_code == 0, said.output
    assert "update       1 of a.map" in said.output
    assert "poses.csv (40 looks)" in said.output
    last = read_manifest(tmp_path / "b.map").build["updates"][-1]
    assert f"{last['n_gone']:,} voxels" in said.output
    assert last["n_gone"] > 1000
    assert last["n_new"] > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.map", "b.map", "poses.csv", "scans"]
    assert "exist" in str(RUN(app, command).exception)
    none = RUN(app, ["map", "update", str(tmp_path / "a.map"), str(scans), "-o", str(tmp_path / "x.map")])
    assert "behind it" in str(none.exception)
    assert not (tmp_path / "x.map").exists()
