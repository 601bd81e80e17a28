"""What the paper's figures show, and its claims against small tables made by hand."""

from dataclasses import replace

import numpy as np
import pytest

import maxcon
from drawn_figures import parts, words, yard
from maxcon.lab.paper import search_spaces
from maxcon.lab.paper.claims import Verdict, paper_claims
from maxcon.lab.paper.distinctness_plots import MEASURES, plot_distinctness, plot_kurtosis_map, spaced_epochs
from maxcon.plotting.score_panel import SearchSpaceView
from study_tables import rows_of

NAN = np.full(3, np.nan)


@pytest.fixture
def panel():
    from matplotlib.figure import Figure

    return Figure().add_axes((0.0, 0.0, 1.0, 1.0))


def view(objective=None):
    return SearchSpaceView(parts()["accumulator"], objective or maxcon.Helmert())


# Figure 4: objectives side by side.


def test_offsets_count_from_the_reference_and_turns_are_the_short_way_round():
    # The best cell is where the scan was made: at (0, 0), with heading 0.
    assert search_spaces.best_from(view(), yard().reference) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    elsewhere = maxcon.Pose(0.9, 2.82, 0.0, 0.0, 0.0, np.radians(-0.3))
    assert search_spaces.best_from(view(), elsewhere) == pytest.approx((-0.9, -2.82, np.radians(0.3)))
    assert search_spaces.view_words(view(), elsewhere) == "Helmert's score\n(x = −0.90, y = −2.82), turn 0.30°"
    behind = maxcon.Pose(0.0, 0.0, 0.0, 0.0, 0.0, np.radians(359.8))
    assert search_spaces.best_from(view(), behind)[2] == pytest.approx(np.radians(0.2))
    assert search_spaces.view_words(replace(view(), title="Mine"), behind).startswith("Mine\n")


@pytest.mark.parametrize(
    ("reference", "xlim", "ylim", "best"),
    [
        # The prior lies 0.18 m west and 0.24 m north of the reference; cells reach 0.63 m west and 0.57 m east.
        ((0.0, 0.0), (-0.81, 0.39), (-0.39, 0.81), (0.0, 0.0)),
        ((2.0, -3.0), (-2.81, 0.0), (0.0, 3.81), (-2.0, 3.0)),  # outside, but in sight
    ],
)
def test_the_reference_is_at_zero_and_the_whole_space_in_sight(panel, reference, xlim, ylim, best):
    search_spaces.draw_view(panel, view(), maxcon.Pose(*reference, 0.0, 0.0, 0.0, 0.0))
    assert panel.get_xlim() == pytest.approx(xlim) and panel.get_ylim() == pytest.approx(ylim)
    marks = [line.get_xydata()[0] for line in panel.lines]
    np.testing.assert_allclose(marks, [(0.0, 0.0), best], atol=1e-9)


# Figure 3: the overview.


def test_blocks_hold_their_highest_score_and_epochs_keep_their_distance():
    scores = np.array([[1.0, 2.0, 9.0], [0.0, 5.0, 3.0], [4.0, -np.inf, 7.0]])
    np.testing.assert_array_equal(search_spaces.highest_of_blocks(scores, 2), [[5.0, 9.0], [4.0, 7.0]])
    np.testing.assert_array_equal(search_spaces.highest_of_blocks(scores, 1), scores)
    np.testing.assert_array_equal(search_spaces.highest_of_blocks(scores, 5), [[9.0]])
    x = np.array([0.0, 0.0, 0.0, 0.9, 1.0, 1.9, 2.0, 3.0, 2.5, 1.5, 0.5, -1.0])
    chosen = spaced_epochs(np.column_stack([x, np.zeros(12)]), 1.0)
    assert chosen == [0, 4, 6, 7, 11]


