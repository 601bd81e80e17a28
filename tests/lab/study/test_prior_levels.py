# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Levels of a prior's error: how priors are drawn, and what the methods are told."""

import math
from dataclasses import replace

import pytest

from maxcon import MaximumConsensus, Pose
from maxcon.errors import OptionError
from maxcon.lab.baselines import CountThenGicp, MultiStart
from maxcon.lab.study.methods import MAP_VARIANTS
from maxcon.lab.study.prior_trials import (
    COUNT_THEN_GICP,
    GICP_FROM_MANY,
    LEVELS,
    MAXCON,
    methods_at,
    parse_level,
    prior_at,
    prior_level,
    space_of,
)

REFERENCE = Pose(100.0, -50.0, 2.0, 0.01, -0.02, 1.0)


def test_priors_are_within_their_level_and_only_in_x_y_and_heading():
    level = prior_level(12.0, 10.0)
    priors = [prior_at(REFERENCE, level, 0, epoch) for epoch in range(400)]
    dx = [prior.x - REFERENCE.x for prior in priors]
    turns = [math.degrees(prior.heading - REFERENCE.heading) for prior in priors]
    assert -12.0 <= min(dx) < -11.0 and 11.0 < max(dx) <= 12.0
    assert -10.0 <= min(turns) < -9.0 and 9.0 < max(turns) <= 10.0
    assert all(replace(prior, x=REFERENCE.x, y=REFERENCE.y, heading=REFERENCE.heading) == REFERENCE for prior in priors)


def test_a_prior_depends_on_nothing_but_seed_epoch_and_level():
    first = prior_at(REFERENCE, LEVELS[1], 0, 7)
    prior_at(REFERENCE, LEVELS[2], 0, 3)
    assert prior_at(REFERENCE, LEVELS[1], 0, 7) == first
    others = [
        prior_at(REFERENCE, LEVELS[1], 1, 7),
        prior_at(REFERENCE, LEVELS[1], 0, 8),
        prior_at(REFERENCE, prior_level(3.0, 2.5), 0, 7),
    ]
    assert len({first, *others}) == 4


def test_levels_are_written_as_metres_and_degrees():
    assert parse_level("12:10") == prior_level(12.0, 10.0)
    assert parse_level("1.5:0.5") == prior_level(1.5, 0.5)
    assert parse_level("60:180") == prior_level(60.0, 180.0)


@pytest.mark.parametrize("word", ["12", "12:", "a:b", "0:1", "1:0", "-3:2", "nan:1", "inf:1", "1:181", "1:2:3"])
def test_other_words_are_refused(word):
    with pytest.raises(OptionError, match="METRES:DEGREES"):
        parse_level(word)


@pytest.mark.parametrize("level", LEVELS)
def test_the_space_is_open_and_holds_the_level(level):
    space = space_of(level)
    assert space.is_open
    assert (space.half_width, space.heading_half_width_deg) == (level.offset, level.heading_deg)


def test_methods_are_told_the_level():
    level = prior_level(6.0, 5.0)
    found = {method.name: method for method in methods_at(level)}
    assert next(iter(found)) == MAXCON
    assert found[MAXCON].method == MaximumConsensus(space_of(level))
    assert {method.map_name for method in found.values()} == {"standard", "ground"} <= set(MAP_VARIANTS)
    many, count = found[GICP_FROM_MANY].method, found[COUNT_THEN_GICP].method
    assert isinstance(many, MultiStart) and isinstance(count, CountThenGicp)
    starts = many.starts(REFERENCE)
    assert len(starts) == 75
    assert max(start.x for start in starts) - REFERENCE.x == pytest.approx(6.0 - many.spacing / 2)
    turn = math.degrees(max(start.heading for start in starts) - REFERENCE.heading)
    assert turn == pytest.approx(5.0 - many.heading_spacing_deg / 2)
    assert (count.half_width, count.heading_half_width_deg) == (6.0, 5.0)


def test_gates_are_chosen():
    names = [method.name for method in methods_at(LEVELS[0], gates=(1.0, 6.0))]
    assert names[3:] == ["GICP, gate 1 m", "GICP, gate 6 m", "ICP, gate 1 m"]
