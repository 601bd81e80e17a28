"""Over a thousand mutated files go through every reader; and what a reader could do wrong is noticed."""
# ruff: noqa: E402 - what is skipped is skipped before it is imported

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("the fuzzer limits memory as Linux does", allow_module_level=True)
for package in ("rosbags", "mcap", "velodyne_decoder", "pypcd4", "pye57", "embreex"):
    pytest.importorskip(package, reason=f"a reader's package is not installed: {package}")

from fuzz_mutations import LARGEST
from fuzz_readers import READERS
from fuzz_seeds import Seed, make_seeds
from fuzz_watch import input_of, outcome, watched, work_off

from maxcon.errors import FileError

pytestmark = pytest.mark.fuzzing
SEED = Seed("made here", "times", "times.txt", b"1.5\n2.5\n")
HARMS = {
    "hangs": lambda: time.sleep(600), "ends": os.abort, "asks": lambda: bytearray(2**34),
    "takes": lambda: b"x" * (2**30 + 2**27),
}  # fmt: skip


def test_seeds_are_read_and_inputs_of_them_are_the_same_each_time(tmp_path):
    made = make_seeds(tmp_path)
    assert {seed.reader for seed in made} == set(READERS)
    for seed in made:
        assert outcome(seed, seed.data, tmp_path) == "read", seed.label
    inputs = [input_of(made, 3, number) for number in range(300)]
    assert inputs == [input_of(made, 3, number) for number in range(300)]
    assert sum(data != seed.data for seed, data in inputs) > 270
    assert max(len(data) for _, data in inputs) <= LARGEST


def test_over_a_thousand_inputs_are_read_or_refused():
    command = [sys.executable, Path(__file__).parent, "--inputs", "1500", "--seed", "1"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.splitlines()[-1].startswith("1,500 inputs")


def of_memory():
    error = FileError("Expected a file, complete, got: MemoryError.")
    error.__cause__ = MemoryError()
    return error


@pytest.mark.parametrize(("error", "said"), [
    (FileError("Expected points, got none."), "refused"),
    (FileError("Expected points,\ngot none."), "a message of several lines"),
    (of_memory(), "refused for want of memory"),
    (SystemExit(3), "SystemExit at "),
], ids=repr)  # fmt: skip
def test_what_is_raised_is_told_apart(monkeypatch, tmp_path, error, said):
    def read(*_):
        raise error

    monkeypatch.setitem(READERS, "times", read)
    assert outcome(SEED, SEED.data, tmp_path).startswith(said) and list(tmp_path.iterdir()) == []


def harmful_work(told, harm, folder):
    """Read twenty inputs; the third is harmful, behind the seed itself, which is read first."""
    seen = []

    def read(*_):
        seen.append(1)
        if len(seen) == 4:
            HARMS[harm]()

    READERS["times"] = read
    work_off(told, [SEED], 0, range(20), folder)


@pytest.mark.parametrize(("harm", "limit", "said", "n_said"), [
    ("hangs", 4.0, "no answer within 4 s", 3),
    ("ends", 120.0, "the process ended with -6", 3),
    ("asks", 120.0, "MemoryError at ", 20),
    ("takes", 120.0, "read, and took 1.1 GiB", 20),
])  # fmt: skip
def test_hangs_ends_and_memory_are_noticed(tmp_path, harm, limit, said, n_said):
    all_said = list(watched(harmful_work, harm, tmp_path, limit=limit))
    (found,) = (each for each in all_said if not each.is_fine)
    assert found.number == 2 and found.words.startswith(said)
    assert len(all_said) == n_said
