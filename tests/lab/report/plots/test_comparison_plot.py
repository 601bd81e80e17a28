# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

import maxcon
from maxcon.errors import OptionError
from maxcon.lab.report.plots.comparison_plot import (
    ComparisonRow,
    _draw_view,
    _letters,
    _view_words,
    best_from,
    plot_comparison,
)
from maxcon.plotting.score_panel import SearchSpaceView


@pytest.fixture(scope="module")
def row(epoch, space):
    accumulator = epoch.accumulate(space)
    views = tuple(SearchSpaceView(accumulator, objective) for objective in (maxcon.Count(), maxcon.Helmert()))
    return ComparisonRow("yard", epoch.scan, epoch.point_map, epoch.reference, views)


@pytest.fixture
def panel():
    from matplotlib.figure import Figure

    return Figure().add_axes((0.0, 0.0, 1.0, 1.0))


def test_offsets_count_from_the_reference(row):
    # The best cell is where the scan was made: at (0, 0), with heading 0.
    assert best_from(row.views[1], row.reference) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    elsewhere = maxcon.Pose(0.9, 2.82, 0.0, 0.0, 0.0, np.radians(-0.3))
    assert best_from(row.views[1], elsewhere) == pytest.approx((-0.9, -2.82, np.radians(0.3)))
    assert _view_words(row.views[1], elsewhere) == "Helmert's score\n(x = −0.90, y = −2.82), turn 0.30°"


def test_turns_are_the_short_way_round(row):
    behind = maxcon.Pose(0.0, 0.0, 0.0, 0.0, 0.0, np.radians(359.8))
    assert best_from(row.views[0], behind)[2] == pytest.approx(np.radians(0.2))


def test_titles_of_the_users_own_are_kept(row):
    view = SearchSpaceView(row.views[0].accumulator, maxcon.Count(), "Count, a voxel once")
    assert _view_words(view, row.reference).splitlines()[0] == "Count, a voxel once"


def test_the_reference_is_at_zero_and_the_whole_space_in_sight(row, panel):
    _draw_view(panel, row.views[1], row.reference)
    # The prior lies 0.18 m west and 0.24 m north of the reference; cells reach 0.63 m west and 0.57 m east.
    assert panel.images[0].get_extent() == pytest.approx([-0.81, 0.39, -0.39, 0.81])
    assert panel.get_xlim() == pytest.approx((-0.81, 0.39))
    reference, best = (line.get_xydata()[0] for line in panel.lines)
    np.testing.assert_array_equal(reference, [0.0, 0.0])
    np.testing.assert_allclose(best, [0.0, 0.0], atol=1e-9)


def test_a_reference_outside_the_search_space_stays_in_sight(row, panel):
    _draw_view(panel, row.views[1], maxcon.Pose(2.0, -3.0, 0.0, 0.0, 0.0, 0.0))
    assert panel.get_xlim() == pytest.approx((-2.81, 0.0))
    assert panel.get_ylim() == pytest.approx((0.0, 3.81))
    np.testing.assert_allclose(panel.lines[1].get_xydata()[0], [-2.0, 3.0], atol=1e-9)


def test_nothing_matched_is_said_and_not_marked(row, panel):
    accumulator = row.views[0].accumulator
    empty = SearchSpaceView(replace(accumulator, moments=np.zeros_like(accumulator.moments)), maxcon.Count())
    _draw_view(panel, empty, row.reference)
    assert len(panel.lines) == 1
    assert _view_words(empty, row.reference) == "Count\nall cells score the same"


def test_window_holds_most_of_the_scan_within_limits(row):
    # The walls reach 9 m along x and 5 m along y.
    assert row.window.size == pytest.approx((17.7, 17.7), abs=0.7)
    assert row.window.west + row.window.east == pytest.approx(0.0)
    far = ComparisonRow("far", maxcon.Scan([[0.0, 100.0, 0.0]]), row.point_map, row.reference, row.views)
    near = ComparisonRow("near", maxcon.Scan(np.empty((0, 3))), row.point_map, row.reference, row.views)
    assert (far.window.size[0], near.window.size[0]) == (70.0, 10.0)


def test_panels_are_lettered():
    assert list(islice(_letters(), 28))[::9] == ["(a)", "(j)", "(s)", "(bb)"]


def test_rows_and_views_make_the_picture_larger(row, tmp_path, png_size):
    one_view = replace(row, views=row.views[:1])
    three_views = replace(row, views=(*row.views, row.views[0]))
    sizes = []
    for number, rows in enumerate([[row], [row, one_view], [one_view], [three_views]]):
        plot_comparison(tmp_path / f"{number}.png", rows, title="Count beside Helmert")
        sizes.append(png_size(tmp_path / f"{number}.png"))
    assert sizes[0] == sizes[2] == (1218, 708)
    assert sizes[1] == (1218, 708 + 474)
    assert sizes[3] == (1218 + 396, 708)


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_comparison_gives_the_same_bytes(row, tmp_path, suffix):
    files = [tmp_path / f"{name}{suffix}" for name in "ab"]
    for file in files:
        fresh = tuple(SearchSpaceView(view.accumulator, view.objective) for view in row.views)
        plot_comparison(file, [replace(row, views=fresh, label="<$x^2$>")], title="& more")
    assert files[0].read_bytes() == files[1].read_bytes()


def test_no_row_and_no_view_are_refused(row, tmp_path):
    with pytest.raises(OptionError, match="at least one epoch to compare"):
        plot_comparison(tmp_path / "none.png", [], title="None")
    with pytest.raises(OptionError, match="search space to compare at 'yard', got none"):
        replace(row, views=())
    with pytest.raises(OptionError, match=r"to end in \.png or \.svg"):
        plot_comparison(tmp_path / "none.pdf", [row], title="None")
    assert list(tmp_path.iterdir()) == []
