# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Inputs one after the other in a process with little memory: what is said of each goes to the parent, line by line."""

import json
import random
import resource
import shutil
import tempfile
import time
import traceback
import warnings
import zlib
from pathlib import Path
from typing import TextIO

from fuzz_mutations import mutated
from fuzz_readers import READERS
from fuzz_seeds import Seed

from maxcon.errors import MaxconError

__all__ = ["input_of", "outcome", "work_off"]

MEMORY, ADDRESSES = 2**30, 2**33
"""Bytes more than before an input: of memory that is used, and that is asked for. A buffer for what a file claims is
asked for, and used as far as the file goes."""


def input_of(seeds: list[Seed], seed: int, number: int) -> tuple[Seed, bytes]:
    """Return which seed an input is made of, and its bytes; the same ones for the same numbers."""
    rng = random.Random(zlib.crc32(f"{seed} {number}".encode()))
    chosen = seeds[number % len(seeds)]
    others = [other.data for other in seeds if other.reader == chosen.reader]
    return chosen, mutated(chosen.data, others, rng)


def outcome(chosen: Seed, data: bytes, folder: Path) -> str:
    """Read an input; return "read", "refused", or what came instead: a kind of exception, and where it began."""
    work = Path(tempfile.mkdtemp(prefix="input", dir=folder))
    try:
        READERS[chosen.reader](data, chosen.name, work, folder)
    except MaxconError as error:
        if len(str(error).splitlines()) != 1:
            return "a message of several lines"
        return "refused for want of memory" if _is_of_memory(error) else "refused"
    except BaseException as error:  # noqa: BLE001 - whatever it is, it is a finding
        frames = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in frames if "maxcon" in Path(frame.filename).parts] or frames
        last = ours[-1]
        place = f"{Path(last.filename).name}:{last.lineno}"
        return f"{type(error).__name__} at {place}: {str(error)[:120]!r}"
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return "read"


def _is_of_memory(error: BaseException | None) -> bool:
    """Whether an error was made of a MemoryError: with more memory, more of it would have been taken."""
    while error is not None and not isinstance(error, MemoryError):
        error = error.__cause__ or error.__context__
    return error is not None


def _peak() -> int:
    """Return the most memory used since the last call, bytes; it begins anew with what is used now."""
    status = Path("/proc/self/status").read_text()
    Path("/proc/self/clear_refs").write_text("5")
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def work_off(seeds: list[Seed], seed: int, numbers: range, folder: Path, told: TextIO) -> None:
    """Read the inputs of these numbers; of each a line with its number when it begins, and one with its outcome."""
    warnings.simplefilter("ignore")
    for each in {seed.reader: seed for seed in seeds}.values():
        outcome(each, each.data, folder)  # loads libraries before memory is limited
    _peak()
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + ADDRESSES, held + ADDRESSES))
    for number in numbers:
        print(number, file=told, flush=True)
        chosen, data = input_of(seeds, seed, number)
        before, began = _peak(), time.perf_counter()
        said = outcome(chosen, data, folder)
        seconds, taken = time.perf_counter() - began, _peak() - before
        if taken > MEMORY:
            said = f"{said}, and took {taken / MEMORY:.1f} GiB"
        print(json.dumps([chosen.reader, chosen.label, said, round(seconds, 3)]), file=told, flush=True)
