# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize` by several workers and of many drives: the rows of single calls, in one dataset that goes on."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from threading import Thread

import pyarrow
import pyarrow.dataset
import pytest

from maxcon.drive.poses_dataset import PosesDataset
from maxcon.map.manifest import read_manifest, write_manifest

pytest.importorskip("distributed")

NARROW = ("--half-width", "1.2", "--heading-half-width-deg", "1", "--cell", "0.06")
N_EPOCHS = 40


def read_csv(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def without_times(rows):
    return [{name: cell for name, cell in row.items() if name != "ms"} for row in rows]


def as_csv(row):
    """The cells of POSES.csv for a row of the dataset."""
    digits = {"time": ".9f", "x": ".4f", "y": ".4f", "z": ".4f", "score": ".6g", "ms": ".2f",
              "protection_along": ".4f", "protection_across": ".4f"}  # fmt: skip
    digits |= dict.fromkeys(("roll", "pitch", "heading"), ".9f")
    digits |= {name: ".6g" for name in row if name.startswith("cov_")}
    return {
        name: "" if cell is None else format(cell, digits.get(name, ""))
        for name, cell in row.items()
        if name not in ("epoch", "drive")
    }


def dataset_rows(out, name):
    flavour = pyarrow.dataset.partitioning(pyarrow.schema([("drive", pyarrow.string())]), flavor="hive")
    table = pyarrow.dataset.dataset(out, partitioning=flavour).to_table(filter=pyarrow.dataset.field("drive") == name)
    return [as_csv(row) for row in table.sort_by("epoch").to_pylist()]


@pytest.fixture
def long_drive(drive, tmp_path):
    """The four scans of the drive, ten times over."""
    folder = tmp_path / "long"
    folder.mkdir()
    scans = sorted(drive.dataset.scans.glob("*.bin"))
    lines = [line.split() for line in drive.dataset.prior.read_text().splitlines() if not line.startswith("#")]
    times = [f"{number / 10.0:.6f}" for number in range(N_EPOCHS)]
    for number in range(N_EPOCHS):
        shutil.copy(scans[number % 4], folder / f"{number:06d}.bin")
    (folder / "times.txt").write_text("\n".join(times) + "\n")
    poses = [" ".join([at, *lines[number % 4][1:]]) for number, at in enumerate(times)]
    (tmp_path / "prior.txt").write_text("\n".join(poses) + "\n")
    return folder, tmp_path / "prior.txt"


@pytest.fixture
def single(maxcon, drive, tmp_path):
    """Localize a drive by a single call, in this process; return its rows."""

    def localize(name, scans, prior):
        out = tmp_path / f"{name}.single.csv"
        ended = maxcon("localize", drive.city, scans, "--prior", prior, "-o", out, *NARROW)
        assert ended.code in (0, 1), ended
        return read_csv(out)

    return localize


@pytest.fixture
def table(drive, long_drive, tmp_path):
    path = tmp_path / "drives.csv"
    path.write_text(
        f'name,scans,prior\nlong,long,{long_drive[1]}\nshort,"{drive.dataset.scans}",{drive.dataset.prior}\n'
    )
    return path


@pytest.mark.clusters
def test_workers_write_the_table_of_one_process(drive, long_drive, maxcon, single, tmp_path):
    out, pictures = tmp_path / "poses.csv", tmp_path / "pictures"
    arguments = ("localize", drive.city, long_drive[0], "--prior", long_drive[1], "-o", out, *NARROW)
    ended = maxcon(*arguments, "--workers", "2", "--plot", pictures, "--plot-epochs", "0,39")
    assert (ended.code, ended.err) == (0, "")
    assert f"{N_EPOCHS} of {N_EPOCHS} epochs localized" in ended.out
    wanted = single("long", *long_drive)
    assert without_times(read_csv(out)) == without_times(wanted)
    assert sorted(path.name for path in pictures.iterdir()) == ["000000.png", "000039.png"]
    lines = out.read_text().splitlines(keepends=True)
    out.write_text("".join(lines[:18]))
    assert maxcon(*arguments, "--workers", "2", "--resume").code == 0
    assert without_times(read_csv(out)) == without_times(wanted)


@pytest.mark.clusters
@pytest.mark.parametrize("n_workers", [1, 2])
def test_many_drives_have_the_rows_of_single_calls(drive, long_drive, table, maxcon, single, tmp_path, n_workers):
    out = tmp_path / "out"
    arguments = ("localize", drive.city, "--drives", table, "-o", out, *NARROW, "--workers", n_workers)
    ended = maxcon(*arguments)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.splitlines()[-1] == f"44 of 44 epochs of 2 drives localized; in {out}"
    for name, parts in {"long": long_drive, "short": (drive.dataset.scans, drive.dataset.prior)}.items():
        assert without_times(dataset_rows(out, name)) == without_times(single(name, *parts))
    assert sorted(path.name for path in out.iterdir()) == [
        ".lock",
        "_drives.json",
        "_options.json",
        "drive=long",
        "drive=short",
    ]
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
    again = maxcon(*arguments)
    assert again.out == f"44 of 44 epochs of 2 drives localized, 44 of them were there; in {out}\n"
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")} == before
    shutil.rmtree(out / "drive=short")
    assert "40 of them were there" in maxcon(*arguments).out


@pytest.mark.clusters
@pytest.mark.skipif(sys.platform == "win32", reason="no POSIX signals to stop a process with")
def test_drives_that_are_stopped_go_on(drive, table, long_drive, maxcon, maxcon_process, single, tmp_path):
    out = tmp_path / "out"
    arguments = ("localize", drive.city, "--drives", table, "-o", out, *NARROW, "--workers", "2", "--quiet")
    with maxcon_process(*arguments) as process:
        while not list(out.glob("_parts/long/[!.]*.parquet")) and process.poll() is None:
            time.sleep(0.002)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=600)
    assert (process.returncode, err) == (128 + signal.SIGINT, "")
    kept = PosesDataset(out).rows("long").to_pylist()
    assert maxcon(*arguments).code == 0
    assert without_times(dataset_rows(out, "long")) == without_times(single("long", *long_drive))
    after = {row["epoch"]: row for row in PosesDataset(out).rows("long").to_pylist()}
    assert kept and all(after[row["epoch"]] == row for row in kept)  # times and all: not made again


