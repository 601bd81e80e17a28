# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import pytest

import maxcon
from maxcon.errors import OptionError
from maxcon.lab.report import SearchSpaceView, plot_search_spaces


def test_views_stand_side_by_side(epoch, space, tmp_path, png_size):
    accumulator = epoch.accumulate(space)
    one, two = SearchSpaceView(accumulator, maxcon.Count()), SearchSpaceView(accumulator, maxcon.Helmert())
    plot_search_spaces(tmp_path / "one.png", [one], title="One")
    plot_search_spaces(tmp_path / "two.png", [one, two], title="Two", reference=epoch.reference)
    assert 1.9 < png_size(tmp_path / "two.png")[0] / png_size(tmp_path / "one.png")[0] < 2.0


def test_no_view_is_refused(tmp_path):
    with pytest.raises(OptionError, match="at least one search space"):
        plot_search_spaces(tmp_path / "none.png", [], title="None")
    assert list(tmp_path.iterdir()) == []
