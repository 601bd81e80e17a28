# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

import maxcon
from maxcon.errors import OptionError
from maxcon.lab.report.plots.headings_plot import (
    _draw_section,
    _highest_in_section,
    _panel_places,
    _words,
    plot_headings,
)
from maxcon.plotting.score_panel import SearchSpaceView

PRIOR = maxcon.Pose(100.0, 50.0, 0.0, 0.0, 0.0, 0.0)


def counted(matches, n_headings=3):
    """A view by count on a search space of 12 x 12 cells of 0.5 m, with matches at a few cells."""
    space = maxcon.SearchSpace(3.0, 0.5, 0.25 * (n_headings - 1), 0.5)
    moments = np.zeros((*space.shape, 4))
    for cell, number in matches.items():
        moments[cell][0] = number
    return SearchSpaceView(maxcon.Accumulator(moments, space, PRIOR), maxcon.Count())


@pytest.mark.parametrize("n_headings", [1, 3, 5, 9, 61])
def test_any_number_of_headings_is_drawn_to_the_same_width(tmp_path, n_headings, png_size):
    view = counted({(0, 5, 5): 7.0}, n_headings)
    plot_headings(tmp_path / "headings.png", view.accumulator, view.objective, title="A peak", reference=PRIOR)
    width, height = png_size(tmp_path / "headings.png")
    assert width == 1152
    assert height < 1300


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_headings_give_the_same_bytes(epoch, space, tmp_path, suffix):
    files = [tmp_path / f"{name}{suffix}" for name in "ab"]
    for file in files:
        accumulator = epoch.accumulate(space)
        plot_headings(file, accumulator, maxcon.Helmert(), title="Peak", reference=epoch.reference)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_highest_score_is_that_of_the_section():
    view = counted({(1, 6, 4): 9.0, (0, 8, 2): 5.0, (0, 9, 4): 7.0, (2, 6, 7): 8.0, (2, 0, 0): 1.0})
    # 1 m is two cells: (0, 8, 2) lies at the corner of the section, (0, 9, 4) and (2, 6, 7) just outside.
    assert [_highest_in_section(view, heading, 1.0) for heading in range(3)] == [5.0, 9.0, 0.0]
    assert [_highest_in_section(view, heading, 1.5) for heading in range(3)] == [7.0, 9.0, 8.0]
    assert _highest_in_section(view, 2, 50.0) == 8.0


def test_best_cell_lies_in_the_middle_of_its_panel():
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    view = counted({(1, 7, 4): 9.0})  # 0.5 m north and 1 m west of the prior
    axes = Figure().add_axes((0.0, 0.0, 1.0, 1.0))
    image = _draw_section(axes, view, 1, 1.0, Normalize(0.0, 9.0))
    assert axes.get_xlim() == (-1.0, 1.0) and axes.get_ylim() == (-1.0, 1.0)
    # The whole space: 3.25 m to the west and south of the prior, 2.75 m to the east and north.
    assert image.get_extent() == [-2.25, 3.75, -3.75, 2.25]
    assert axes.get_title("left") == "0° (best)"
    assert axes.get_title("right") == "9"


@pytest.mark.parametrize("n_panels", range(1, 10))
def test_sections_do_not_overlap_and_stay_inside(n_panels):
    side, places, height = _panel_places(n_panels)
    assert len(places) == n_panels
    for number, (left, bottom) in enumerate(places):
        assert left >= 0.85 - 1e-9 and left + side <= 0.85 + 7.7 + 1e-9
        assert bottom >= 0.65 - 1e-9 and bottom + side <= height - 1.35 + 1e-9
        for other_left, other_bottom in places[:number]:
            assert abs(left - other_left) > side or abs(bottom - other_bottom) > side


def test_words_say_what_is_drawn_and_when_a_section_is_cut():
    middle, rim = counted({(1, 6, 6): 9.0}), counted({(1, 6, 11): 9.0})
    assert _words(middle, 3, 1.0).startswith("Count. All 3 headings, ±1 m around the best cell.")
    assert "outside the search space" not in _words(middle, 3, 1.0)
    assert "Grey: outside the search space." in _words(rim, 3, 1.0)
    assert "9 of 61 headings, ±0.5 m" in _words(counted({(1, 6, 6): 9.0}, 61), 9, 0.5)
    assert "The prior's heading" in _words(counted({(0, 6, 6): 9.0}, 1), 1, 1.0)


def test_nothing_matched_is_drawn_without_a_best_heading(tmp_path, svg_root):
    view = counted({})
    plot_headings(tmp_path / "nothing.svg", view.accumulator, view.objective, title="Nothing")
    svg_root(tmp_path / "nothing.svg")


@pytest.mark.parametrize("half_width", [0.0, -1.0, float("nan"), float("inf")])
def test_sections_without_a_size_are_refused(tmp_path, half_width):
    view = counted({(1, 6, 6): 9.0})
    with pytest.raises(OptionError, match="half width of the section to be a positive number, got"):
        plot_headings(tmp_path / "a.png", view.accumulator, view.objective, title="None", half_width=half_width)
    assert list(tmp_path.iterdir()) == []


def test_headings_in_other_kinds_of_files_are_refused(tmp_path):
    view = counted({(1, 6, 6): 9.0})
    with pytest.raises(OptionError, match=r"to end in \.png or \.svg"):
        plot_headings(tmp_path / "headings.jpg", view.accumulator, view.objective, title="A peak")
