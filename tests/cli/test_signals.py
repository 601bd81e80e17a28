"""Commands that a signal stops leave nothing half written (D10), also where its exception is swallowed."""

import signal
import sys
import time

import pytest

pytestmark = pytest.mark.kills

if sys.platform == "win32":
    pytest.skip("no POSIX signals to stop a process with", allow_module_level=True)

# So that there is time to be stopped in.
SLOW = """
import time
import maxcon.mapping.build.build as build
from maxcon.cli import main

def slow(function):
    return lambda *arguments: (time.sleep(0.1), function(*arguments))[1]

build.MapWriter.put = slow(build.MapWriter.put)
main()
"""

# As compiled code is loaded: what is raised in a callback from C goes no farther.
SWALLOWS = """
import ctypes, os, signal, sys, time
import maxcon._system.atomic
import maxcon.mapping.build as mapping
from maxcon.cli import main

@ctypes.CFUNCTYPE(None)
def callback():
    os.kill(os.getpid(), signal.{name})
    for _ in range(10):
        time.sleep(0.001)

def build(clouds, out, *arguments, **options):
    with maxcon._system.atomic.atomic_folder(out):
        callback()
        sys.stdout.write("went on")
        sys.stdout.flush()
        for _ in range(6000):
            time.sleep(0.01)

mapping.build_map = build
main()
"""

# What takes long while it is cleaned up is not stopped once more.
CLEANS_UP = """
import os, signal, time
import maxcon.mapping.build as mapping
from maxcon.cli import main

def build(*arguments, **options):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
    finally:
        time.sleep(1.0)
        print("cleaned up")

mapping.build_map = build
main()
"""

# The exception of a signal becomes another error on its way.
BECOMES_ANOTHER = """
import os, signal
import maxcon.drive.localize
from maxcon.cli import main
from maxcon.errors import FileError

def read(*arguments, **options):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
    except SystemExit:
        raise {error} from None

maxcon.drive.localize.Drive.of = read
main()
"""
IGNORES_HANGUPS = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); from maxcon.cli import main; main()"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@pytest.mark.parametrize("stage", ["points", "tiles"])
def test_a_build_that_is_stopped_leaves_nothing(stopped_when, drive, out, number, stage):
    has_begun = lambda _: list(out.glob(f".city.map.partial-*/*/{stage}"))  # noqa: E731
    assert stopped_when(number, has_begun, *drive.build, out / "city.map", script=SLOW) == (
        128 + number,
        "maxcon: stopped\n",
    )
    assert list(out.iterdir()) == []


def test_what_ignores_hangups_goes_on(stopped_when, drive, out):
    has_begun = lambda _: list(out.glob(".city.map.partial-*"))  # noqa: E731
    assert stopped_when(signal.SIGHUP, has_begun, *drive.build, out / "city.map", script=IGNORES_HANGUPS)[0] == 0
    assert [path.name for path in out.iterdir()] == ["city.map"]


def test_where_there_is_no_hangup_nothing_waits_for_one(maxcon, monkeypatch):
    monkeypatch.delattr(signal, "SIGHUP")  # as on Windows
    assert maxcon("--version")[::2] == (0, "")


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_that_is_swallowed_ends_the_command_all_the_same(maxcon_in_process_of_its_own, out, name):
    build = ("map", "build", "a.npz", "-o", out / "a.map")
    stopped = maxcon_in_process_of_its_own(*build, script=SWALLOWS.format(name=name))
    assert stopped == (128 + getattr(signal, name), "went on", "maxcon: stopped\n")
    assert list(out.iterdir()) == []


def test_cleaning_up_is_not_interrupted(maxcon_in_process_of_its_own):
    started = time.monotonic()
    stopped = maxcon_in_process_of_its_own("map", "build", "a.npz", "-o", "a.map", script=CLEANS_UP)
    assert stopped == (128 + signal.SIGTERM, "cleaned up\n", "maxcon: stopped\n")
    assert time.monotonic() - started > 1.0


@pytest.mark.parametrize("error", ["SystemError('a result with an exception set')", "FileError('not complete')"])
def test_a_stop_that_became_another_error_on_its_way(maxcon_in_process_of_its_own, drive, out, error):
    ended = maxcon_in_process_of_its_own(*drive.localize, out / "poses.csv", script=BECOMES_ANOTHER.format(error=error))
    assert ended == (128 + signal.SIGTERM, "", "maxcon: stopped\n")
    assert list(out.iterdir()) == []
