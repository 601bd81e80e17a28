# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The table of drives: paths are relative to it, and what has an address is left as it is."""

from pathlib import Path

import pytest

from maxcon.drive.many import DriveEntry, read_drives, tasks_of
from maxcon.errors import FileError


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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "`array` of length >= 1"), ("name,scans\n", "`array` of length >= 1"),
        ("name,scans,priors\na,b,c\n", "unknown field `priors`"), ("name,scans\na,scans\nA,scans\n", "got 'A' twice"),
        ("name,scans\n../a,scans\n", "a folder is named by it"),
        ("name,scans\na,scans,more\n", "line 2: Expected 2 columns .*, got 3"),
        ("name,scans\na,\n", r"`drive\[0\].scans`: expected `str` of length >= 1"),
        ('name,scans\n"a,b\n', "line 2: Expected comma-separated values"), ("\x00\xff", "Expected"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_refused_in_a_line(tmp_path, text, words):
    (tmp_path / "drives.csv").write_bytes(text.encode("latin-1"))
    with pytest.raises(FileError, match=words) as refused:
        read_drives(tmp_path / "drives.csv", Path("city.map"))
    assert "\n" not in str(refused.value)
