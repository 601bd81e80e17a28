# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Signals end the program by an exception, so that partial outputs are removed, even where one is swallowed."""

import signal
import sys
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["Stop", "stopping_in_order"]

STOPPING = ("SIGINT", "SIGTERM", "SIGHUP")
"""Of Windows, which has no hangup, the first two."""

LOOK_EVERY = 0.1
"""s between looks at whether the exception is still on its way."""


class Stop(SystemExit):
    """A signal has come: the exit code is that of a shell, 128 and its number."""


class _Signals:
    """What has come, and the exception that is on its way because of it."""

    def __init__(self) -> None:
        self.received: list[int] = []
        self._on_its_way: weakref.ref[Stop] | None = None

    def stop(self, number: int, frame: FrameType | None) -> None:
        self.received.append(number)
        if hasattr(signal, "setitimer"):
            signal.signal(signal.SIGALRM, self.look)
            signal.setitimer(signal.ITIMER_REAL, LOOK_EVERY, LOOK_EVERY)
        self.throw()

    def look(self, number: int, frame: FrameType | None) -> None:
        """Throw again what was swallowed: callbacks of code that is loaded let nothing through."""
        if self._on_its_way is None or self._on_its_way() is None:
            self.throw()

    def throw(self) -> None:
        thrown = Stop(128 + self.received[0])
        self._on_its_way = weakref.ref(thrown)
        try:
            raise thrown
        finally:
            del thrown  # else its own traceback would keep it

    def rest(self) -> None:
        if self.received and hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)


@contextmanager
def stopping_in_order() -> Iterator[list[int]]:
    """Let signals raise `Stop` while this is open; yield the numbers of those that came."""
    signals = _Signals()
    for number in (getattr(signal, name) for name in STOPPING if hasattr(signal, name)):
        # Not where it is ignored, as under nohup.
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, signals.stop)
    told = sys.unraisablehook

    def tell(what: Any) -> None:
        if not isinstance(what.exc_value, Stop):
            told(what)

    sys.unraisablehook = tell
    try:
        yield signals.received
    finally:
        signals.rest()
        sys.unraisablehook = told
