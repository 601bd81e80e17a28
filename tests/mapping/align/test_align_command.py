# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon map align`, in this process."""

import numpy as np
from typer.testing import CliRunner

from maxcon.cli import app
from maxcon.errors import OptionError


def run(*arguments):
    return CliRunner().invoke(app, ["map", "align", *map(str, arguments), "-q"])


def test_it_says_how_far_rounds_lay_apart_and_what_that_makes_of_a_map(three_passes, tmp_path):
    clouds, _ = three_passes
    ended = run(*clouds, "-o", tmp_path / "out", "--georeference-sigma-deg", "0.2")
    assert ended.exit_code == 0, ended
    lines = ended.output.splitlines()
    assert lines[0] == str(tmp_path / "out")
    assert lines[1] == "passes       3, told apart by time"
    assert lines[3] == "corrections  a motion of each pass, rigid"
    assert [line[:5] for line in lines[5:8]] == ["1 - 2", "1 - 3", "2 - 3"]
    assert lines[8].startswith("sigma        one pass beside the others 0.")
    assert "the mean of the passes' georeference" in lines[9]
    assert not any(line.startswith("note") for line in lines)


def test_a_round_that_is_not_tied_is_noted(tmp_path, write_las, scene):
    rng = np.random.default_rng(0)
    passes = [scene.points_on(scene.corner, 60, 0.01, rng) for _ in range(3)]
    times = np.linspace(0.0, 8.0, len(passes[0]))
    passes[2] += [500.0, 0.0, 0.0]
    clouds = [write_las(tmp_path / f"{i}.laz", points, times + 100.0 * i) for i, points in enumerate(passes)]
    ended = run(*clouds, "-o", tmp_path / "out")
    assert ended.exit_code == 0, ended
    note = ended.output.splitlines()[-1]
    assert note.startswith("note         pass 3 (")
    assert note.endswith("cannot be connected to any other: it stays where it was")


def test_words_that_are_none_are_refused(three_passes, tmp_path):
    clouds, _ = three_passes
    ended = run(*clouds, "-o", tmp_path / "out", "--rounds", "colour")
    assert isinstance(ended.exception, OptionError)
    assert not (tmp_path / "out").exists()
