# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of the baselines: what is out of range is refused, and pickled or copied methods are the same."""

import copy
import math
import pickle
from functools import partial

import pytest

from maxcon.errors import OptionError
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MultiStart

Many = partial(MultiStart, Icp())


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        (Icp, {"residual": "planes"}, "'plane' or 'point', got 'planes'"),
        (Icp, {"gate": 0.0}, "`gate` to be finite, and above 0, got 0.0. The default is 1.0."),
        (Icp, {"gate": math.inf}, "`gate` to be finite, and above 0, got inf"),
        (Icp, {"gate": math.nan}, "`gate` to be finite, and above 0, got nan"),
        (Icp, {"thinning": -0.1}, "`thinning` to be finite, and 0 or more, got -0.1"),
        (Icp, {"max_iterations": 0}, "`max_iterations` to be a whole number from 1, got 0"),
        (Icp, {"max_iterations": 2.5}, "`max_iterations` to be a whole number from 1, got 2.5. The default is 100."),
        (Gicp, {"n_neighbours": 0}, "`n_neighbours` to be a whole number from 1, got 0"),
        (CountThenGicp, {"heading_half_width_deg": -1.0}, "`heading_half_width_deg` to be finite, and 0 or more"),
        (Many, {"spacing": 0.0}, "`spacing` to be finite, and above 0"),
        (Many, {"choice": "best"}, "`choice` to be 'agreement' or 'overlap', got 'best'"),
    ],
)
def test_options_out_of_range_are_refused(kind, options, words):
    with pytest.raises(OptionError) as refusal:
        kind(**options)
    assert words in str(refusal.value)


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
