# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Watching a process that reads one input after the other: what it says of each, and where it ends or hangs."""

import json
import select
import subprocess
import time
from collections.abc import Iterator
from typing import IO, NamedTuple

__all__ = ["LIMIT", "Said", "watched"]

LIMIT = 10.0
START_LIMIT = 120.0


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


def watched(command: list[str], limit: float = LIMIT) -> Iterator[Said]:
    """Yield what a process says of each input; the last is that at which it ended, or had no answer in time."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    lines, number, line, allowed = _Lines(process.stdout), None, "", START_LIMIT
    try:
        while line := lines.next(allowed):
            if line.startswith("["):
                yield Said(number, *json.loads(line))
                number = None
            else:
                number = int(line)
            allowed = limit
    finally:
        process.kill()
        process.stdout.close()
        code = process.wait()
    if number is not None:
        words = f"no answer within {limit:g} s" if line is None else f"the process ended with {code}"
        yield Said(number, "of a process", "", words, limit if line is None else 0.0)
    elif line is None:
        raise SystemExit("The process that reads did not begin in time.")


class _Lines:
    """Lines of a pipe, with a limit of time; "" at its end, None when there is none in time."""

    def __init__(self, pipe: IO[bytes]) -> None:
        self._pipe, self._held = pipe, b""

    def next(self, seconds: float) -> str | None:
        """Return the next line."""
        end = time.monotonic() + seconds
        while b"\n" not in self._held:
            ready, _, _ = select.select([self._pipe], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                return None
            part = self._pipe.read1(65536)
            if not part:
                return ""
            self._held += part
        line, _, self._held = self._held.partition(b"\n")
        return line.decode()
