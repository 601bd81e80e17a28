# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""POSES.csv while it grows: what is localized is kept whatever happens, and gone on with."""

import csv
import signal
import time

import pytest

from maxcon.io.trajectories import read_trajectory

# So that there is time to be stopped in, and nothing of it is left to the speed of the machine: no more than the first
# rows are made before the signal has come.
WAITING = """
import os, sys, time
import maxcon.drive.localize
from maxcon.cli import main

read, n_first, go = maxcon.drive.localize.read_epoch, {n_first}, {go!r}

def waits(scans, epoch, options):
    while epoch >= n_first and not os.path.exists(go):
        open(go + ".awaited", "w").close()
        time.sleep(0.01)
    return read(scans, epoch, options)

maxcon.drive.localize.read_epoch = waits
main()
"""
LONG = 600.0
"""s; only a test that fails waits so long."""


def rows_of(path):
    with path.open(newline="") as file:
        return [row | {"ms": ""} for row in csv.DictReader(file)]


@pytest.fixture
def out(tmp_path):
    (tmp_path / "out").mkdir()
    return tmp_path / "out" / "poses.csv"


@pytest.fixture
def arguments(drive, out):
    return ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", out)


@pytest.fixture(scope="module")
def whole(drive, tmp_path_factory, maxcon_in_process_of_its_own):
    """The rows of a drive that nothing stopped."""
    path = tmp_path_factory.mktemp("whole") / "poses.csv"
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", path)
    assert maxcon_in_process_of_its_own(*arguments).code == 0
    return rows_of(path)


@pytest.fixture
def stopped(maxcon_process, arguments, out, tmp_path):
    """Send a signal to a drive when it has written so many rows; return its exit code and stderr."""

    def run(number, n_rows=2, *options):
        script = WAITING.format(n_first=n_rows, go=str(tmp_path / "go"))
        with maxcon_process(*arguments, *options, script=script) as process:
            deadline = time.monotonic() + LONG
            while time.monotonic() < deadline and process.poll() is None:
                is_there = out.exists() and len(rows_of(out)) == n_rows
                if is_there or (n_rows == 0 and (tmp_path / "go.awaited").exists()):
                    break
                time.sleep(0.01)
            assert process.poll() is None, process.stderr.read()
            process.send_signal(number)
            _, err = process.communicate(timeout=LONG)
        return process.returncode, err

    return run


@pytest.mark.kills
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_drive_that_is_stopped_keeps_its_rows_and_is_gone_on_with(stopped, maxcon, arguments, out, whole, number):
    code, err = stopped(number)
    assert code == (-number if number == signal.SIGKILL else 128 + number)
    if number != signal.SIGKILL:
        assert err == f"maxcon: stopped; 2 of 4 epochs are kept in {out}: go on with --resume\n"
    assert [path.name for path in out.parent.iterdir()] == ["poses.csv"]
    assert rows_of(out) == whole[:2]
    kept = out.read_bytes()
    ended = maxcon(*arguments, "--resume", "--tum", out.parent / "poses.txt")
    assert (ended.code, ended.err) == (0, "")
    assert "2 of 2 epochs localized" in ended.out
    assert "behind 2 that were there, 2 of them localized" in ended.out
    assert out.read_bytes().startswith(kept)  # not made again
    assert rows_of(out) == whole
    assert len(read_trajectory(out.parent / "poses.txt")) == 4


@pytest.mark.kills
def test_a_drive_that_is_stopped_before_its_first_row_writes_nothing(stopped, out):
    assert stopped(signal.SIGINT, 0) == (130, "maxcon: stopped; nothing was written\n")
    assert list(out.parent.iterdir()) == []


def test_a_row_that_was_cut_is_made_again(maxcon, arguments, out, whole):
    assert maxcon(*arguments).code == 0
    content = out.read_bytes()
    for n_cut in (1, 2, 30):
        out.write_bytes(content[:-n_cut])
        assert maxcon(*arguments, "--resume").code == 0
        assert rows_of(out) == whole


def test_a_whole_table_that_is_gone_on_with_is_left_as_it_is(maxcon, arguments, out, whole):
    assert maxcon(*arguments).code == 0
    ended = maxcon(*arguments, "--resume")
    assert ended.code == 0 and rows_of(out) == whole
    assert "all 4 epochs were in" in ended.out and "prior, map and options of this call had no effect" in ended.out


def test_a_table_is_not_replaced_unasked(maxcon, refused, arguments, out, whole):
    out.write_text("the table of yesterday")
    refused(maxcon(*arguments), out, "--resume", "--overwrite")
    refused(maxcon(*arguments, "--resume", "--overwrite"), "both")
    refused(maxcon(*arguments, "--resume", "--track"), "--track")
    refused(maxcon(*arguments, "--resume"), out, "to be a table of these scans")
    assert out.read_text() == "the table of yesterday"
    assert maxcon(*arguments, "--overwrite").code == 0
    assert rows_of(out) == whole


def test_what_is_whole_is_left_as_it_is(maxcon, arguments, out):
    assert maxcon(*arguments, "--resume").code == 0
    before = out.read_bytes()
    ended = maxcon(*arguments, "--resume")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.startswith(f"all 4 epochs were in {out} already") and "Nothing was done" in ended.out
    assert out.read_bytes() == before


@pytest.mark.parametrize("what", ["another time", "more rows", "another column", "a column less", "bytes"])
def test_tables_of_other_drives_are_not_gone_on_with(maxcon, refused, arguments, out, what):
    assert maxcon(*arguments).code == 0
    lines = out.read_bytes().splitlines(keepends=True)
    lines = {
        "another time": [lines[0], b"9" + lines[1]],
        "more rows": [*lines, lines[-1]],
        "another column": [lines[0].replace(b"score", b"points"), *lines[1:]],
        "a column less": [lines[0], lines[1].partition(b",")[2]],
        "bytes": [lines[0], b"\xff\xfe\x00\n"],
    }[what]
    out.write_bytes(b"".join(lines))
    refused(maxcon(*arguments, "--resume"), out, "to be a table of these scans", "--overwrite")
    assert out.read_bytes() == b"".join(lines)


def test_epochs_not_localized_count_when_gone_on_with(maxcon, arguments, out):
    assert maxcon(*arguments).code == 0
    lines = out.read_text().splitlines()
    cells = lines[1].split(",")
    lines[1] = ",".join([cells[0], *[""] * 7, "ambiguous", cells[9], *[""] * (len(cells) - 10)])
    out.write_text("\n".join(lines[:3]) + "\n")
    ended = maxcon(*arguments, "--resume", "--tum", out.parent / "poses.txt")
    assert ended.code == 1
    assert "behind 2 that were there, 1 of them localized" in ended.out
    assert len(read_trajectory(out.parent / "poses.txt")) == 3


def test_a_map_that_breaks_half_way(maxcon, arguments, out, whole, monkeypatch):
    from maxcon.errors import MapError
    from maxcon.localizer import MaximumConsensus

    localize, asked = MaximumConsensus.localize, []

    def breaks(self, *scan):
        asked.append(scan)
        if len(asked) == 3:
            raise MapError("Expected a tile, got none. Build the map again.")
        return localize(self, *scan)

    monkeypatch.setattr(MaximumConsensus, "localize", breaks)
    ended = maxcon(*arguments)
    assert ended.code == 2
    assert ended.err == (
        "maxcon: Expected a tile, got none. Build the map again. "
        f"2 of 4 epochs are kept in {out}: go on with --resume.\n"
    )
    assert rows_of(out) == whole[:2]
