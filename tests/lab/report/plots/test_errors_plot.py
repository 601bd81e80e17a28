# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report import plot_drive, plot_errors

TIMES = 1000.0 + 0.1 * np.arange(40)
ERRORS = {"Count": np.linspace(0.0, 4.0, 40), "Helmert": np.full(40, 0.02)}
POSITIONS = np.column_stack([np.linspace(-8.0, 8.0, 40), np.zeros(40)])


def test_errors_are_drawn(tmp_path, png_size, svg_root):
    plot_errors(tmp_path / "errors.png", TIMES, ERRORS)
    assert png_size(tmp_path / "errors.png") == (1380, 588)
    plot_errors(tmp_path / "errors.svg", TIMES, ERRORS, title="<b> & $x$")
    svg_root(tmp_path / "errors.svg")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("values", [np.full(40, np.nan), np.zeros(40), np.where(np.arange(40) % 2, np.nan, 0.1)])
def test_epochs_without_an_answer_are_drawn(epoch, tmp_path, values, png_size):
    plot_errors(tmp_path / "errors.png", TIMES, {"Count": values})
    plot_drive(tmp_path / "drive.png", POSITIONS, values, point_map=epoch.point_map)
    assert png_size(tmp_path / "drive.png")[0] > 600


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_input_gives_the_same_bytes(epoch, tmp_path, suffix):
    for name in "ab":
        plot_errors(tmp_path / f"errors_{name}{suffix}", TIMES, ERRORS)
        plot_drive(tmp_path / f"drive_{name}{suffix}", POSITIONS, ERRORS["Count"], point_map=epoch.point_map)
    for kind in ("errors", "drive"):
        assert (tmp_path / f"{kind}_a{suffix}").read_bytes() == (tmp_path / f"{kind}_b{suffix}").read_bytes()


def test_a_drive_keeps_its_proportions(tmp_path, png_size):
    along_x, along_y = POSITIONS * 20.0, POSITIONS[:, ::-1] * 20.0
    plot_drive(tmp_path / "x.png", along_x, ERRORS["Helmert"])
    plot_drive(tmp_path / "y.png", np.column_stack([along_y, np.zeros(40)]), ERRORS["Helmert"])
    (x_width, x_height), (y_width, y_height) = (png_size(tmp_path / f"{name}.png") for name in "xy")
    assert x_width > x_height and y_height > y_width


def test_errors_must_fit_the_times(tmp_path):
    with pytest.raises(ArrayError, match=r"errors of 'Count' to have shape \(40,\), got \(3,\)"):
        plot_errors(tmp_path / "errors.png", TIMES, {"Count": [1.0, 2.0, 3.0]})
    with pytest.raises(ArrayError, match=r"to be 0 or more, got -1\. Use NaN where it is not defined"):
        plot_errors(tmp_path / "errors.png", [0.0], {"Count": [-1.0]})
    with pytest.raises(OptionError, match="1 to 6 methods, got 0"):
        plot_errors(tmp_path / "errors.png", TIMES, {})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("positions", [np.empty((0, 2)), np.zeros((3, 4)), np.full((3, 2), np.nan), np.zeros(3)])
def test_positions_must_be_places(tmp_path, positions):
    with pytest.raises(ArrayError, match="Expected `positions` to have shape"):
        plot_drive(tmp_path / "drive.png", positions, np.zeros(len(positions)))
    assert list(tmp_path.iterdir()) == []
