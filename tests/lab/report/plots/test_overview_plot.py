# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
from dataclasses import replace

import numpy as np
import pytest

import maxcon
from maxcon.errors import FileError, OptionError
from maxcon.lab.report.plots.overview_plot import _draw_scan, _draw_space, _words, plot_overview
from maxcon.plotting.scene import Scene
from maxcon.plotting.score_panel import SearchSpaceView


def parts_of(epoch, space):
    """What `plot_overview` takes, without title and other epochs."""
    given = {"prior": epoch.prior, "scan": epoch.scan, "point_map": epoch.point_map}
    return epoch.conclude(space) | given


@pytest.fixture(scope="module")
def parts(epoch, space):
    return parts_of(epoch, space)


@pytest.fixture(scope="module")
def other(epoch, space):
    """The same scan with the prior 2 m farther west: nothing is near enough to be found."""
    lost = epoch._replace(prior=epoch.prior.translated([-2.0, 0.0, 0.0])).conclude(space)
    return lost["accumulator"], lost["estimate"]


@pytest.fixture
def panel():
    from matplotlib.figure import Figure

    return Figure().add_axes((0.0, 0.0, 1.0, 1.0))


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_overview_gives_the_same_bytes(parts, other, tmp_path, suffix):
    files = [tmp_path / f"{name}{suffix}" for name in "ab"]
    for file in files:
        plot_overview(file, **parts, others=[other], title="A yard & <more>")
    assert files[0].read_bytes() == files[1].read_bytes()


def test_other_epochs_are_drawn_where_they_are_apart(parts, other, tmp_path):
    files = {name: tmp_path / f"{name}.png" for name in ("alone", "beside", "itself")}
    plot_overview(files["alone"], **parts, title="A yard")
    plot_overview(files["beside"], **parts, others=[other], title="A yard")
    plot_overview(files["itself"], **parts, others=[(parts["accumulator"], parts["estimate"])], title="A yard")
    assert files["alone"].read_bytes() == files["itself"].read_bytes()
    assert files["alone"].read_bytes() != files["beside"].read_bytes()


def test_width_is_fixed_and_height_follows_the_drive(parts, other, tmp_path, png_size):
    plot_overview(tmp_path / "flat.png", **parts, title="A yard")
    accumulator, estimate = other
    north = replace(accumulator, prior=parts["prior"].translated([0.0, 6.5, 0.0]))
    plot_overview(tmp_path / "high.png", **parts, others=[(north, estimate)], title="A yard")
    # 8.2 inches of map, 0.7 times as high or as high as wide, and 3 inches around.
    assert png_size(tmp_path / "flat.png") == (1104, pytest.approx(120 * (0.7 * 8.2 + 3.0), abs=1))
    # The window is 7.5 m to either side; to the north it ends 1.5 reaches of 0.6 m behind the other prior.
    expected = 120 * (8.2 * (6.5 + 0.9) / 7.5 + 3.0)
    assert png_size(tmp_path / "high.png") == (1104, pytest.approx(expected, abs=1))


def test_best_cell_is_marked_on_the_ground(parts, panel):
    view = SearchSpaceView(parts["accumulator"], parts["objective"])
    _draw_space(panel, view, is_localized=True, is_this=True)
    _draw_space(panel, view, is_localized=False, is_this=False)
    pose = parts["estimate"].pose
    for line, marker in zip(panel.lines, "ox", strict=True):
        np.testing.assert_allclose(line.get_xydata()[0], [pose.x, pose.y], atol=1e-3)  # refined
        assert line.get_marker() == marker
    # Twenty cells of 6 cm around (-0.18, 0.24).
    assert panel.images[0].get_extent() == pytest.approx([-0.81, 0.39, -0.39, 0.81])
    assert panel.images[0].get_array().max() == parts["estimate"].score


def test_cells_too_small_for_the_picture_are_drawn_as_blocks(epoch, panel):
    space = maxcon.SearchSpace(half_width=1.53, cell=0.03, heading_half_width_deg=0.0)
    moments = np.zeros((*space.shape, 4))
    moments[0, 101, 33, 0] = 5.0
    view = SearchSpaceView(maxcon.Accumulator(moments, space, epoch.prior), maxcon.Count())
    _draw_space(panel, view, is_localized=True, is_this=True)
    # 102 cells in blocks of three.
    blocks = panel.images[0].get_array()
    assert blocks.shape == (34, 34)
    assert np.argwhere(blocks).tolist() == [[33, 11]]
    west, east, _, _ = panel.images[0].get_extent()
    assert east - west == pytest.approx(102 * 0.03)


