# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of the baselines: what is out of range is refused, and pickled or copied methods are the same."""

import copy
import math
import pickle
from functools import partial

import pytest

from maxcon.errors import OptionError
from maxcon.lab.baselines import Choice, CountThenGicp, Gicp, Icp, MultiStart, Residual

Many = partial(MultiStart, Icp())


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        (Icp, {"residual": "planes"}, "'plane' or 'point', got 'planes'"),
        (Icp, {"gate": 0.0}, "`gate` > 0 m, got 0.0. The default is 1."),
        (Icp, {"gate": math.inf}, "`gate` > 0 m, got inf"),
        (Icp, {"gate": math.nan}, "`gate` > 0 m, got nan"),
        (Icp, {"thinning": -0.1}, "`thinning` >= 0 m, got -0.1"),
        (Icp, {"max_iterations": 0}, "`max_iterations` to be a whole number from 1, got 0"),
        (Icp, {"max_iterations": 2.5}, "`max_iterations` to be a whole number from 1, got 2.5. The default is 100."),
        (Icp, {"step_tolerance": 0.0}, "`step_tolerance` > 0 m"),
        (Icp, {"turn_tolerance": -1.0}, "`turn_tolerance` > 0 rad"),
        (Icp, {"target_edge": 0.0}, "`target_edge` > 0 m"),
        (Gicp, {"gate": -1.0}, "`gate` > 0 m, got -1.0. The default is 3."),
        (Gicp, {"n_neighbours": 4}, "`n_neighbours` to be a whole number from 5, got 4. The default is 10."),
        (CountThenGicp, {"half_width": 0.0}, "`half_width` > 0 m, got 0.0. The default is 3"),
        (CountThenGicp, {"heading_half_width_deg": -1.0}, "`heading_half_width_deg` >= 0 degrees"),
        (CountThenGicp, {"voxel": math.nan}, "`voxel` > 0 m"),
        (CountThenGicp, {"heading_step_deg": 0.0}, "`heading_step_deg` > 0 degrees"),
        (Many, {"n_side": 0}, "`n_side` to be a whole number from 1, got 0"),
        (Many, {"spacing": 0.0}, "`spacing` > 0 m"),
        (Many, {"n_headings": 0}, "`n_headings` to be a whole number from 1, got 0"),
        (Many, {"overlap_distance": 0.0}, "`overlap_distance` > 0 m"),
        (Many, {"choice": "best"}, "`choice` to be 'agreement' or 'overlap', got 'best'"),
        (Many, {"agreement_heading_deg": math.nan}, "`agreement_heading_deg` > 0 degrees"),
    ],
)
def test_options_out_of_range_are_refused(kind, options, words):
    with pytest.raises(OptionError) as refusal:
        kind(**options)
    assert words in str(refusal.value)


def test_names_of_values():
    assert Icp("plane").residual is Residual.PLANE
    assert Icp(residual=Residual.POINT) == Icp("point") != Icp("plane")
    assert Many(choice="overlap").choice is Choice.OVERLAP


@pytest.mark.parametrize("method", [Icp("point", gate=2.0), Gicp(1.0), Many(n_side=2), CountThenGicp(gicp=Gicp(1.0))])
def test_a_method_travels_without_what_it_keeps_of_maps(same, street, street_map, street_scan, method):
    if not isinstance(method, Icp | MultiStart):
        pytest.importorskip("small_gicp")
    prior = street.prior(0.3)
    wanted = method.localize(street_scan, street_map, prior)
    packed = pickle.dumps(method)
    assert len(packed) < 1500
    for twin in (pickle.loads(packed), copy.deepcopy(method)):
        assert twin == method and hash(twin) == hash(method) and "targets" not in repr(twin)
        assert same(twin.localize(street_scan, street_map, prior), wanted)
