# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import route_over_crossing


def test_route_turns_left_over_the_crossing():
    route = route_over_crossing(0.0, 60.0, 40.0, lane=1.5)
    np.testing.assert_allclose(route.points[0], [-60.0, -1.5])
    np.testing.assert_allclose(route.points[-1], [1.5, 40.0], atol=0.06)
    assert np.diff(route.distances).max() < 0.11


@pytest.mark.parametrize(("before", "after"), [(5.0, 50.0), (50.0, 7.0)])
def test_too_short_a_route_is_refused(before, after):
    with pytest.raises(OptionError, match=r"Expected a route of more than 7\.5 m"):
        route_over_crossing(0.0, before, after)
