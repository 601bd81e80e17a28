# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Every command that writes is killed at odd moments: nothing half written, nothing lost that was finished.

SIGKILL cannot be caught: what a command leaves is what it had written. The moments are drawn from the time that it
takes undisturbed; on a busy machine they fall where they fall, and what is asked holds at each of them.
"""

import csv
import json
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from maxcon.dataset import Dataset
from maxcon.study import Study

if sys.platform == "win32":
    pytest.skip("no SIGKILL", allow_module_level=True)

N_KILLS = 2


def is_whole_map(path, maxcon):
    return maxcon("map", "info", path, "--check").code == 0


def is_whole_dataset(path, maxcon):
    return len(list(Dataset.open(path).scans.glob("*.bin"))) == 2


def is_whole_geojson(path, maxcon):
    return len(json.loads(path.read_text())["features"]) == 4


def is_whole_page(path, maxcon):
    return path.read_text().rstrip().endswith("</html>")


def map_build(drive, folder):
    return "map", "build", *drive.dataset.map_clouds, "-o", folder / "out.map"


def simulate(drive, folder):
    return "simulate", "--epochs", "2", folder / "out"


def export(drive, folder):
    return "export", folder.parent / "poses.csv", "--crs", "EPSG:25832", "-o", folder / "out.geojson"


def report(drive, folder):
    return "report", folder.parent / "small.study", "-o", folder / "out.html"


class Writer(NamedTuple):
    """A command, what makes it replace what is there, and what is whole."""

    command: Callable[..., tuple]
    replacing: tuple[str, ...]
    is_whole: Callable[..., bool]


WRITERS = {
    "map build": Writer(map_build, ("--overwrite",), is_whole_map),
    "simulate": Writer(simulate, ("--overwrite",), is_whole_dataset),
    "export": Writer(export, ("--overwrite",), is_whole_geojson),
    "report": Writer(report, (), is_whole_page),
}


class Written(NamedTuple):
    """A folder with the poses and a study of a drive, and how long each took undisturbed, s."""

    folder: Path
    seconds_of_drive: float
    seconds_of_study: float


@pytest.fixture(scope="module")
def written(tmp_path_factory, drive, maxcon_in_process_of_its_own):
    """Poses and a study of the drive, made undisturbed."""
    folder = tmp_path_factory.mktemp("kills")
    run = maxcon_in_process_of_its_own
    dataset = drive.dataset
    began = time.monotonic()
    made = run(*localize(drive, folder / "poses.csv"))
    assert made.code == 0, made.err
    between = time.monotonic()
    made = run(*study(dataset, folder / "small.study"))
    assert made.code == 0, made.err
    return Written(folder, between - began, time.monotonic() - between)


def localize(drive, out):
    return "localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", out


def study(dataset, out):
    return (
        "study",
        dataset.folder,
        "-o",
        out,
        "--methods",
        "helmert-occupied",
        "--epochs",
        "3",
        "--workers",
        "1",
    )


@pytest.fixture
def killed(maxcon_process):
    """Start a command and kill it after so many seconds; return whether it was still at work."""

    def run(arguments, seconds):
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with maxcon_process(*arguments, **quiet) as process:
            try:
                process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                process.kill()
                return True
        assert process.returncode == 0
        return False

    return run


@pytest.mark.parametrize("name", WRITERS)
def test_what_a_killed_command_leaves_is_whole_or_not_there(
    name, drive, written, maxcon, maxcon_in_process_of_its_own, killed
):
    command, replacing, is_whole = WRITERS[name]
    folder = written.folder / name.replace(" ", "-")
    folder.mkdir()
    arguments = command(drive, folder)
    out, rng = arguments[-1], random.Random(name)
    began = time.monotonic()
    assert maxcon_in_process_of_its_own(*arguments).code == 0
    seconds = time.monotonic() - began
    assert is_whole(out, maxcon)
    aside = folder / "aside"
    for _ in range(N_KILLS):
        out.rename(aside)
        killed(arguments, rng.uniform(0.2, 1.0) * seconds)
        assert not out.exists() or is_whole(out, maxcon)
        if not out.exists():
            aside.rename(out)
        else:
            _remove(aside)
        killed((*arguments, *replacing), rng.uniform(0.2, 1.0) * seconds)
        assert is_whole(out, maxcon)
    assert maxcon_in_process_of_its_own(*arguments, *replacing).code == 0
    assert is_whole(out, maxcon)
    # A report's figures lie in a folder beside it.
    assert {path.name for path in folder.iterdir()} - {"out-figures"} == {out.name}


def _remove(path):
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def test_rows_of_a_killed_drive_stay_and_are_gone_on_with(
    drive, written, maxcon_in_process_of_its_own, killed
):
    whole = _rows(written.folder / "poses.csv")
    folder = written.folder / "localize"
    folder.mkdir()
    out, rng, seconds = folder / "poses.csv", random.Random("localize"), written.seconds_of_drive
    for _ in range(N_KILLS):
        out.unlink(missing_ok=True)
        resume = ()
        kept = []
        for _ in range(2):
            killed((*localize(drive, out), *resume), rng.uniform(0.5, 1.0) * seconds)
            if out.exists():
                rows = _rows(out)
                assert rows[: len(kept)] == kept  # nothing that was finished is lost
                assert rows == whole[: len(rows)]
                kept, resume = rows, ("--resume",)
        assert maxcon_in_process_of_its_own(*localize(drive, out), *resume).code == 0
        assert _rows(out) == whole
    assert [path.name for path in folder.iterdir()] == ["poses.csv"]


def _rows(path):
    """Rows that are complete, without milliseconds."""
    text = path.read_text()
    complete = text[: text.rfind("\n") + 1].splitlines()
    return [{**row, "ms": ""} for row in csv.DictReader(complete)]


def test_rows_of_a_killed_study_stay_and_are_gone_on_with(
    drive, written, maxcon_in_process_of_its_own, killed
):
    def rows(folder):
        table = Study.open(folder).table
        return sorted(map(str, table.drop_columns(["ms"]).to_pylist()))

    whole = rows(written.folder / "small.study")
    folder = written.folder / "study"
    folder.mkdir()
    rng, seconds = random.Random("study"), written.seconds_of_study
    for number in range(N_KILLS):
        out = folder / f"{number}.study"
        killed(study(drive.dataset, out), rng.uniform(0.4, 1.0) * seconds)
        kept = rows(out) if (out / "table.parquet").exists() else []
        assert set(kept) <= set(whole)
        assert maxcon_in_process_of_its_own(*study(drive.dataset, out)).code == 0
        assert rows(out) == whole
