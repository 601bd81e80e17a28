"""Mutated inputs, read one after the other in a process with little memory, and the watch over that process."""

import os
import random
import resource
import shutil
import tempfile
import time
import traceback
import warnings
import zlib
from collections.abc import Callable, Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from fuzz_mutations import mutated
from fuzz_readers import READERS
from fuzz_seeds import Seed

from maxcon.errors import MaxconError

LIMIT, START_LIMIT = 10.0, 120.0
"""s for an input, and until the first."""
MEMORY, ADDRESSES = 2**30, 2**33
"""Bytes more than before an input: of memory that is used, and that is asked for. A buffer for what a file claims is
asked for, and used as far as the file goes."""


class Said(NamedTuple):
    """What came of an input."""

    number: int
    reader: str
    label: str
    words: str
    seconds: float

    @property
    def is_fine(self) -> bool:
        """Whether it was read, or refused in words."""
        return self.words in ("read", "refused")


def watched(work: Callable[..., None], *arguments: Any, limit: float = LIMIT) -> Iterator[Said]:
    """Yield what `work`, such as `work_off`, says of each input in a process of its own, which is told to it first.

    The last is the input at which the process ended, or had no answer in time.
    """
    context = get_context("spawn")  # threads of decompressors do not live on after a fork
    said, told = context.Pipe(duplex=False)
    process = context.Process(target=work, args=(told, *arguments), daemon=True)
    process.start()
    told.close()
    number, words, allowed = None, f"no answer within {limit:g} s", START_LIMIT
    try:
        while said.poll(allowed):
            allowed, message = limit, said.recv()
            if isinstance(message, int):
                number = message
            else:
                yield Said(number, *message)
                number = None
    except EOFError:
        process.join()
        words = f"the process ended with {process.exitcode}"
    finally:
        process.kill()
        process.join()
    if number is not None:
        yield Said(number, "of a process", "", words, limit)
    elif process.exitcode != 0:
        raise SystemExit("The process that reads did not begin.")


def work_off(told: Connection, seeds: list[Seed], seed: int, numbers: range, folder: Path) -> None:
    """Read the inputs of these numbers; each is told by its number when it begins, and by its outcome."""
    warnings.simplefilter("ignore")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries print
    for each in {seed.reader: seed for seed in seeds}.values():
        outcome(each, each.data, folder)  # loads libraries before memory is limited
    _peak()
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + ADDRESSES, held + ADDRESSES))
    for number in numbers:
        told.send(number)
        chosen, data = input_of(seeds, seed, number)
        before, began = _peak(), time.perf_counter()
        words = outcome(chosen, data, folder)
        seconds, taken = time.perf_counter() - began, _peak() - before
        if taken > MEMORY:
            words = f"{words}, and took {taken / MEMORY:.1f} GiB"
        told.send((chosen.reader, chosen.label, words, round(seconds, 3)))


def input_of(seeds: list[Seed], seed: int, number: int) -> tuple[Seed, bytes]:
    """Return which seed an input is made of, and its bytes; the same ones for the same numbers."""
    rng = random.Random(zlib.crc32(f"{seed} {number}".encode()))
    chosen = seeds[number % len(seeds)]
    return chosen, mutated(chosen.data, [other.data for other in seeds if other.reader == chosen.reader], rng)


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
        last = ([frame for frame in frames if "maxcon" in Path(frame.filename).parts] or frames)[-1]
        return f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {str(error)[:120]!r}"
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
