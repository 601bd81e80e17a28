"""What the paper's figures show: where cells, marks and words stand."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import maxcon
from drawn_figures import BelowZero, parts, words, yard
from maxcon.lab.report import paper_figures as paper
from maxcon.plotting.score_panel import SearchSpaceView

NAN = np.full(3, np.nan)


def view(objective=None):
    return SearchSpaceView(parts()["accumulator"], objective or maxcon.Helmert())


# Figure 4: objectives side by side.


def test_offsets_count_from_the_reference_and_turns_are_the_short_way_round():
    # The best cell is where the scan was made: at (0, 0), with heading 0.
    assert paper.best_from(view(), yard().reference) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    elsewhere = maxcon.Pose(0.9, 2.82, 0.0, 0.0, 0.0, np.radians(-0.3))
    assert paper.best_from(view(), elsewhere) == pytest.approx((-0.9, -2.82, np.radians(0.3)))
    assert paper.view_words(view(), elsewhere) == "Helmert's score\n(x = −0.90, y = −2.82), turn 0.30°"
    behind = maxcon.Pose(0.0, 0.0, 0.0, 0.0, 0.0, np.radians(359.8))
    assert paper.best_from(view(), behind)[2] == pytest.approx(np.radians(0.2))
    assert paper.view_words(replace(view(), title="Mine"), behind).startswith("Mine\n")


@pytest.mark.parametrize(("reference", "xlim", "ylim", "best"), [
    # The prior lies 0.18 m west and 0.24 m north of the reference; cells reach 0.63 m west and 0.57 m east.
    ((0.0, 0.0), (-0.81, 0.39), (-0.39, 0.81), (0.0, 0.0)),
    ((2.0, -3.0), (-2.81, 0.0), (0.0, 3.81), (-2.0, 3.0)),  # outside, but in sight
])  # fmt: skip
def test_the_reference_is_at_zero_and_the_whole_space_in_sight(reference, xlim, ylim, best):
    panel = Figure().add_axes((0.0, 0.0, 1.0, 1.0))
    paper.draw_view(panel, view(), maxcon.Pose(*reference, 0.0, 0.0, 0.0, 0.0))
    assert panel.get_xlim() == pytest.approx(xlim) and panel.get_ylim() == pytest.approx(ylim)
    marks = [line.get_xydata()[0] for line in panel.lines]
    np.testing.assert_allclose(marks, [(0.0, 0.0), best], atol=1e-9)


def test_a_scale_says_where_it_begins():
    assert paper.scale_words([view(), view(maxcon.Count())]) == "score, over the highest of the square"
    assert "from the lowest (0)" in paper.scale_words([view(), view(BelowZero())])


# Figures 5 and 6: how distinct the answers are.


def test_medians_the_undefined_and_what_is_better_are_stated(tmp_path):
    odd = ([0.1, 0.25, 0.9], [2.0, np.nan, 40.0], [1.5, 3.25, 9.0], [0.0, 0.06, 6.0])
    found = {
        "Count": dict(zip(paper.MEASURES, map(np.array, odd), strict=True)),
        "None": dict.fromkeys(paper.MEASURES, NAN),
    }
    paper.plot_distinctness(tmp_path / "plot.svg", found, title="T")
    written = words(tmp_path / "plot.svg")
    medians = {"median 0.25", "median 21 (not defined in 1)", "median 3.25 nat", "median 0.06 m", "Count"}
    assert medians <= set(written)
    assert "Epochs of each method: 3. Upright lines: medians. Peak ratio: rivals more than 0.3 m away." in written
    assert written.count("not defined in any epoch") == 4
    assert written.count("← lower is more distinct") == 3
    title = written.index("Kurtosis along the significant ray")
    assert "higher is more distinct →" in written[title - 2 : title + 3]


def test_epochs_keep_their_distance():
    # It stands at 0, goes to 3, and comes back over its own way.
    x = np.array([0.0, 0.0, 0.0, 0.9, 1.0, 1.9, 2.0, 3.0, 2.5, 1.5, 0.5, -1.0])
    chosen = paper.spaced_epochs(np.column_stack([x, np.zeros(12)]), 1.0)
    assert chosen == [0, 4, 6, 7, 11]


def test_medians_and_left_out_epochs_of_a_kurtosis_map_are_stated(tmp_path):
    # 100 m x 50 m of window: 6.6 inches for 100 m, so circles of 13 points need 1.1 * 13 / 72 * 100 / 6.6 m.
    x = np.linspace(0.0, 50.0, 501)
    small, large = ("A", np.where(np.arange(501) == 7, np.nan, 2.5)), ("B", np.full(501, 25.0))
    paper.plot_kurtosis_map(tmp_path / "x.svg", np.column_stack([x, 0.0 * x]), small, large, point_map=None, title="T")
    written = words(tmp_path / "x.svg")
    assert any("Medians of all epochs: A 2.5 (not defined in 1); B 25." in each for each in written)
    assert any("17 of 501 epochs shown, 3 m apart or more." in each for each in written)
    assert {"large: B", "small: A", "white: not defined", "kurtosis", "5", "10", "20"} <= set(written)
