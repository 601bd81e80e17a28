# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A few hundred mutated files go through every reader; and what a reader could do wrong is noticed."""
# ruff: noqa: E402 - what is skipped is skipped before it is imported

import subprocess
import sys
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("the fuzzer limits memory as Linux does", allow_module_level=True)
for package in ("rosbags", "mcap", "velodyne_decoder", "pypcd4", "pye57", "embreex"):
    pytest.importorskip(package, reason=f"a reader's package is not installed: {package}")

from fuzz_mutations import mutated
from fuzz_readers import READERS
from fuzz_seeds import Seed, make_seeds
from fuzz_watch import watched
from fuzz_worker import input_of, outcome

from maxcon.errors import FileError

pytestmark = pytest.mark.fuzzing
FOLDER = Path(__file__).parent
SEED = Seed("made here", "times", "times.txt", b"1.5\n2.5\n")


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seeds")
    return folder, make_seeds(folder)


def test_seeds_of_every_reader_are_read(seeds):
    folder, made = seeds
    assert {seed.reader for seed in made} == set(READERS)
    for seed in made:
        assert outcome(seed, seed.data, folder) == "read", seed.label


def test_inputs_are_the_same_each_time_and_nearly_all_differ_from_their_seed(seeds):
    _, made = seeds
    inputs = [input_of(made, 3, number) for number in range(300)]
    assert inputs == [input_of(made, 3, number) for number in range(300)]
    assert sum(data != seed.data for seed, data in inputs) > 270


def test_a_few_hundred_inputs_are_read_or_refused():
    command = [sys.executable, FOLDER, "--inputs", "600", "--seed", "1"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.splitlines()[-1].startswith("600 inputs")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (FileError("Expected points, got none."), "refused"),
        (FileError("Expected points,\ngot none."), "a message of several lines"),
        (ValueError("odd"), "ValueError at "),
        (MemoryError(), "MemoryError at "),
        (SystemExit(3), "SystemExit at "),
    ],
    ids=repr,
)
def test_what_is_raised_is_told_apart(monkeypatch, tmp_path, error, said):
    def read(*_):
        raise error

    monkeypatch.setitem(READERS, "times", read)
    assert outcome(SEED, SEED.data, tmp_path).startswith(said)
    assert list(tmp_path.iterdir()) == []


WORKER = """
import os, sys, time
sys.path.insert(0, {folder!r})
from pathlib import Path
from fuzz_readers import READERS
from fuzz_worker import work_off
from fuzz_seeds import Seed
seen = []
def read(*_):
    seen.append(1)
    if len(seen) == 4:
        {harm}
READERS["times"] = read
work_off([Seed("made here", "times", "times.txt", b"1.5")], 0, range(20), Path({work!r}), sys.stdout)
"""


@pytest.mark.parametrize(
    ("harm", "limit", "said", "n_said"),
    [
        ("time.sleep(600)", 4.0, "no answer within 4 s", 3),
        ("os.abort()", 120.0, "the process ended with -6", 3),
        ("bytearray(2**34)", 120.0, "MemoryError at ", 20),
        ("b'x' * (2**30 + 2**27)", 120.0, "read, and took 1.1 GiB", 20),
    ],
)
def test_hangs_ends_and_memory_are_noticed(tmp_path, harm, limit, said, n_said):
    script = WORKER.format(folder=str(FOLDER), harm=harm, work=str(tmp_path))
    all_said = list(watched([sys.executable, "-c", script], limit=limit))
    found = [each for each in all_said if not each.is_fine]
    assert [each.number for each in found] == [2]  # the seed itself is read first
    assert found[0].words.startswith(said)
    assert len(all_said) == n_said


def test_memory_that_was_wanting_is_not_a_refusal(monkeypatch, tmp_path):
    def read(*_):
        try:
            raise MemoryError
        except MemoryError as error:
            raise FileError("Expected a file, complete, got: MemoryError.") from error

    monkeypatch.setitem(READERS, "times", read)
    assert outcome(SEED, SEED.data, tmp_path) == "refused for want of memory"


def test_mutations_are_no_larger_than_their_limit():
    import random

    for number in range(200):
        assert len(mutated(bytes(300_000), [bytes(10)], random.Random(number))) <= 4 * 2**20
