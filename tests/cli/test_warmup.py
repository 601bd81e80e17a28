"""`maxcon warmup`: what it compiles, what it says, and that nothing is left to compile for real calls."""

import os
from contextlib import suppress

import numba
import numpy as np
import pytest

from maxcon._system.kernel_cache import on_compilation
from maxcon.cli.terminal import COMPILING, compiling_told

pytestmark = pytest.mark.cold

PARTS = (
    "building maps", "normals of scans", "search in maps in memory", "search in maps on disk", "search without a prior",
)  # fmt: skip

ALL_OPTIONS = """
import sys
from maxcon import MaximumConsensus, PointMap
from maxcon.drive.localize import localize_drive
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.search.objectives import OBJECTIVES
from maxcon.warmup import options_of_the_method

point_map, scans, prior = PointMap.open(sys.argv[1]), open_scans(sys.argv[2]), read_trajectory(sys.argv[3])
for options in options_of_the_method():
    for objective in OBJECTIVES:
        method = MaximumConsensus(objective=objective, **options)
        print(next(localize_drive(point_map, scans, prior, method)).status.value)
"""


@pytest.fixture(scope="module")
def in_cache(maxcon_in_process_of_its_own):
    """Run the command line, or another script, with a folder for compiled code."""

    def run(cache, *arguments, **script):
        return maxcon_in_process_of_its_own(*arguments, env={"NUMBA_CACHE_DIR": str(cache)}, **script)

    return run


def _code(cache):
    return {path.relative_to(cache): path.stat().st_mtime_ns for path in cache.rglob("*.nbc")}


@pytest.fixture(scope="module")
def warmed(tmp_path_factory, in_cache):
    """A folder that a first warm-up filled, and how that ended."""
    cache = tmp_path_factory.mktemp("warmed") / "cache"
    return cache, in_cache(cache, "warmup")


@pytest.fixture
def nothing_new(warmed):
    """The folder of a warm-up; nothing else may be compiled into it."""
    before = _code(warmed[0])
    yield warmed[0]
    assert _code(warmed[0]) == before


@pytest.mark.parametrize("call", ["first", "second"])
def test_a_call_says_what_it_compiles_and_where_that_is_kept(warmed, in_cache, call):
    cache, ended = warmed
    before = _code(cache)
    if call == "second":
        ended = in_cache(cache, "warmup")
    assert (ended.code, ended.err) == (0, "")
    *lines, last = ended.out.splitlines()
    assert [line.split("  ")[0] for line in lines] == list(PARTS)
    (folder,) = cache.iterdir()
    if call == "first":
        assert all(" compiled in " in line and line.endswith(" s") for line in lines)
        assert last.startswith("compiled in ") and last.endswith(f" s; the code is kept in {folder}")
        assert len(before) >= len(PARTS)
    else:
        assert all(line.endswith(" compiled already") for line in lines)
        assert last == f"everything was compiled already; the code is kept in {folder}"
        assert in_cache(cache, "warmup", "--quiet").out == last + "\n" and _code(cache) == before


def test_nothing_is_left_to_compile_when_localizing(nothing_new, in_cache, drive, tmp_path):
    files = (drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", tmp_path / "poses.csv")
    ended = in_cache(nothing_new, "localize", *files)
    assert ended.code == 0 and ended.out.startswith("4 of 4 epochs localized"), ended


def test_nothing_is_left_to_compile_for_any_option_of_the_method(nothing_new, in_cache, drive):
    folders = (drive.city, drive.dataset.scans, drive.dataset.prior)
    ended = in_cache(nothing_new, *folders, script=ALL_OPTIONS)
    assert (ended.code, ended.err) == (0, "") and set(ended.out.split()) == {"localized"}


def test_nothing_is_left_to_compile_when_building_a_map(nothing_new, in_cache, drive, street, tmp_path):
    trajectory = ("--trajectory", drive.dataset.map_trajectory, "-o", tmp_path / "city.map")
    assert in_cache(nothing_new, "map", "build", *drive.dataset.map_clouds, *trajectory).code == 0
    tile_of_one_point = np.concatenate([street, street[:1] + [100.0, 0.0, 0.0]])
    np.savez(tmp_path / "street.npz", points=tile_of_one_point)
    assert in_cache(nothing_new, "map", "build", tmp_path / "street.npz", "-o", tmp_path / "street.map").code == 0


def _on_terminal(start, *arguments, cache):
    """Run a command whose stderr is a terminal; what that showed."""
    master, slave = os.openpty()
    shown = b""
    with start(*arguments, stderr=slave, env={"NUMBA_CACHE_DIR": str(cache)}) as process:
        os.close(slave)
        with suppress(OSError):  # the other end is closed
            while part := os.read(master, 4096):
                shown += part
        process.communicate()
    os.close(master)
    assert process.returncode == 0, shown
    return shown.decode()


def test_a_command_that_pauses_to_compile_says_so_once(maxcon_process, street_npz, tmp_path):
    build, cache = ("map", "build", street_npz, "-o"), tmp_path / "cache"
    first = _on_terminal(maxcon_process, *build, tmp_path / "1.map", cache=cache)
    assert first.count(COMPILING) == 1 and _code(cache)
    second = _on_terminal(maxcon_process, *build, tmp_path / "2.map", cache=cache)
    assert "making tiles" in second and "compiling" not in second


def _new_kernel(module):
    def kernel(x):
        return x + 1

    kernel.__module__ = module
    return numba.njit(kernel)


@pytest.mark.parametrize(("is_quiet", "is_terminal"), [(False, True), (True, True), (False, False)])
def test_each_compilation_counts_is_told_once_and_not_where_quiet(monkeypatch, capsys, is_quiet, is_terminal):
    monkeypatch.setattr("sys.stderr.isatty", lambda: is_terminal)
    kernel, other, calls = _new_kernel("maxcon.kernels"), _new_kernel("elsewhere"), []
    with compiling_told(is_quiet), on_compilation(lambda: calls.append(1)):
        assert (kernel(1), kernel(2), kernel(1.0), other(1)) == (2, 3, 2.0, 2)
    kernel(1j)
    assert len(calls) == 2
    assert capsys.readouterr().err == f"{COMPILING}\n" * (is_terminal and not is_quiet)
