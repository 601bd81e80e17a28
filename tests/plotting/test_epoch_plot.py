# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
from dataclasses import replace

import numpy as np
import pytest

import maxcon
from drawn_figures import SPACE, parts, png_size, yard
from maxcon.errors import OptionError
from maxcon.plotting.epoch import Scene, answer_words, is_off_the_ground


def draw(path, given, **changes):
    maxcon.plot_epoch(path, **(given | {"title": "A yard"} | changes))


def test_an_objective_may_be_named(tmp_path):
    draw(tmp_path / "a.png", parts())
    draw(tmp_path / "b.png", parts(), objective="helmert")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert png_size(tmp_path / "a.png") == (1812, 1122)
    with pytest.raises(OptionError, match="helmert"):
        draw(tmp_path / "c.png", parts(), objective="highest")


def test_what_matched_is_the_consensus_set_and_without_any_the_scan_is_drawn_at_the_prior(tmp_path):
    lost = yard()._replace(prior=maxcon.Pose(0.0, 0.0, 500.0, 0.0, 0.0, 0.0))
    given = lost.conclude()
    assert given["estimate"].status is maxcon.Status.NO_MATCH
    draw(tmp_path / "lost.png", given)
    assert not Scene(lost.scan, lost.point_map, lost.prior, SPACE, given["estimate"]).has_answer
    estimate = parts()["estimate"]
    scene = Scene(yard().scan, yard().point_map, yard().prior, SPACE, estimate)
    assert scene.is_matched.sum() == parts()["accumulator"].moments[estimate.cell][0] > 900
    assert scene.is_drawn.all()


def test_map_and_scan_may_be_empty(tmp_path):
    nothing = np.empty((0, 3))
    empty = maxcon.PointMap.from_points(nothing, nothing, cell=0.06)
    draw(tmp_path / "empty.png", yard()._replace(scan=maxcon.Scan(nothing), point_map=empty).conclude())
    assert png_size(tmp_path / "empty.png") == (1812, 1122)


@pytest.mark.parametrize("status", list(maxcon.Status))
def test_title_says_in_plain_words_what_happened(status):
    estimate = replace(parts()["estimate"], status=status)
    words = answer_words(estimate, yard().prior, yard().reference)
    assert words.startswith("Localized." if estimate.is_localized else f"NOT LOCALIZED: {status.value}.")
    assert status.explanation in words.replace("\n", " ")
    assert len(words.splitlines()) == 2
    if status is not maxcon.Status.NO_MATCH:
        assert "+0.18 m in x, −0.24 m in y, +0.50° from the prior" in words
        assert "0.00 m and 0.00° from the reference" in words


def test_a_scan_without_normals_is_drawn_and_its_title_says_so():
    bare = yard()._replace(scan=maxcon.Scan(yard().scan.points, np.zeros_like(yard().scan.points)))
    estimate = bare.conclude()["estimate"]
    assert Scene(bare.scan, bare.point_map, bare.prior, SPACE, estimate).is_drawn.all()
    assert "Normals on 0 % of the points, none horizontal" in answer_words(estimate, bare.prior, bare.reference)


def test_points_on_level_ground_are_not_drawn():
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-9.0, 9.0, (300, 2)), rng.normal(-1.8, 0.02, 300)])
    bush = rng.uniform([3.0, 3.0, -1.2], [4.0, 4.0, 0.5], (50, 3))
    wall = np.column_stack([np.full(50, 8.0), rng.uniform(-5.0, 5.0, 50), rng.uniform(-1.8, 2.0, 50)])
    normals = np.zeros((400, 3))
    normals[:150, 2], normals[350:, 0] = 1.0, -1.0  # half of the ground has a normal, the bush none
    is_drawn = is_off_the_ground(
        maxcon.Scan(np.concatenate([ground, bush, wall]), normals), maxcon.Pose(0, 0, 1.8, 0, 0, 0)
    )
    assert not is_drawn[:300].any()
    assert is_drawn[300:].all()