def test_consensus_set_is_drawn_at_the_answer(parts, space, panel):
    def drawn(estimate):
        scene = Scene(parts["scan"], parts["point_map"], parts["prior"], space, estimate)
        return [handle.get_label() for handle in _draw_scan(panel, scene)]

    matched = int(parts["accumulator"].moments[parts["estimate"].cell][0])
    assert drawn(parts["estimate"])[1:] == ["scan at the prior", f"consensus set ({matched:,} points)"]
    assert len(panel.lines[1].get_xydata()) == matched
    assert np.abs(np.abs(panel.lines[1].get_xydata()).max(axis=0) - [9.03, 5.03]).max() < 0.06
    assert drawn(replace(parts["estimate"], status=maxcon.Status.NO_MATCH))[1:] == ["scan at the prior"]
    at_the_pose = drawn(replace(parts["estimate"], cell=None))[2]  # of an open space: where the answer lies
    assert int(at_the_pose.split("(")[1].split()[0]) == pytest.approx(matched, rel=0.01)


@pytest.mark.parametrize("status", list(maxcon.Status))
def test_words_say_how_the_epoch_ended(parts, status):
    words = _words(replace(parts["estimate"], status=status), parts["objective"], parts["accumulator"]).replace(
        "\n", " "
    )
    assert "1.2 m × 1.2 m, at the best heading; colours: Helmert's score." in words
    ending = "localized" if status is maxcon.Status.LOCALIZED else f"NOT LOCALIZED: {status.value}"
    assert f"This epoch is {ending}." in words


def test_overview_of_nothing_can_be_drawn(epoch, space, tmp_path, png_size):
    nothing = np.empty((0, 3))
    point_map = maxcon.PointMap.from_points(nothing, nothing, cell=0.06)
    empty = epoch._replace(scan=maxcon.Scan(nothing), point_map=point_map)
    plot_overview(tmp_path / "empty.png", **parts_of(empty, space), title="Nothing")
    assert png_size(tmp_path / "empty.png")[0] == 1104


def test_a_prior_of_another_epoch_is_refused(parts, tmp_path):
    wrong = parts | {"prior": parts["prior"].translated([1.0, 0.0, 0.0])}
    with pytest.raises(OptionError, match=r"searched around, x -0\.180, y 0\.240 m, got x 0\.820, y 0\.240 m"):
        plot_overview(tmp_path / "a.png", **wrong, title="A yard")
    assert list(tmp_path.iterdir()) == []


def test_overview_in_other_kinds_of_files_or_nowhere_is_refused(parts, tmp_path):
    with pytest.raises(OptionError, match=r"to end in \.png or \.svg"):
        plot_overview(tmp_path / "a.jpg", **parts, title="A yard")
    with pytest.raises(FileError, match="Check the folder"):
        plot_overview(tmp_path / "missing" / "a.png", **parts, title="A yard")
    assert list(tmp_path.iterdir()) == []


def test_legend_names_only_the_marks_that_are_drawn(epoch, parts, space, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    drawn = []
    save = Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *args, **options: (drawn.append(self), save(self, *args, **options))
    )
    lost = epoch._replace(prior=maxcon.Pose(0.0, 0.0, 500.0, 0.0, 0.0, 0.0))
    plot_overview(tmp_path / "lost.png", **parts_of(lost, space), title="Lost")
    moved = replace(parts["accumulator"], prior=epoch.prior.translated([-2.0, 0.0, 0.0]))
    unsure = [(moved, replace(parts["estimate"], status=maxcon.Status.AT_RIM))]
    plot_overview(tmp_path / "both.png", **parts, others=unsure, title="Both")
    names = [[text.get_text() for text in figure.legends[0].get_texts()] for figure in drawn]
    always = ["map (darker: taller)", "scan at the prior"]
    assert names[0] == [*always, "search space of this epoch"]
    assert names[1][3:] == [
        "search space of this epoch",
        "search spaces of other epochs",
        "best cell",
        "best cell, not localized",
    ]
