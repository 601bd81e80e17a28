# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A signal ends a command, also where its exception is swallowed; an error is one line, whatever a file is called."""

import signal
import time

import pytest

from maxcon.cli import one_line

pytestmark = pytest.mark.kills

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


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_that_is_swallowed_ends_the_command_all_the_same(maxcon_process, tmp_path, name):
    out = tmp_path / "a.map"
    with maxcon_process("map", "build", "a.npz", "-o", out, script=SWALLOWS.format(name=name)) as process:
        written, err = process.communicate(timeout=600)
    assert (process.returncode, written, err) == (128 + getattr(signal, name), "went on", "")
    assert list(tmp_path.iterdir()) == []


def test_cleaning_up_is_not_interrupted(maxcon_process):
    started = time.monotonic()
    with maxcon_process("map", "build", "a.npz", "-o", "a.map", script=CLEANS_UP) as process:
        written, err = process.communicate(timeout=600)
    assert (process.returncode, written, err) == (128 + signal.SIGTERM, "cleaned up\n", "")
    assert time.monotonic() - started > 1.0


def test_names_with_line_ends_stay_in_one_line(maxcon, refused, tmp_path):
    for name in ("a\nb.laz", "a\r\x1b[31mb.npz", "\u2028.ply"):
        refused(maxcon("map", "build", tmp_path / name, "-o", tmp_path / "a.map"), "no such file")
        (tmp_path / name).write_bytes(b"x")
        refused(maxcon("map", "build", tmp_path / name, "-o", tmp_path / "a.map"), "Expected")
    assert one_line("a\nb\x1b \u00e4") == "a\\nb\\x1b \u00e4"
