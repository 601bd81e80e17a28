"""Pictures of an epoch: what is drawn of it, what is said of its answer, and the scores of its cells."""

from dataclasses import replace

import numpy as np
import pytest

import maxcon
from drawn_figures import SPACE, BelowZero, parts, png_size, yard
from maxcon.errors import OptionError
from maxcon.plotting import score_panel
from maxcon.plotting.epoch import Scene, answer_words, is_off_the_ground


def draw(path, given, **changes):
    maxcon.plot_epoch(path, **(given | {"title": "A yard"} | changes))


def test_an_objective_may_be_named_and_map_and_scan_may_be_empty(tmp_path):
    draw(tmp_path / "a.png", parts())
    assert repr(parts()["accumulator"]).startswith("Accumulator(5 x ")
    draw(tmp_path / "b.png", parts(), objective="helmert")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert png_size(tmp_path / "a.png") == (1812, 1122)
    with pytest.raises(OptionError, match="helmert"):
        draw(tmp_path / "c.png", parts(), objective="highest")
    nothing = np.empty((0, 3))
    empty = maxcon.PointMap.from_points(nothing, nothing, cell=0.06)
    draw(tmp_path / "empty.png", yard()._replace(scan=maxcon.Scan(nothing), point_map=empty).conclude())
    assert png_size(tmp_path / "empty.png") == (1812, 1122)


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


@pytest.mark.parametrize("status", list(maxcon.Status))
def test_title_says_in_plain_words_what_happened(status):
    estimate = replace(parts()["estimate"], status=status)
    words = answer_words(estimate, yard().prior, yard().reference)
    assert words.startswith("Localized." if estimate.is_localized else f"NOT LOCALIZED: {status.value}.")
    assert status.explanation in words.replace("\n", " ") and len(words.splitlines()) == 2
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
    assert not is_drawn[:300].any() and is_drawn[300:].all()


def test_scores_lie_on_their_ground_and_the_axes_keep_their_limits():
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    axes = Figure().add_axes((0.0, 0.0, 1.0, 1.0), xlim=(-7.0, 9.0), ylim=(-3.0, 4.0))
    scores = np.array([[0.0, 1.0], [-np.inf, 3.0]])
    image = score_panel.draw_scores(
        axes, scores, score_panel.ground_of(maxcon.SearchSpace(1.0, 1.0), 5.0, 1.0), Normalize(0.0, 3.0)
    )
    assert image.get_extent() == [3.5, 5.5, -0.5, 1.5]  # half a cell beyond the outermost offsets
    assert image.origin == "lower"
    np.testing.assert_array_equal(image.get_array().mask, [[False, False], [True, False]])
    assert axes.get_xlim() == (-7.0, 9.0) and axes.get_ylim() == (-3.0, 4.0)


@pytest.mark.parametrize(
    ("score", "words"), [(190.34, "190.3"), (15287.4, "15,287"), (0.012344, "0.01234"), (-3.0, "−3"), (0.0, "0")]
)
def test_scores_are_written_with_four_digits(score, words):
    assert score_panel.score_words(score) == words


def test_objectives_have_names_and_a_users_own_has_its_classs():
    assert score_panel.unit_of(maxcon.Helmert()) == "1/tr Q"
    assert (score_panel.title_of(maxcon.Count()), score_panel.unit_of(maxcon.Count())) == ("Count", "matches")
    assert (score_panel.title_of(BelowZero()), score_panel.unit_of(BelowZero())) == ("BelowZero", "score")


@pytest.mark.parametrize("n_headings", [1, 9, 11, 17, 181])
def test_few_headings_are_all_drawn_and_of_many_nine_in_even_steps_with_the_best(n_headings):
    for best in range(n_headings):
        chosen = score_panel.chosen_headings(n_headings, best)
        assert len(chosen) == min(n_headings, 9) and best in chosen
        assert len(set(np.diff(chosen))) <= 1
        assert min(chosen) >= 0 and max(chosen) < n_headings


def test_colours_run_from_nothing_to_the_best_and_the_reference_is_marked_at_its_offset():
    view = score_panel.SearchSpaceView(parts()["accumulator"], maxcon.Helmert())
    assert view.limits == (0.0, view.scores[view.best])
    assert score_panel.SearchSpaceView(view.accumulator, BelowZero()).limits[0] < 0.0
    empty = score_panel.SearchSpaceView(
        maxcon.Accumulator(np.zeros((*SPACE.shape, 4)), SPACE, yard().prior), maxcon.Count()
    )
    assert empty.limits == (0.0, 1.0) and not empty.has_best
    assert view.offset(yard().reference) == pytest.approx((0.18, -0.24))
    assert view.heading_nearest(yard().reference, range(5)) == 3
    assert view.best == SPACE.nearest_cell(yard().reference, yard().prior)
