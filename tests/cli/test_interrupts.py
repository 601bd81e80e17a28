# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Commands that are stopped half way leave nothing half written (D10)."""

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


@pytest.fixture
def stop_when_begun(maxcon_process):
    """Start a command, send it a signal as soon as `began()`, and return its exit code and stderr."""

    def run(number, began, *arguments):
        with maxcon_process(*arguments, script=SLOW) as process:
            end = time.monotonic() + 600.0
            while not began() and process.poll() is None and time.monotonic() < end:
                time.sleep(0.005)
            assert process.poll() is None, process.stderr.read()
            process.send_signal(number)
            _, err = process.communicate(timeout=600)
        return process.returncode, err

    return run


@pytest.fixture
def build(drive, out):
    clouds = drive.dataset.map_clouds
    return ("map", "build", *clouds, "--trajectory", drive.dataset.map_trajectory, "-o", out / "city.map")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@pytest.mark.parametrize("stage", ["points", "tiles"])
def test_a_build_that_is_stopped_leaves_nothing(stop_when_begun, build, out, number, stage):
    code, err = stop_when_begun(number, lambda: list(out.glob(f".city.map.partial-*/{stage}")), *build)
    assert (code, err) == (128 + number, "")
    assert list(out.iterdir()) == []


def test_a_build_that_is_killed_leaves_no_map(stop_when_begun, build, out, maxcon, refused):
    code, _ = stop_when_begun(signal.SIGKILL, lambda: list(out.glob(".city.map.partial-*/tiles")), *build)
    assert code == -signal.SIGKILL
    assert not (out / "city.map").exists()
    refused(maxcon("map", "info", out / "city.map"), "no such folder")
    assert maxcon(*build).code == 0
    assert maxcon("map", "info", out / "city.map", "--check").code == 0


def test_where_there_is_no_hangup_nothing_waits_for_one(maxcon, monkeypatch):
    monkeypatch.delattr(signal, "SIGHUP")  # as on Windows
    ended = maxcon("--version")
    assert (ended.code, ended.err) == (0, "")


def test_what_ignores_hangups_goes_on(maxcon_process, build, out):
    script = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); from maxcon.cli import main; main()"
    with maxcon_process(*build, script=script) as process:
        while not list(out.glob(".city.map.partial-*")) and process.poll() is None:
            time.sleep(0.005)
        process.send_signal(signal.SIGHUP)
        process.communicate(timeout=600)
    assert process.returncode == 0
    assert sorted(path.name for path in out.iterdir()) == ["city.map"]


@pytest.mark.parametrize("error", ["SystemError('a result with an exception set')", "FileError('not complete')"])
def test_a_stop_that_became_another_error_on_its_way(maxcon_process, drive, tmp_path, error):
    script = f"""
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

maxcon.drive.localize.localize_drive = read
main()
"""
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior)
    with maxcon_process(*arguments, "-o", tmp_path / "poses.csv", script=script) as process:
        _, err = process.communicate(timeout=600)
    assert (process.returncode, err) == (128 + signal.SIGTERM, "")
    assert list(tmp_path.iterdir()) == []