@pytest.fixture
def cluster():
    """A scheduler and two workers, started as a user does; its address, and the workers' processes."""
    with ExitStack() as stack:

        def start(*words):
            command = [sys.executable, "-m", "dask", *words, "--host", "127.0.0.1"]
            process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
            stack.callback(process.communicate)
            stack.callback(process.terminate)
            return process

        scheduler = start("scheduler", "--port", "0", "--dashboard-address", "127.0.0.1:0")
        address = next(word for line in scheduler.stderr for word in line.split() if word.startswith("tcp://"))
        Thread(target=scheduler.stderr.read, daemon=True).start()  # else it stops where the pipe is full
        for _ in range(2):
            worker = start("worker", address, "--nthreads", "1", "--no-dashboard", "--memory-limit", "0")
            Thread(target=worker.stderr.read, daemon=True).start()
        yield address


@pytest.mark.clusters
def test_a_cluster_started_by_hand_makes_the_same_rows(drive, long_drive, table, cluster, maxcon, single, tmp_path):
    out = tmp_path / "out"
    arguments = ("localize", drive.city, "--drives", table, "-o", out, *NARROW, "--scheduler", cluster)
    ended = maxcon(*arguments)
    # Its workers may be starting still.
    assert ended.code == 0 and set(ended.err.splitlines()) <= {f"waiting up to 30 s for a worker at {cluster}"}
    assert ended.out == f"44 of 44 epochs of 2 drives localized; in {out}\n"
    for name, parts in {"long": long_drive, "short": (drive.dataset.scans, drive.dataset.prior)}.items():
        assert without_times(dataset_rows(out, name)) == without_times(single(name, *parts))


