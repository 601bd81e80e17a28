"""How commands start: nothing heavy, help, refusals of the parser; and those of the README one after the other."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import maxcon as package
from localized_poses import rows_of
from maxcon.cli.flags import TITLES
from maxcon.io.trajectories import read_trajectory
from maxcon.lab import simulation

HEAVY = (
    "numpy numba scipy pyarrow laspy lazrs pyproj matplotlib jinja2 embreex trimesh pypcd4 rich.progress rich.table"
    " asyncio multiprocessing rosbags mcap velodyne_decoder dask distributed"
)
COMMANDS = (
    "map", "map build", "map info", "map align", "map update", "map copy", "scans", "scans info", "localize",
    "relocalize", "export", "simulate", "study", "report", "demo", "warmup",
)  # fmt: skip
GROUPED = ("localize", "relocalize", "study", "map build", "map align")


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
    said = {group.splitlines()[0]: group for group in maxcon("localize", "--help").out.split("\n\n")}
    for group, option in {"Inputs:": "--prior", "Search space:": "--half-width", "Motion:": "--track",
                          "Output:": "-o, --out", "How it is done:": "--scheduler"}.items():  # fmt: skip
        assert f"\n  {option} " in said[group]
    assert maxcon("-h") == maxcon("--help") and maxcon("localize", "-h") == maxcon("localize", "--help")


def test_commands_are_completed_in_a_shell():
    asked = os.environ | {"_MAXCON_COMPLETE": "complete_bash", "COMP_WORDS": "maxcon reloc", "COMP_CWORD": "1"}
    command = Path(sys.executable).parent / "maxcon"
    assert subprocess.run([command], env=asked, capture_output=True, text=True).stdout == "relocalize\n"


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


@pytest.mark.parametrize("arguments", [
    "nonsense", "localize --nonsense", "localize m s --prior p -o o --search nonsense", "map build a.laz",
    "simulate out --recording tape",
])  # fmt: skip
def test_what_the_parser_refuses_ends_with_2(maxcon, arguments):
    ended = maxcon(*arguments.split())
    assert ended.code == 2 and ended.out == ""
    assert "Traceback" not in ended.err and "Error" in ended.err


def test_from_nothing_to_poses(maxcon, thin_profiles, tmp_path, monkeypatch):
    """Of the city to simulate only a part is mapped, with few points."""
    part = partial(simulation.simulate, before=30.0, after=20.0, mapping_scanners=thin_profiles)
    monkeypatch.setattr(simulation, "simulate", part)
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        ended = maxcon(*arguments)
        assert (ended.code, ended.err) == (0, ""), ended
        return ended.out

    printed = run("simulate", "dataset", "--epochs", "3", "--seed", "7", "--recording", "mcap")
    clouds = sorted((tmp_path / "dataset" / "map").glob("*.laz"))
    assert printed.splitlines()[0] == "dataset"
    assert f"({len(clouds)} files, vehicles are class 64)" in printed
    assert "map sigma    0 m (map build --sigma 0)\n" in printed
    for name in ("map/trajectory.txt", "scans", "reference.txt", "prior.txt", "drive.mcap"):
        assert f"dataset/{name}" in printed and (tmp_path / "dataset" / name).exists()
    assert "/points: 3 scans" in run("scans", "info", "dataset/drive.mcap")

    given = ("--trajectory", "dataset/map/trajectory.txt", "--vehicle-class", "64", "--sigma", "0")
    built = run("map", "build", *clouds, *given, "-o", "city.map")
    info = run("map", "info", "city.map", "--check")
    assert built == f"city.map\n{info.partition('checked')[0]}"
    utm, sided = "ETRS89 / UTM zone 32N (EPSG:25832)", "turned to the sensor's side"
    for words in ("0.06 m", utm, sided, "sigma        0 m, given\n", " ground", "class 64", "are as they were written"):
        assert words in info
    assert sum(line.startswith("source") for line in info.splitlines()) == len(clouds)

    files = ("--prior", "dataset/prior.txt", "-o", "poses.csv", "--tum", "poses.txt")
    printed = run("localize", "city.map", "dataset/scans", *files)
    assert printed.startswith("3 of 3 epochs localized, median ") and "written to poses.csv" in printed
    reference, rows = read_trajectory(tmp_path / "dataset" / "reference.txt"), rows_of(tmp_path / "poses.csv")
    assert [row["status"] for row in rows] == ["localized"] * 3
    for found in (read_trajectory(tmp_path / "poses.csv"), read_trajectory(tmp_path / "poses.txt")):
        np.testing.assert_allclose(found.times, reference.times, atol=1e-6)
        assert np.abs(found.positions[:, :2] - reference.positions[:, :2]).max() < 0.06
        turns = np.angle(np.exp(1j * (found.angles[:, 2] - reference.angles[:, 2])))
        assert np.abs(np.degrees(turns)).max() < 0.5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["city.map", "dataset", "poses.csv", "poses.txt"]
    assert sorted(path.name for path in (tmp_path / "city.map").iterdir()) == ["ground", "manifest.json", "tiles"]
