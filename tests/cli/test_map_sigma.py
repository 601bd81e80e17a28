# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What `map build` and `map info` say of how well a map is known."""

import json

import numpy as np
import pytest


@pytest.fixture
def said(maxcon, tmp_path):
    """The line on sigma that `map build` and `map info` print."""

    def line(*arguments):
        ended = maxcon("map", "build", *arguments, "-o", tmp_path / "a.map", "-q")
        assert ended.code == 0, ended
        informed = maxcon("map", "info", tmp_path / "a.map")
        (one,) = (line for line in informed.out.splitlines() if line.startswith("sigma"))
        assert one in ended.out.splitlines()
        return one

    return line


@pytest.fixture
def rounds(tmp_path):
    """Walls across a street of 30 m, passed twice at 0.25 m/s, with 0.02 m between."""
    rng = np.random.default_rng(1)
    along = np.repeat(np.arange(0.0, 30.0, 1.1), 4000)
    wall = np.column_stack([along, *rng.uniform(0.0, 3.0, (2, len(along)))])
    points = np.concatenate([wall, wall + [0.02, 0.0, 0.0]])
    path = tmp_path / "rounds.npz"
    np.savez(path, points=points, times=np.concatenate([4.0 * along, 300.0 + 4.0 * along]))
    return path


def test_given(said, street_npz):
    assert said(street_npz, "--sigma", "0.0075") == "sigma        0.0075 m, given"


def test_assumed(said, street_npz):
    words = "sigma        0.02 m, assumed: no planes of points with times; say it with --sigma"
    assert said(street_npz) == words


def test_from_passes(said, rounds):
    words = said(rounds)
    assert words.startswith("sigma        0.010 m, from 2 passes of 0.014 m each, compared at ")
    assert words.endswith(" places")


def test_from_an_alignment(said, maxcon, refused, rounds, tmp_path):
    file = tmp_path / "alignment.json"
    enough = {"n_rounds": 2, "n_ties": 100}
    file.write_text(json.dumps({"sigma": {"of_map": 0.0125}, **enough}))
    assert said(rounds).startswith("sigma        0.0125 m, from alignment.json beside the clouds")
    file.write_text(json.dumps({"sigma": {"of_map": 0.002}, **enough}))
    assert said(rounds, "--overwrite").startswith("sigma        0.010 m, from 2 passes")
    for few in ({"n_rounds": 1, "n_ties": 100}, {"n_rounds": 2, "n_ties": 4}):
        file.write_text(json.dumps({"sigma": {"of_map": 0.0005}, **few}))
        assert said(rounds, "--overwrite").startswith("sigma        0.02 m, from alignment.json")
    assert said(rounds, "--overwrite", "--sigma", "0.5") == "sigma        0.5 m, given"
    for broken in ("{", "[]", '{"sigma": {"of_map": -1}}', '{"sigma": {"of_map": NaN}}', '{"sigma": 1}'):
        file.write_text(broken)
        refused(maxcon("map", "build", rounds, "-o", tmp_path / "b.map"), "alignment.json", "--sigma")


def test_a_map_that_does_not_say(said, maxcon, street_npz, tmp_path):
    from maxcon.map.manifest import read_manifest, write_manifest

    said(street_npz)
    manifest = read_manifest(tmp_path / "a.map")
    del manifest.build["sigma"]
    write_manifest(tmp_path / "a.map", manifest)
    assert json.loads((tmp_path / "a.map" / "manifest.json").read_text())["sigma"] == 0.02
    assert "sigma        0.02 m, it does not say from what\n" in maxcon("map", "info", tmp_path / "a.map").out
