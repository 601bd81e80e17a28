# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon demo`: the table, the report, the same answers again, and what is not replaced."""

import csv
import math
import re

import pytest

from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.demo import DEMO_METHODS, DEMO_NAMES
from maxcon.lab.study.prior_trials import read_trials, summarize_trials
from maxcon.map import PointMap

TABLES = [f"poses-{method.slug}.csv" for method in DEMO_METHODS]


def _poses(folder):
    """Each table without the milliseconds."""
    tables = {}
    for name in TABLES:
        with (folder / name).open() as file:
            tables[name] = [row | {"ms": ""} for row in csv.DictReader(file)]
    return tables


@pytest.fixture(scope="module")
def demo(tmp_path_factory, run_demo):
    folder = tmp_path_factory.mktemp("demo") / "out"
    return folder, run_demo("--epochs", "4", "--out", folder)


def test_it_ends_well(demo):
    _, ended = demo
    assert ended.returncode == 0
    assert all(line.endswith(" ...") for line in ended.stderr.splitlines())


def test_the_table_has_a_row_for_each_method(demo):
    _, ended = demo
    for method in DEMO_METHODS:
        rows = [line for line in ended.stdout.splitlines() if method.name in line]
        assert len(rows) == 1
        assert re.search(r"\d of 4 .*\d\.\d{3} .*\d\.\d{3} .*\d\.\d\d .*\d+", rows[0])
    assert re.search(r"Helmert, a voxel once\D+4 of 4", ended.stdout)


def test_from_wide_priors_maximum_consensus_is_right_and_one_start_is_not(demo):
    folder, ended = demo
    trials = [trial for trial in read_trials(folder / "prior-error.csv") if trial.offset == 12.0]
    widest = {one.method: one for one in summarize_trials(trials)}
    assert (widest["maxcon"].n_right, widest["maxcon"].n_wrong_but_good) == (4, 0)
    assert sum(one.n_wrong_but_good for name, one in widest.items() if name.startswith("ICP")) > 0
    assert min(one.n_right for name, one in widest.items() if name.startswith("ICP")) < 4
    for name, one in widest.items():
        assert re.search(rf"{name} .* {one.n_right} of 4 .* {one.n_wrong_but_good} ", ended.stdout)
    told = " ".join(ended.stdout.split())
    assert "maximum consensus is right in 4 of 4 epochs; registration from one start in" in told
    assert "What searches the window first can do it too" in told


def test_everything_it_made_is_there(demo):
    folder, ended = demo
    assert sorted(path.name for path in folder.iterdir()) == sorted([*DEMO_NAMES[:-1], *TABLES])
    assert f"The report with pictures: {folder / 'report.html'}" in " ".join(ended.stdout.split("\n"))
    assert sorted(path.name for path in folder.parent.iterdir()) == ["out"]
    assert len(PointMap.open(folder / "city.map").tile_keys) > 1
    assert len(list(Dataset.open(folder / "dataset").scans.glob("*.bin"))) == 4
    assert len(read_trajectory(folder / TABLES[-1])) == 4


def test_the_report_shows_the_figures_of_the_table(demo):
    folder, ended = demo
    page = (folder / "report.html").read_text()
    assert "<title>maxcon demo: a simulated street</title>" in page
    assert "maxcon demo --epochs 4 --seed 0" in page
    assert page.count("<img") == 7
    row = next(line for line in ended.stdout.splitlines() if "Helmert, a voxel once" in line)
    assert re.findall(r"\d\.\d{3}", row)[0] in page


def test_the_first_picture_shows_where_the_count_is_wrong_and_helmert_is_not(demo):
    folder, _ = demo
    page = (folder / "report.html").read_text()
    first = page[page.index("<img") : page.index("</figure>")]
    assert "stood before a red light for 10 s" in first
    epoch = int(re.search(r"At epoch (\d+) the count", first).group(1))
    of_count, of_helmert, of_ours = map(float, re.findall(r"(\d+\.\d+) m[ ,.]", first)[:3])
    assert of_count > 0.3 > max(of_helmert, of_ours)
    with (folder / "poses-helmert-occupied.csv").open() as file:
        row = list(csv.DictReader(file))[epoch]
    truth = read_trajectory(Dataset.open(folder / "dataset").reference).at(float(row["time"]))
    assert of_ours == pytest.approx(math.hypot(float(row["x"]) - truth.x, float(row["y"]) - truth.y), abs=0.001)


def test_a_second_run_replaces_it_by_the_same_poses(demo, run_demo):
    folder, _ = demo
    before, page = _poses(folder), (folder / "report.html").stat().st_mtime_ns
    ended = run_demo("--epochs", "4", "--out", folder, "--quiet")
    assert ended.returncode == 0
    assert all(line.endswith(" ...") for line in ended.stderr.splitlines())
    assert _poses(folder) == before
    assert (folder / "report.html").stat().st_mtime_ns > page
    assert sorted(path.name for path in folder.parent.iterdir()) == ["out"]


def _assert_refused(ended, *words):
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("maxcon: Expected") and ended.stderr.count("\n") == 1
    for word in words:
        assert str(word) in ended.stderr


def test_anything_else_is_not_replaced(run_demo, tmp_path):
    (tmp_path / "pictures").mkdir()
    _assert_refused(run_demo("--out", tmp_path), tmp_path, "a demo", "no report.html")
    (tmp_path / "report.html").touch()
    (tmp_path / "thesis.tex").touch()
    _assert_refused(run_demo("--out", tmp_path), tmp_path, "a demo", "thesis.tex", "name another folder")
    _assert_refused(run_demo("--out", tmp_path / "thesis.tex"), "thesis.tex", "a demo", "Not a directory")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pictures", "report.html", "thesis.tex"]


def test_a_missing_parent_folder(run_demo, tmp_path):
    _assert_refused(run_demo("--out", tmp_path / "missing" / "demo"), tmp_path / "missing", "No such file or directory")
    assert list(tmp_path.iterdir()) == []
