"""Every command that writes is killed at odd moments: nothing half written, nothing lost that was finished.

SIGKILL cannot be caught: what a command leaves is what it had written. The moments are drawn from the time that it
takes undisturbed; on a busy machine they fall where they fall, and what is asked holds at each of them. MAXCON_KILLS=10
kills ten times as often.
"""

import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import laspy
import numpy as np
import pytest

from maxcon.lab.dataset import Dataset
from written_las import write_las

pytestmark = pytest.mark.kills

if sys.platform == "win32":
    pytest.skip("no SIGKILL", allow_module_level=True)

MORE = int(os.environ.get("MAXCON_KILLS", "1"))
FEW, SOME = MORE, 2 * MORE
"""Rounds, of one to three kills each."""
OVERWRITE = ("--overwrite",)


# --- what each command writes, and what of it is whole ---
def is_whole_map(path, maxcon):
    return maxcon("map", "info", path, "--check").code == 0


def is_whole_alignment(path, maxcon):
    files = json.loads((path / "alignment.json").read_text())["files"]
    return len(files) == 2 and all(len(laspy.read(path / name).points) > 1000 for name in files)


def is_whole_geopackage(path, maxcon):
    import pyogrio

    return pyogrio.read_info(path)["features"] == 4


def is_whole_mcap(path, maxcon):
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        return make_reader(stream).get_summary().statistics.message_count == 17


def export_to(name):
    def export(drive, folder):
        scans = ("--scans", drive.dataset.scans) if name.endswith(".laz") else ()
        return "export", folder.parent / "poses.csv", "--crs", "EPSG:25832", *scans, "-o", folder / name

    return export


class Writer(NamedTuple):
    """A command, what of it is whole, how many rounds of kills, what makes it replace what is there, its package."""

    command: Callable[..., tuple]
    is_whole: Callable[..., bool]
    n_rounds: int = SOME
    replacing: tuple[str, ...] = OVERWRITE
    package: str = "numpy"


WRITERS = {
    "map build": Writer(
        lambda drive, folder: ("map", "build", *drive.dataset.map_clouds, "-o", folder / "out.map"), is_whole_map, FEW
    ),
    "map update": Writer(
        lambda drive, folder: (
            "map", "update", drive.city, drive.dataset.scans, folder.parent / "poses.csv", "-o", folder / "out.map",
        ),
        is_whole_map, FEW,
    ),
    "map align": Writer(
        lambda drive, folder: ("map", "align", *sorted(folder.parent.glob("round-*.laz")), "-o", folder / "out"),
        is_whole_alignment, FEW,
    ),
    "map copy": Writer(lambda drive, folder: ("map", "copy", drive.city, folder / "out.map"), is_whole_map),
    "simulate": Writer(
        lambda drive, folder: ("simulate", "--epochs", "2", folder / "out"),
        lambda path, maxcon: len(list(Dataset.open(path).scans.glob("*.bin"))) == 2, FEW,
    ),
    "export gpkg": Writer(export_to("out.gpkg"), is_whole_geopackage, package="pyogrio"),
    "export mcap": Writer(export_to("out.mcap"), is_whole_mcap, package="mcap"),
    "export laz": Writer(
        export_to("out.laz"), lambda path, maxcon: len(np.unique(laspy.read(path).point_source_id)) == 4
    ),
    "report": Writer(
        lambda drive, folder: ("report", folder.parent / "small.study", "-o", folder / "out.html"),
        lambda path, maxcon: path.read_text().rstrip().endswith("</html>"), replacing=(),
    ),
}  # fmt: skip


# --- inputs, and how to kill ---
@pytest.fixture(scope="module")
def folder_of_kills(tmp_path_factory, drive, maxcon_in_process_of_its_own):
    """Poses and a study of the drive, made undisturbed; and two rounds to align."""
    folder = tmp_path_factory.mktemp("kills")
    poses = (*drive.localize, folder / "poses.csv")
    study = ("study", drive.dataset.folder, "-o", folder / "small.study", "--methods", "helmert-occupied")
    for arguments in (poses, (*study, "--epochs", "3", "--workers", "1")):
        made = maxcon_in_process_of_its_own(*arguments)
        assert made.code == 0, made.err
    for number in range(2):
        _write_round(folder / f"round-{number}.laz", number)
    return folder


