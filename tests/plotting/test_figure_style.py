import matplotlib
import numpy as np
import pytest

import maxcon
from drawn_figures import parts, yard
from maxcon.errors import FileError, OptionError
from maxcon.plotting.figure import Window, count_voxels, round_length, saved_figure


def draw(path):
    with saved_figure(path, 4.0, 3.0, "T", "words") as figure:
        figure.subplots().imshow([[0.0, 1.0]])


def test_users_own_settings_change_nothing_and_are_left_alone(tmp_path):
    draw(tmp_path / "a.png")
    with matplotlib.rc_context({"font.size": 30.0, "image.cmap": "jet", "axes.grid": True}):
        draw(tmp_path / "b.png")
        assert matplotlib.rcParams["font.size"] == 30.0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_nothing_is_left_behind_when_writing_fails(tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    def half_written(self, path, **options):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(FileError, match="Check the folder"):
        draw(tmp_path / "missing" / "a.png")
    monkeypatch.setattr(Figure, "savefig", half_written)
    with pytest.raises(FileError, match="No space left on device"):
        draw(tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_voxels_over_each_square_are_counted_and_large_windows_have_larger_squares():
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1.5], [-1.5, 2.5, 0.5], [40.0, 0.0, 0.0]])
    point_map = maxcon.PointMap.from_points(points, np.zeros_like(points), cell=1.0)
    covered, n_voxels = count_voxels(point_map, Window(-2.0, 2.0, -1.0, 3.0))
    expected = np.zeros((4, 4), int)
    expected[1, 2], expected[3, 0] = 2, 1
    np.testing.assert_array_equal(n_voxels, expected)
    assert covered == (-2.0, 2.0, -1.0, 3.0)
    _, n_voxels = count_voxels(yard().point_map, Window.around(0.0, 0.0, 500.0))
    assert max(n_voxels.shape) <= 701 and n_voxels.sum() == len(yard().point_map.all_voxels()[0])


@pytest.mark.parametrize(("length", "expected"), [(0.7, 0.5), (1.0, 1.0), (4.9, 2.0), (15.0, 10.0), (350.0, 200.0)])
def test_scale_bars_are_ofround_length(length, expected):
    assert round_length(length) == pytest.approx(expected)


def test_figures_are_returned_and_without_a_path_not_written(tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    monkeypatch.chdir(tmp_path)
    poses = maxcon.Trajectory.from_poses([0.0], [yard().prior])
    shown = [
        maxcon.plot_poses(None, poses, yard().point_map),
        maxcon.plot_drive(None, [[0.0, 0.0], [1.0, 0.0]], [0.1, 0.2]),
        maxcon.plot_epoch(None, **parts(), title="A yard"),
    ]
    assert all(isinstance(figure, Figure) for figure in shown)
    assert [len(part.axes) for part in shown[-1].subfigs] == [7, 1]  # as its docstring says: panels, and the scene
    own = Figure()
    left, right = own.subplots(1, 2)
    assert maxcon.plot_poses(None, poses, yard().point_map, title="$x", axes=left) is own
    assert maxcon.plot_drive(None, [[0.0, 0.0], [1.0, 0.0]], [0.1, 0.2], axes=right) is own
    assert [axes.get_title(loc="left") for axes in (left, right)] == ["$x", "The drive from above"]
    assert [[text.get_text() for text in axes.get_legend().get_texts()][-1] for axes in (left, right)] == [
        "poses", "not localized",
    ]  # fmt: skip
    assert left.collections and right.collections
    with pytest.raises(OptionError, match="either a path or axes, got both"):
        maxcon.plot_poses("a.png", poses, yard().point_map, axes=left)
    assert list(tmp_path.iterdir()) == []