def test_a_drive_that_cannot_be_localized_keeps_no_other_from_it(drive, table, maxcon, tmp_path):
    out = tmp_path / "out"
    lines = table.read_text().splitlines()
    (tmp_path / "far.txt").write_text("0 9000000 0 0 0 0 0 1\n4 9000000 0 0 0 0 0 1\n")
    table.write_text("\n".join([lines[0], "far,long,far.txt", "none,nowhere,far.txt", *lines[2:]]) + "\n")
    ended = maxcon("localize", drive.city, "--drives", table, "-o", out, *NARROW, "--workers", "1", "--max-gap", "9")
    assert ended.code == 2
    assert ended.out == f"4 of 4 epochs of 1 drives localized; in {out}\n"
    assert ended.err.startswith("maxcon: Expected drives that can be localized, but 2 of 3 cannot; the first, ")
    assert ended.err.count("\n") == 1


def test_toml_names_a_map_for_each(drive, maxcon, tmp_path):
    table = tmp_path / "drives.toml"
    scans, prior = drive.dataset.scans, drive.dataset.prior
    table.write_text(
        "".join(
            f'[[drive]]\nname = "{name}"\nscans = "{scans}"\nprior = "{prior}"\nmap = "{drive.city}"\n'
            for name in ("0001", "b")
        )
    )
    ended = maxcon("localize", "--drives", table, "-o", tmp_path / "out", *NARROW, "--workers", "1")
    assert (ended.code, ended.err) == (0, "")
    assert dataset_rows(tmp_path / "out", "0001") != []


def test_other_options_are_refused(drive, table, maxcon, refused, tmp_path):
    arguments = ("localize", drive.city, "--drives", table, "-o", tmp_path / "out", "--workers", "1")
    assert maxcon(*arguments, *NARROW).code == 0
    refused(
        maxcon(*arguments, *NARROW, "--thinning", "0.5", "--max-gap", "2"),
        "with the same options", "options.drive.max_gap 0.5, got 2.0; options.thinning 0.25, got 0.5.",
    )  # fmt: skip
    options = json.loads((tmp_path / "out" / "_options.json").read_text())
    assert options["options"]["thinning"] == 0.25 and "threads" not in options["options"]


def test_options_may_change_while_there_is_no_row(drive, table, maxcon, tmp_path):
    """A call may be killed once it has made the folder for rows, and before there is one."""
    out = tmp_path / "out"
    arguments = ("localize", drive.city, "--drives", table, "-o", out, "--workers", "1", *NARROW)
    (out / "_parts" / "short").mkdir(parents=True)
    (out / "_parts" / "short" / ".000000000.parquet.partial-12345678").mkdir()
    (out / "_options.json").write_text('{"maxcon": "0.0.1"}')
    (out / "_drives.json").write_text('{"short": {"map": "another"}}')
    assert maxcon(*arguments).code == 0
    assert not (out / "_parts").exists()


def test_what_a_killed_call_left_of_a_drive_that_is_done_goes(drive, table, maxcon, tmp_path):
    """The rows of a drive wait until its file is there: a kill may fall before they are removed, or into its making."""
    out = tmp_path / "out"
    arguments = ("localize", drive.city, "--drives", table, "-o", out, "--workers", "1", *NARROW)
    assert maxcon(*arguments).code == 0
    whole, files = dataset_rows(out, "short"), sorted(out.rglob("*"))
    (out / "_parts" / "short").mkdir(parents=True)
    (out / "._drives.json.partial-12345678").mkdir()
    shutil.copy(out / "drive=short" / "poses.parquet", out / "_parts" / "short" / "000000000.parquet")
    assert "44 of them were there" in maxcon(*arguments).out
    assert sorted(out.rglob("*")) == files
    (out / "_parts" / "short").mkdir(parents=True)
    (out / "drive=short" / "poses.parquet").rename(out / "_parts" / "short" / "000000000.parquet")
    (out / "drive=short" / ".poses.parquet.partial-12345678").mkdir()
    assert "44 of 44 epochs of 2 drives localized, 44 of them" in maxcon(*arguments).out
    assert dataset_rows(out, "short") == whole
    assert sorted(out.rglob("*")) == files