def test_best_cell_is_marked_on_the_ground(panel):
    search_spaces.draw_space(panel, view(), is_localized=True, is_this=True)
    search_spaces.draw_space(panel, view(), is_localized=False, is_this=False)
    pose = parts()["estimate"].pose
    for line, marker in zip(panel.lines, "ox", strict=True):
        np.testing.assert_allclose(line.get_xydata()[0], [pose.x, pose.y], atol=1e-3)  # refined
        assert line.get_marker() == marker
    # Twenty cells of 6 cm around (-0.18, 0.24).
    assert panel.images[0].get_extent() == pytest.approx([-0.81, 0.39, -0.39, 0.81])
    assert panel.images[0].get_array().max() == parts()["estimate"].score


@pytest.mark.parametrize("status", [maxcon.Status.LOCALIZED, maxcon.Status.AT_RIM])
def test_the_overview_says_how_the_epoch_ended(status):
    estimate = replace(parts()["estimate"], status=status)
    found = search_spaces.overview_words(estimate, maxcon.Helmert(), parts()["accumulator"]).replace("\n", " ")
    assert "1.2 m × 1.2 m, at the best heading; colours: Helmert's score." in found
    ending = "localized" if status is maxcon.Status.LOCALIZED else f"NOT LOCALIZED: {status.value}"
    assert f"This epoch is {ending}." in found


# Figures 5 and 6: how distinct the answers are.


def test_medians_the_undefined_and_what_is_better_are_stated(tmp_path):
    odd = ([0.1, 0.25, 0.9], [2.0, np.nan, 40.0], [1.5, 3.25, 9.0], [0.0, 0.06, 6.0])
    found = {"Count": dict(zip(MEASURES, map(np.array, odd), strict=True)), "None": dict.fromkeys(MEASURES, NAN)}
    plot_distinctness(tmp_path / "plot.svg", found, title="T")
    written = words(tmp_path / "plot.svg")
    medians = {"median 0.25", "median 21 (not defined in 1)", "median 3.25 nat", "median 0.06 m", "Count"}
    assert medians <= set(written)
    assert "Epochs of each method: 3. Upright lines: medians. Peak ratio: rivals more than 0.3 m away." in written
    assert written.count("not defined in any epoch") == 4
    assert written.count("← lower is more distinct") == 3
    title = written.index("Kurtosis along the significant ray")
    assert "higher is more distinct →" in written[title - 2 : title + 3]


def test_medians_and_left_out_epochs_of_a_kurtosis_map_are_stated(tmp_path):
    # 100 m x 50 m of window: 6.6 inches for 100 m, so circles of 13 points need 1.1 * 13 / 72 * 100 / 6.6 m.
    x = np.linspace(0.0, 50.0, 501)
    small, large = ("A", np.where(np.arange(501) == 7, np.nan, 2.5)), ("B", np.full(501, 25.0))
    plot_kurtosis_map(tmp_path / "x.svg", np.column_stack([x, 0.0 * x]), small, large, point_map=None, title="T")
    written = words(tmp_path / "x.svg")
    assert any("Medians of all epochs: A 2.5 (not defined in 1); B 25." in each for each in written)
    assert any("17 of 501 epochs shown, 3 m apart or more." in each for each in written)
    assert {"large: B", "small: A", "white: not defined", "kurtosis", "5", "10", "20"} <= set(written)


PLAIN = {
    "is_success": True, "is_localized": True, "status": "localized", "x": 0.0, "reference_x": 0.0, "distance": 0.05,
}  # fmt: skip
HELMERT = PLAIN | {"peak_ratio": 0.2, "kurtosis": 9.0, "divergence": 5.0, "spread": 0.06}
COUNT = PLAIN | {"peak_ratio": 0.9, "kurtosis": 2.0, "divergence": 25.0, "spread": 2.0}
ICP = PLAIN | {"distance": 0.01}
STARTS = PLAIN | {"n_starts": 25, "n_converged": 25}


def methods(**by_method):
    return rows_of({name.replace("_", "-"): rows for name, rows in by_method.items()})


