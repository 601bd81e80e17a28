"""`maxcon demo`: the table, the report, the same answers again, and what is not replaced."""

import os
import re
import subprocess
import sys

import pyarrow.csv
import pytest

from maxcon.errors import FileError
from maxcon.lab.dataset import Dataset
from maxcon.lab.demo import ANSWERS, DEMO_METHODS, DEMO_NAMES, DemoResults, worst_of_the_count
from maxcon.lab.study.table import MethodRows, table_schema
from maxcon.map import PointMap
from study_tables import study_table
from written_maps import run


def _answers(folder):
    """The table of answers."""
    types = pyarrow.csv.ConvertOptions(column_types=table_schema(), strings_can_be_null=True)
    return pyarrow.csv.read_csv(folder / ANSWERS, convert_options=types)


def run_demo(*arguments):
    """Run `maxcon demo` in a process of its own."""
    command = [sys.executable, "-m", "maxcon", "demo", "--epochs", "4", *map(str, arguments)]
    environment = {**os.environ, "COLUMNS": "120"}
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=900)
    assert ended.returncode == 0, ended.stderr
    assert all(line.endswith(" ...") for line in ended.stderr.splitlines())
    return ended.stdout


@pytest.fixture(scope="module")
def demo(built_once):
    """The folder of a demo, and what the command printed."""

    def make(folder):
        printed = run_demo("--out", folder / "out")
        assert [path.name for path in folder.iterdir()] == ["out"]
        (folder / "printed.txt").write_text(printed)

    folder = built_once("demo", make)
    return folder / "out", (folder / "printed.txt").read_text()


@pytest.mark.documents
def test_the_table_the_files_and_the_figures_of_the_report_are_there(demo):
    folder, printed = demo
    for method in DEMO_METHODS:
        rows = [line for line in printed.splitlines() if method in line]
        assert len(rows) == 1
        assert re.search(r"\d of 4 .*\d\.\d{3} .*\d\.\d{3} .*\d\.\d\d .*\d+", rows[0])
    assert re.search(r"Helmert, a voxel once\D+4 of 4", printed)
    assert sorted(path.name for path in folder.iterdir()) == sorted(DEMO_NAMES)
    assert f"The report with pictures: {folder / 'report.html'}" in " ".join(printed.split("\n"))
    assert len(PointMap.open(folder / "city.map").tile_keys) > 1
    assert len(list(Dataset.open(folder / "dataset").scans.glob("*.bin"))) == 4
    page = (folder / "report.html").read_text()
    assert "<title>maxcon demo: a simulated street</title>" in page
    assert "maxcon demo --epochs 4 --seed 0" in page and page.count("<img") == 6
    row = next(line for line in printed.splitlines() if "Helmert, a voxel once" in line)
    assert re.findall(r"\d\.\d{3}", row)[0] in page


@pytest.mark.documents
def test_maximum_consensus_is_right_where_one_start_and_the_count_are_not(demo):
    folder, printed = demo
    widest = {one.method: one for one in DemoResults.of(_answers(folder)).widest}
    assert (widest["maxcon"].n_success, widest["maxcon"].n_false) == (4, 0)
    assert sum(one.n_false for name, one in widest.items() if name.startswith("ICP")) > 0
    assert min(one.n_success for name, one in widest.items() if name.startswith("ICP")) < 4
    for name, one in widest.items():
        assert re.search(rf"{name} .* {one.n_success} of 4 .* {one.n_false} ", printed)
    told = " ".join(printed.split())
    assert "maximum consensus is right in 4 of 4 epochs; registration from one start in" in told
    assert "What searches the window first can do it too" in told
    page = (folder / "report.html").read_text()
    first = page[page.index("<img") : page.index("</figure>")]
    assert "stood before a red light for 10 s" in first
    epoch = int(re.search(r"At epoch (\d+) the count", first).group(1))
    of_count, of_helmert, of_ours = map(float, re.findall(r"(\d+\.\d+) m[ ,.]", first)[:3])
    assert of_count > 0.3 > max(of_helmert, of_ours)
    near = DemoResults.of(_answers(folder)).near[-1]
    assert of_ours == pytest.approx(near.numbers("distance")[epoch], abs=0.001)


@pytest.mark.documents
def test_a_second_run_replaces_it_by_the_same_poses(demo):
    folder, _ = demo
    before, page = _answers(folder).drop_columns("ms"), (folder / "report.html").stat().st_mtime_ns
    run_demo("--out", folder, "--quiet")
    assert _answers(folder).drop_columns("ms").equals(before)
    assert (folder / "report.html").stat().st_mtime_ns > page
    assert sorted(path.name for path in folder.parent.iterdir()) == ["out", "printed.txt"]


@pytest.mark.parametrize(("out", "words"), [
    ("part", ("a demo", "no report.html")),
    ("old", ("a demo", "thesis.tex", "name another folder")),
    ("old/thesis.tex", ("thesis.tex", "Not a directory")),
    ("missing/demo", ("missing", "No such file or directory")),
])  # fmt: skip
def test_anything_else_is_not_replaced(out, words, tmp_path):
    (tmp_path / "part" / "pictures").mkdir(parents=True)
    (tmp_path / "old").mkdir()
    for name in ("report.html", "thesis.tex"):
        (tmp_path / "old" / name).touch()
    with pytest.raises(FileError, match=r"^Expected") as refused:
        run("demo", "--out", tmp_path / out)
    assert all(word in str(refused.value) for word in words)
    left = ["old", "part", "pictures", "report.html", "thesis.tex"]
    assert sorted(path.name for path in tmp_path.rglob("*")) == left


def rows(distances):
    known = [
        {"epoch": number, "distance": far, "is_success": far is not None and far < 0.3}
        for number, far in enumerate(distances)
    ]
    return MethodRows("", "", study_table(known))


@pytest.mark.parametrize(("of_count", "of_helmert", "expected"), [
    ([0.1, 2.0, 3.0, None], [0.1, 0.1, 3.0, 0.1], 1),  # the worst that Helmert's score gets right
    ([0.1, 0.2, None], [0.1, 0.1, 0.1], 1),  # none is wrong
])  # fmt: skip
def test_the_epoch_shown_first_is_the_worst_of_the_count(of_count, of_helmert, expected):
    assert worst_of_the_count(rows(of_count), rows(of_helmert)) == expected
