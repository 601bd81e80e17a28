# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The table of drives: paths are relative to it, and what has an address is left as it is."""

from pathlib import Path

from maxcon.drive.many import DriveEntry, read_drives, tasks_of


def test_paths_are_relative_to_the_table_and_addresses_are_not(tmp_path):
    table = tmp_path / "drives.csv"
    table.write_text(
        '# two days\nname,scans,prior,map\nmonday,a/scans,,\n"tuesday",/b.mcap,"gnss, raw.csv",s3://bucket/city.map\n',
        encoding="utf-8-sig",
    )
    assert read_drives(table, Path("city.map")) == [
        DriveEntry("monday", tmp_path / "a" / "scans", Path("city.map")),
        DriveEntry("tuesday", Path("/b.mcap"), "s3://bucket/city.map", tmp_path / "gnss, raw.csv"),
    ]


def test_epochs_go_in_runs_of_neighbours_whatever_is_there_already():
    entry = DriveEntry("a", Path("scans"), Path("city.map"))
    runs = [(task.first, task.last) for task in tasks_of(entry, [*range(70), 80, 81, 90])]
    assert runs == [(0, 32), (32, 64), (64, 70), (80, 82), (90, 91)]
    assert [(task.first, task.last) for task in tasks_of(entry, range(70), is_track=True)] == [(0, 70)]
    assert list(tasks_of(entry, [])) == []
