"""POSES.csv while it grows: what is localized is kept whatever happens, and gone on with."""

import signal

import pytest

from localized_poses import rows_of
from maxcon.errors import MapError
from maxcon.io.trajectories import read_trajectory
from maxcon.localizer import MaximumConsensus

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


@pytest.fixture
def table(out):
    """Where the table is written, in a folder of its own."""
    return out / "poses.csv"


@pytest.fixture
def arguments(drive, table):
    return *drive.localize, table


@pytest.fixture
def stopped(stopped_when, arguments, table, tmp_path):
    """Send a signal to a drive when it has written so many rows; return its exit code and stderr."""

    def run(number, n_rows=2):
        def is_there(_):
            n_written = len(rows_of(table)) if table.exists() else 0
            return n_written == n_rows and (n_rows or (tmp_path / "go.awaited").exists())

        script = WAITING.format(n_first=n_rows, go=str(tmp_path / "go"))
        return stopped_when(number, is_there, *arguments, script=script)

    return run


@pytest.mark.kills
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_drive_that_is_stopped_keeps_its_rows_and_is_gone_on_with(stopped, maxcon, arguments, table, poses, number):
    code, err = stopped(number)
    assert code == (-number if number == signal.SIGKILL else 128 + number)
    if number != signal.SIGKILL:
        assert err == f"maxcon: stopped; 2 of 4 epochs are kept in {table}: go on with --resume\n"
    left = {".poses.csv.lock"} if number == signal.SIGKILL else set()  # that a process is killed, nothing can clear
    assert {path.name for path in table.parent.iterdir()} - left == {"poses.csv"}
    assert rows_of(table) == rows_of(poses)[:2] and maxcon(*arguments, "--resume").code == 0
    assert rows_of(table) == rows_of(poses)


@pytest.mark.kills
def test_a_drive_that_is_stopped_before_its_first_row_writes_nothing(stopped, table):
    assert stopped(signal.SIGINT, 0) == (130, "maxcon: stopped; nothing was written\n")
    assert list(table.parent.iterdir()) == []


def test_rows_that_are_there_are_not_made_again(maxcon, arguments, table, poses):
    content = poses.read_bytes()
    head = b"".join(content.splitlines(keepends=True)[:3])
    table.write_bytes(head)
    ended = maxcon(*arguments, "--resume", "--tum", table.parent / "poses.txt")
    assert (ended.code, ended.err) == (0, "") and "2 of 2 epochs localized" in ended.out
    assert "behind 2 that were there, 2 of them localized" in ended.out
    assert table.read_bytes().startswith(head) and rows_of(table) == rows_of(poses)
    assert len(read_trajectory(table.parent / "poses.txt")) == 4
    for n_cut in (1, 30):  # a row that was cut
        table.write_bytes(content[:-n_cut])
        assert maxcon(*arguments, "--resume").code == 0 and rows_of(table) == rows_of(poses)
    before = table.read_bytes()
    ended = maxcon(*arguments, "--resume")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.startswith(f"all 4 epochs were in {table} already")
    assert "Nothing was done: inputs and options of this call had no effect" in ended.out
    assert table.read_bytes() == before


def test_a_table_is_not_replaced_unasked(maxcon, refused, arguments, table, poses):
    table.write_text("the table of yesterday")
    refused(maxcon(*arguments), table, "--resume", "--overwrite")
    refused(maxcon(*arguments, "--resume"), table, "to be a table of these scans")
    assert table.read_text() == "the table of yesterday"
    assert maxcon(*arguments, "--overwrite").code == 0 and rows_of(table) == rows_of(poses)


def test_epochs_not_localized_count_when_gone_on_with(maxcon, arguments, table, poses):
    lines = poses.read_text().splitlines()
    cells = lines[1].split(",")
    lines[1] = ",".join([cells[0], *[""] * 7, "ambiguous", cells[9], *[""] * (len(cells) - 10)])
    table.write_text("\n".join(lines[:3]) + "\n")
    ended = maxcon(*arguments, "--resume", "--tum", table.parent / "poses.txt")
    assert ended.code == 1 and "behind 2 that were there, 1 of them localized" in ended.out
    assert len(read_trajectory(table.parent / "poses.txt")) == 3


def test_a_map_that_breaks_half_way(maxcon, arguments, table, poses, monkeypatch):
    localize, asked = MaximumConsensus.localize, []

    def breaks(self, *scan):
        asked.append(scan)
        if len(asked) == 3:
            raise MapError("Expected a tile, got none. Build the map again.")
        return localize(self, *scan)

    monkeypatch.setattr(MaximumConsensus, "localize", breaks)
    ended = maxcon(*arguments)
    assert ended.code == 2
    kept = f"2 of 4 epochs are kept in {table}: go on with --resume.\n"
    assert ended.err == f"maxcon: Expected a tile, got none. Build the map again. {kept}"
    assert rows_of(table) == rows_of(poses)[:2]