def verdicts(**by_method):
    return [claim.verdict for claim in paper_claims(methods(**by_method), 0.06)]


def test_a_study_like_the_paper_agrees():
    lost = COUNT | {"is_success": False, "distance": 2.96}
    unlucky = STARTS | {"is_success": False, "n_converged": 24}
    found = paper_claims(
        methods(
            helmert_points=[HELMERT] * 4,
            count_points=[COUNT] * 3 + [lost],
            icp_plane_1m=[ICP] * 4,
            icp_plane_1m_5x5=[STARTS] * 3 + [unlucky],
        ),
        0.06,
    )
    assert [claim.verdict for claim in found] == [Verdict.AGREES] * 8
    assert found[0].study == "4 of 4 (100.0 %) epochs within 0.3 m and 1°."
    assert "1 of 4 (25.0 %) epochs, by up to 2.96 m" in found[1].study
    assert "icp-plane-1m-5x5: fails in 1 of 4 (25.0 %)" in found[2].study
    assert "median kurtosis of Helmert's score 9, of the count 2;" in found[4].study
    assert "only neighbours in 4 of 4 (100.0 %) epochs" in found[6].study
    words = "Where both succeed (4 epochs), median error of icp-plane-1m 0.010 m, of helmert-points 0.050 m."
    assert found[7].study == words


def test_a_study_unlike_the_paper_differs():
    lost = COUNT | {"is_success": False, "distance": 1.0}
    found = verdicts(
        helmert_points=[lost, COUNT],
        count_points=[HELMERT] * 2,
        icp_plane_1m=[ICP | {"distance": 0.2}] * 2,
        icp_plane_1m_5x5=[STARTS] * 2,
    )
    assert found[:3] == [Verdict.DIFFERS] * 3
    assert found[7] is Verdict.DIFFERS


def test_epochs_that_say_nothing_are_left_out():
    """Neither a scan that cannot be read nor an epoch without a reference is a failure of a method."""
    bad = {"status": "unreadable scan", "is_success": False, "is_localized": False, "reference_x": 0.0}
    lost = {"status": "localized", "is_success": None, "is_localized": True, "x": 0.0}
    rows = {
        "helmert_points": [HELMERT, bad, lost],
        "count_points": [COUNT, bad, lost],
        "icp_plane_1m_5x5": [STARTS, bad, lost],
    }
    found = paper_claims(methods(**rows), 0.06)
    assert [claim.verdict for claim in found[:3]] == [Verdict.AGREES, Verdict.DIFFERS, Verdict.DIFFERS]
    assert found[0].study == "1 of 1 (100.0 %) epochs within 0.3 m and 1° (2 more could not be tried)."
    assert "by up to" not in found[1].study
    found = verdicts(helmert_points=[bad], count_points=[bad], icp_plane_1m_5x5=[bad])
    assert set(found) == {Verdict.NOT_STUDIED}


def test_measures_along_the_ray_are_taken_around_the_reference_where_they_can():
    around_prior = methods(helmert_points=[COUNT] * 2, count_points=[HELMERT] * 2)
    centred = methods(helmert_points=[HELMERT] * 2, count_points=[COUNT] * 2)
    found = paper_claims(around_prior, 0.06, centred)
    assert [found[k].verdict for k in (3, 4, 5)] == [Verdict.DIFFERS, Verdict.AGREES, Verdict.AGREES]
    assert found[4].study.startswith("Around the reference, ")
    assert paper_claims(around_prior, 0.06)[4].study.startswith("Around this prior, ")


def test_icp_is_compared_where_it_is_right():
    lost = ICP | {"distance": 2.0, "is_success": False}
    found = paper_claims(methods(helmert_points=[HELMERT] * 5, icp_plane_1m=[lost] * 3 + [ICP] * 2), 0.06)
    assert found[7].verdict is Verdict.AGREES
    assert "(2 epochs)" in found[7].study