def _write_round(path, number):
    """Points of a floor and two walls, 5 cm further east each round."""
    rng = np.random.default_rng(number)
    one, other = rng.uniform(0.0, 22.0, (2, 30_000))
    zero, up = np.zeros(10_000), other[10_000:20_000] / 5.0
    floor = np.column_stack([one[:10_000], other[:10_000], zero])
    along = np.column_stack([one[10_000:20_000], zero + 18.0, up])
    across = np.column_stack([zero + 18.0, one[20_000:], other[20_000:] / 5.0])
    points = rng.permutation(np.concatenate([floor, along, across]))
    points += rng.normal(0.0, 0.01, points.shape) + [550_000.0 + 0.05 * number, 5_802_000.0, 0.0]
    write_las(path, points, classes=0, times=1000.0 * number + np.linspace(0.0, 8.0, len(points)))


@pytest.fixture
def killed(maxcon_process):
    """Start a command and kill it after so many seconds; return whether it was still at work."""

    def run(arguments, seconds, **options):
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with maxcon_process(*arguments, **quiet, **options) as process:
            try:
                process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                process.kill()
                return True
        assert process.returncode == 0
        return False

    return run


@pytest.fixture
def timed(maxcon_in_process_of_its_own):
    """Run a command to its end; return how long it took, s."""

    def run(*arguments, **options):
        began = time.monotonic()
        ended = maxcon_in_process_of_its_own(*arguments, **options)
        assert ended.code == 0, ended.err
        return time.monotonic() - began

    return run


# --- commands that write a file or a folder ---
@pytest.mark.parametrize("name", WRITERS)
def test_what_a_killed_command_leaves_is_whole_or_not_there(name, drive, folder_of_kills, maxcon, timed, killed):
    command, is_whole, n_rounds, replacing, package = WRITERS[name]
    pytest.importorskip(package)
    folder = folder_of_kills / name.replace(" ", "-")
    folder.mkdir()
    arguments = command(drive, folder)
    out, rng = arguments[-1], random.Random(name)
    seconds = timed(*arguments)
    assert is_whole(out, maxcon)
    aside = folder / "aside"
    for _ in range(n_rounds):
        out.rename(aside)
        killed(arguments, rng.uniform(0.2, 1.0) * seconds)
        assert not out.exists() or is_whole(out, maxcon)
        if not out.exists():
            aside.rename(out)
        else:
            _remove(aside)
        killed((*arguments, *replacing), rng.uniform(0.2, 1.0) * seconds)
        assert is_whole(out, maxcon)
    timed(*arguments, *replacing)
    assert is_whole(out, maxcon)
    # A report's figures lie in a folder beside it.
    assert {path.name for path in folder.iterdir()} - {"out-figures"} == {out.name}
    assert not list(folder.rglob(".*partial*"))


def _remove(path):
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def test_a_killed_copy_to_a_bucket_leaves_no_map_there_and_is_gone_on_with(drive, bucket, maxcon, timed, killed):
    rng = random.Random("bucket")
    seconds = timed("map", "copy", drive.city, f"{bucket}/whole")
    for number in range(SOME):
        arguments = ("map", "copy", drive.city, f"{bucket}/{number}")
        killed(arguments, rng.uniform(0.6, 1.0) * seconds)
        is_there = is_whole_map(arguments[-1], maxcon)
        assert is_there or "no manifest.json there" in maxcon("map", "info", arguments[-1]).err
        timed(*arguments, *(OVERWRITE if is_there else ()))
        assert is_whole_map(arguments[-1], maxcon)
        killed((*arguments, *OVERWRITE), rng.uniform(0.6, 1.0) * seconds)
        assert is_whole_map(arguments[-1], maxcon)
