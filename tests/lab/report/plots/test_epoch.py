# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import sys
from dataclasses import replace

import numpy as np
import pytest

import maxcon
from maxcon.errors import FileError, MissingExtraError, OptionError
from maxcon.lab.report import plot_epoch
from maxcon.plotting.epoch import _answer_words, _panel_places
from maxcon.plotting.scene import Scene, is_off_the_ground


def draw(path, epoch, space, **changes):
    parts = epoch.conclude(space) | {"scan": epoch.scan, "point_map": epoch.point_map, "title": "A yard"}
    plot_epoch(path, **(parts | changes))


@pytest.mark.parametrize("n_headings", [1, 61])
def test_any_number_of_headings_is_drawn(epoch, tmp_path, n_headings, png_size):
    space = maxcon.SearchSpace(0.3, 0.06, 0.25 * (n_headings - 1), 0.5)
    assert space.shape[0] == n_headings
    draw(tmp_path / "epoch.png", epoch, space, reference=epoch.reference)
    assert png_size(tmp_path / "epoch.png") == (1812, 1122)


def test_svg_can_be_read_and_is_the_same_each_time(epoch, space, tmp_path, svg_root):
    for name in ("a.svg", "b.svg"):
        draw(tmp_path / name, epoch, space, title="<script> & $x^2$", reference=epoch.reference)
    assert svg_root(tmp_path / "a.svg").find(".//{http://www.w3.org/2000/svg}image") is not None
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_an_objective_may_be_named(epoch, space, tmp_path):
    draw(tmp_path / "a.png", epoch, space, objective=maxcon.Helmert())
    draw(tmp_path / "b.png", epoch, space, objective="helmert")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with pytest.raises(OptionError, match="helmert"):
        draw(tmp_path / "c.png", epoch, space, objective="highest")


def test_users_own_settings_change_nothing_and_are_left_alone(epoch, space, tmp_path):
    import matplotlib

    draw(tmp_path / "a.png", epoch, space)
    with matplotlib.rc_context({"font.size": 30.0, "image.cmap": "jet", "axes.grid": True}):
        draw(tmp_path / "b.png", epoch, space)
        assert matplotlib.rcParams["font.size"] == 30.0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_nothing_matched_is_drawn_at_the_prior(epoch, space, tmp_path):
    lost = epoch._replace(prior=maxcon.Pose(0.0, 0.0, 500.0, 0.0, 0.0, 0.0))
    parts = lost.conclude(space)
    assert parts["estimate"].status is maxcon.Status.NO_MATCH
    draw(tmp_path / "lost.png", lost, space)
    assert not Scene(lost.scan, lost.point_map, lost.prior, space, parts["estimate"]).has_answer


def test_map_and_scan_may_be_empty(epoch, space, tmp_path, png_size):
    nothing = np.empty((0, 3))
    empty = epoch._replace(
        scan=maxcon.Scan(nothing), point_map=maxcon.PointMap.from_points(nothing, nothing, cell=0.06)
    )
    draw(tmp_path / "empty.png", empty, space)
    assert png_size(tmp_path / "empty.png")[0] > 0


@pytest.mark.parametrize("status", list(maxcon.Status))
def test_title_says_in_plain_words_what_happened(epoch, space, status):
    estimate = replace(epoch.conclude(space)["estimate"], status=status)
    words = _answer_words(estimate, epoch.prior, epoch.reference)
    assert words.startswith("Localized." if estimate.is_localized else f"NOT LOCALIZED: {status.value}.")
    assert status.explanation in words.replace("\n", " ")
    assert len(words.splitlines()) == 2
    if status is not maxcon.Status.NO_MATCH:
        assert "+0.18 m in x, −0.24 m in y, +0.50° from the prior" in words
        assert "0.00 m and 0.00° from the reference" in words


def test_a_scan_without_normals_is_drawn_and_its_title_says_so(epoch, space, tmp_path):
    bare = epoch._replace(scan=maxcon.Scan(epoch.scan.points, np.zeros_like(epoch.scan.points)))
    parts = bare.conclude(space)
    assert Scene(bare.scan, bare.point_map, bare.prior, space, parts["estimate"]).is_drawn.all()
    draw(tmp_path / "bare.png", bare, space)
    draw(tmp_path / "whole.png", epoch, space)
    assert (tmp_path / "bare.png").read_bytes() != (tmp_path / "whole.png").read_bytes()
    words = _answer_words(parts["estimate"], bare.prior, bare.reference)
    assert "Normals on 0 % of the points, none horizontal" in words


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
    assert not is_drawn[:300].any()
    assert is_drawn[300:].all()


@pytest.mark.parametrize("n_panels", range(1, 10))
def test_panels_do_not_overlap_and_stay_inside(n_panels):
    places = _panel_places(n_panels)
    assert len(places) == n_panels
    for number, (left, bottom, side) in enumerate(places):
        assert left >= 0.85 - 1e-9 and left + side <= 0.85 + 6.5 + 1e-9
        assert bottom >= 1.25 - 1e-9 and bottom + side <= 1.25 + 6.5 + 1e-9
        for other_left, other_bottom, _ in places[:number]:
            assert abs(left - other_left) > side or abs(bottom - other_bottom) > side


def test_consensus_set_is_what_the_best_cell_counted(epoch, space):
    parts = epoch.conclude(space)
    estimate = parts["estimate"]
    scene = Scene(epoch.scan, epoch.point_map, epoch.prior, space, estimate)
    assert scene.is_matched.sum() == parts["accumulator"].moments[estimate.cell][0] > 900
    assert scene.is_drawn.all()


def test_other_kinds_of_files_are_refused(epoch, space, tmp_path):
    with pytest.raises(OptionError, match=r"to end in \.png or \.svg, got .*epoch\.jpg"):
        draw(tmp_path / "epoch.jpg", epoch, space)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_named(epoch, space, tmp_path):
    with pytest.raises(FileError, match="Check the folder"):
        draw(tmp_path / "missing" / "epoch.png", epoch, space)


def test_nothing_is_left_behind_when_writing_fails(epoch, space, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    def half_written(self, path, **options):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", half_written)
    with pytest.raises(FileError, match="No space left on device"):
        draw(tmp_path / "epoch.png", epoch, space)
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib_the_extra_is_named(epoch, space, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[demo\]'"):
        draw(tmp_path / "epoch.png", epoch, space)
