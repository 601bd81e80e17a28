# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The figure of success against the prior's error."""

import re

import pytest

from maxcon.errors import OptionError
from maxcon.lab.report import plot_prior_error
from maxcon.lab.study.prior_trials import TrialSummary


def summary(method, offset, n_right=10, n_false=0, ms=123.0):
    return TrialSummary(offset, offset, method, 10, n_right, n_right + n_false, n_false, 0.1, ms, 2.0 * ms)


def summaries(names=("maxcon", "count 1 m, then GICP", "my method")):
    return [
        summary(name, offset, 10 - number, number, ms=100.0 * number + offset)
        for offset in (3.0, 12.0)
        for number, name in enumerate(names)
    ]


def words(path):
    """What is written in an SVG: each text is named in a comment before its outlines."""
    return re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"))


def test_drives_methods_levels_and_times_are_named(tmp_path):
    path = tmp_path / "figure.svg"
    plot_prior_error(path, {"one drive": summaries(), "a $second$": summaries()})
    told = " ".join(words(path))
    assert "one drive, 10 epochs" in told and "a $second$, 10 epochs" in told
    for label in ("maxcon: 12 ms", "count 1 m, then GICP: 110 ms", "my method: 210 ms"):
        assert label in told
    assert "12 m" in told and "12°" in told
    assert "median [ms]" in told and "100" in told


@pytest.mark.parametrize("n_drives", [1, 4])
def test_the_same_input_gives_the_same_bytes(tmp_path, n_drives):
    found = {f"drive {number}": summaries() for number in range(n_drives)}
    for name in ("a.png", "b.png"):
        plot_prior_error(tmp_path / name, found)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_too_many_or_none_are_refused(tmp_path):
    with pytest.raises(OptionError, match="1 to 8 methods, got 0"):
        plot_prior_error(tmp_path / "a.png", {})
    with pytest.raises(OptionError, match="1 to 8 methods, got 9"):
        plot_prior_error(tmp_path / "a.png", {"drive": summaries([str(number) for number in range(9)])})
    with pytest.raises(OptionError, match="1 to 4 drives, got 5"):
        plot_prior_error(tmp_path / "a.png", {str(number): summaries() for number in range(5)})