def test_another_map_or_prior_is_refused(drive, long_drive, table, maxcon, refused, tmp_path):
    arguments = ("--drives", table, "-o", tmp_path / "out", "--workers", "1", *NARROW)
    assert maxcon("localize", drive.city, *arguments).code == 0
    other = tmp_path / "other.map"
    assert maxcon("map", "copy", drive.city, other).code == 0
    assert maxcon("localize", other, *arguments).code == 0  # the same map elsewhere
    manifest = read_manifest(other)
    manifest.build["remark"] = "another"
    write_manifest(other, manifest)
    refused(maxcon("localize", other, *arguments), "its map is another", "localize it anew")
    long_drive[1].write_text(long_drive[1].read_text() + "# changed\n")
    refused(maxcon("localize", drive.city, *arguments), "its prior is another")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "`array` of length >= 1"),
        ("name,scans,priors\na,b,c\n", "unknown field `priors`"),
        ("name,scans\na,scans\nA,scans\n", "got 'A' twice"),
        ("name,scans\n../a,scans\n", "a folder is named by it"),
        ("name,scans\na,scans,more\n", "3 columns in row 1 below a header of 2"),
        ("name,scans\na,\n", "`drive[0].scans`: expected `str` of length >= 1"),
        ("name,scans\n", "`array` of length >= 1"),
        ("name,name,scans\na,b,c\n", "a column twice"),
        ('name,scans\n"a,b\n', "Expected a table of drives"),
        ("\x00\xff", "Expected"),
    ],
)
def test_a_table_that_is_none_is_one_line(drive, maxcon, refused, tmp_path, text, words):
    table = tmp_path / "drives.csv"
    table.write_bytes(text.encode("latin-1"))
    refused(maxcon("localize", drive.city, "--drives", table, "-o", tmp_path / "out"), words)
    assert not (tmp_path / "out").exists()


def test_what_has_no_effect_is_refused(drive, table, maxcon, refused, tmp_path):
    out = ("-o", tmp_path / "out")
    refused(maxcon("localize", drive.city, "scans", "--drives", table, *out), "no SCANS beside it")
    refused(maxcon("localize", drive.city, "--drives", table, *out, "--prior", table), "no --prior beside it")
    refused(
        maxcon("localize", drive.city, "--drives", table, *out, "--resume"), "without --resume", "goes on by itself"
    )
    refused(
        maxcon("localize", drive.city, "--drives", table, *out, "--overwrite"),
        "without --overwrite", f"remove {tmp_path / 'out'} yourself", "drive=NAME",
    )  # fmt: skip
    refused(
        maxcon("localize", drive.city, "--drives", table, *out, "--tum", tmp_path / "a.tum"),
        "--tum with one drive only", "maxcon export",
    )  # fmt: skip
    refused(maxcon("localize", drive.city, "--drives", table, *out, "--plot", tmp_path), "--plot with one drive only")
    refused(maxcon("localize", drive.city, *out), "got no SCANS")
    refused(maxcon("localize", *out), "got no MAP")
    refused(maxcon("localize", "--drives", table, *out), "Name it there, or one MAP for all")
    both = ("--workers", "2", "--scheduler", "tcp://127.0.0.1:1")
    refused(maxcon("localize", drive.city, drive.dataset.scans, *out, *both), "Leave out --workers or --scheduler")
    refused(
        maxcon("localize", drive.city, drive.dataset.scans, "--track", "--workers", "2", *out),
        "each epoch needs the one before",
    )
    refused(maxcon("localize", drive.city, "--drives", table, "-o", tmp_path), "it holds")
    assert not (tmp_path / "out").exists()


@pytest.mark.clusters
def test_a_drive_s_workers_may_be_killed(drive, long_drive, maxcon_process, single, tmp_path):
    if not Path("/proc/self/task").exists():
        pytest.skip("no /proc: processes cannot be watched")
    out = tmp_path / "poses.csv"
    arguments = ("localize", drive.city, long_drive[0], "--prior", long_drive[1], "-o", out, *NARROW)
    with maxcon_process(*arguments, "--workers", "2") as process:
        workers = []
        while len(workers) < 2 and process.poll() is None:  # the second is started once the first answers
            time.sleep(0.01)
            tasks = Path(f"/proc/{process.pid}/task").glob("*/children")
            children = [int(child) for task in tasks for child in task.read_text().split()]
            workers = [pid for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        for worker in workers:
            os.kill(worker, signal.SIGKILL)
        _, err = process.communicate(timeout=900)
    assert (process.returncode, err, len(workers)) == (0, "", 2)
    assert without_times(read_csv(out)) == without_times(single("long", *long_drive))
