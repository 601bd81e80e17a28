# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What is loaded at the start, help, version, and mistyped commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import maxcon as package
from maxcon.cli.flags import TITLES

HEAVY = (
    "numpy numba scipy pyarrow laspy lazrs pyproj matplotlib jinja2 embreex trimesh pypcd4 rich.progress rich.table"
    " asyncio multiprocessing rosbags mcap velodyne_decoder dask distributed"
)
COMMANDS = (
    "map", "map build", "map info", "map align", "map update", "map copy", "scans", "scans info", "localize",
    "relocalize", "export", "simulate", "study", "report", "demo", "warmup",
)  # fmt: skip


def test_nothing_heavy_is_loaded_before_it_is_needed(maxcon_in_process_of_its_own):
    script = f"""
import atexit, sys
from maxcon.cli import main
atexit.register(lambda: print([n for n in {HEAVY.split()!r} if n in sys.modules]))
main()
"""
    ended = maxcon_in_process_of_its_own("localize", "--help", script=script)
    assert ended.code == 0 and ended.out.endswith("\n[]\n")


@pytest.mark.parametrize("command", [[Path(sys.executable).parent / "maxcon"], [sys.executable, "-m", "maxcon"]])
def test_the_console_script_and_the_package_print_the_version(command):
    printed = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert (printed.stdout, printed.stderr) == (f"maxcon {package.__version__}\n", "")


def test_every_command_has_help_and_the_program_lists_them(maxcon):
    said = maxcon("--help").out
    for command in COMMANDS:
        ended = maxcon(*command.split(), "--help")
        assert (ended.code, ended.err) == (0, "")
        assert f"maxcon {command}" in ended.out and "Traceback" not in ended.out
        assert f"\n  {command.split()[0]} " in said


def test_commands_are_completed_in_a_shell():
    asked = os.environ | {"_MAXCON_COMPLETE": "complete_bash", "COMP_WORDS": "maxcon reloc", "COMP_CWORD": "1"}
    command = Path(sys.executable).parent / "maxcon"
    assert subprocess.run([command], env=asked, capture_output=True, text=True).stdout == "relocalize\n"


GROUPED = ("localize", "relocalize", "study", "map build", "map align")


@pytest.mark.parametrize("command", GROUPED)
def test_help_of_many_options_is_in_groups(maxcon, command):
    """Each option is in one of them: the last, of what is in none, has the help itself alone."""
    said = maxcon(*command.split(), "--help").out
    *groups, last = said.split("\n\n")
    assert last.split() == ["Options:", "-h,", "--help", "Show", "this", "message", "and", "exit."]
    titles = [group.splitlines()[0] for group in groups]
    assert [title for title in titles if title.rstrip(":") in TITLES] == [
        f"{name}:" for name in TITLES if f"{name}:" in titles
    ]
    options = [line.split()[0] for line in said.splitlines() if line.startswith("  -")]
    assert len(options) == len(set(options)) > 10


def test_groups_are_of_localize(maxcon):
    said = {group.splitlines()[0]: group for group in maxcon("localize", "--help").out.split("\n\n")}
    for group, option in {"Inputs:": "--prior", "Search space:": "--half-width", "Motion:": "--track",
                          "Output:": "-o, --out", "How it is done:": "--scheduler"}.items():  # fmt: skip
        assert f"\n  {option} " in said[group]


@pytest.mark.parametrize(
    "arguments",
    [
        ("nonsense",),
        ("map", "nonsense"),
        ("localize", "--nonsense"),
        ("localize", "m", "s", "--prior", "p", "-o", "o", "--search", "nonsense"),
        ("localize", "m", "s", "--prior", "p", "-o", "o", "--threads", "0"),
        ("map", "build", "a.laz"),
        ("simulate", "out", "--recording", "tape"),
    ],
)
def test_what_the_parser_refuses_ends_with_2(maxcon, arguments):
    ended = maxcon(*arguments)
    assert ended.code == 2 and ended.out == ""
    assert "Traceback" not in ended.err
    assert "Error" in ended.err


def test_short_help(maxcon):
    assert maxcon("-h") == maxcon("--help") and maxcon("localize", "-h") == maxcon("localize", "--help")
