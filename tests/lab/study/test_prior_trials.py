# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Trials of wrong priors: their file, their summary by hand, and the benchmark's table and folder."""

import importlib
from pathlib import Path

import pytest

from maxcon.errors import FileError, OptionError
from maxcon.lab.study.prior_trials import PriorTrial, read_trials, summarize_trials, write_trials

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


def trial(method, epoch=0, offset=12.0, *, good=True, right=True, distance=0.1, ms=10.0):
    status = "localized" if good else "at the rim"
    return PriorTrial(offset, 10.0, epoch, method, status, good, right, distance, -0.1, ms)


TRIALS = [
    trial("b", 0, ms=10.0),
    trial("b", 1, right=False, distance=5.0, ms=20.0),
    trial("b", 2, good=False, distance=0.2, ms=40.0),
    trial("a", 0, good=False, right=False, distance=3.0, ms=1.0),
    trial("b", 0, 3.0, distance=0.05, ms=7.0),
]


def test_summaries_by_hand():
    found = summarize_trials(TRIALS)
    assert [(one.offset, one.method) for one in found] == [(3.0, "b"), (12.0, "b"), (12.0, "a")]
    small, wide, none = found
    assert (small.n_epochs, small.n_right, small.n_good, small.n_wrong_but_good) == (1, 1, 1, 0)
    assert (wide.n_epochs, wide.n_right, wide.n_good, wide.n_wrong_but_good) == (3, 2, 2, 1)
    assert (wide.median_error, wide.median_ms, wide.p95_ms) == (pytest.approx(0.15), 20.0, pytest.approx(38.0))
    assert (none.n_right, none.n_wrong_but_good) == (0, 0)
    assert none.median_error != none.median_error
    assert summarize_trials([]) == []


def test_trials_come_back_from_their_file(tmp_path):
    path = tmp_path / "drive.csv"
    assert read_trials(path) == []
    write_trials(path, TRIALS)
    assert read_trials(path) == TRIALS
    assert [file.name for file in tmp_path.iterdir()] == ["drive.csv"]
    assert len({one.key for one in TRIALS}) == len(TRIALS)


def test_another_file_is_refused(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("epoch,method\n1,a\n")
    with pytest.raises(FileError, match="trials of an earlier run"):
        read_trials(path)


@pytest.fixture
def benchmark_module(monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("prior_error")


def test_the_table_has_a_row_per_level_and_method(benchmark_module):
    lines = benchmark_module.table(summarize_trials(TRIALS))
    assert lines[2:] == [
        "| 3 m, 10° | b | **1 of 1** | 1 | 0 | 7 | 7 | 5.0 |",
        "| 12 m, 10° | b | 2 of 3 | 2 | 1 | 20 | 38 | 15.0 |",
        "|  | a | 0 of 1 | 0 | 0 | 1 | 1 | – |",
    ]
    assert len({line.count("|") for line in lines}) == 1


def test_a_folder_of_other_trials_is_refused(benchmark_module, tmp_path):
    level = benchmark_module.parse_level
    settings = benchmark_module.settings_of([level("1:1")], 0)
    benchmark_module.check_same(tmp_path, settings)
    benchmark_module.check_same(tmp_path, settings)
    benchmark_module.check_same(tmp_path, benchmark_module.settings_of([level("12:10")], 0))
    with pytest.raises(OptionError, match="same methods and seed"):
        benchmark_module.check_same(tmp_path, benchmark_module.settings_of([level("1:1")], 1))
