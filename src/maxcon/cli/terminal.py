"""What a command shows on stderr while it runs (bars, lines, that it compiles), and how signals end it."""

import signal
import sys
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from maxcon._system import Progress

SPEED_PERIOD = 600.0  # the time left is estimated from the last so many seconds: a step of a study may take a minute
COMPILING = "compiling, once after installation: up to a minute (`maxcon warmup` does it before)"
STOPPING = ("SIGINT", "SIGTERM", "SIGHUP")  # of Windows, which has no hangup, the first two
LOOK_EVERY = 0.1  # s between looks at whether the exception is still on its way


def warn(line: str) -> None:
    """Say on stderr what a command is at, or is waiting for."""
    print(line, file=sys.stderr, flush=True)  # noqa: T201


def print_rows(rows: Iterable[tuple[str, str]]) -> None:
    """Print names and words, a row each."""
    for name, text in rows:
        typer.echo(f"{name:<12} {text}")


def print_json(facts: dict[str, Any]) -> None:
    """Print facts as one JSON object, what is no finite number as null."""
    import msgspec

    typer.echo(msgspec.json.encode(facts).decode())


@contextmanager
def step_bars(is_quiet: bool, *, has_lines: bool = False) -> Iterator["Progress"]:
    """Yield what shows a bar for each step; where stderr is no terminal nothing, or a line with `has_lines`."""
    if is_quiet or not sys.stderr.isatty():
        told: set[str] = set()

        def tell(step: str, done: int, total: int) -> None:
            if has_lines and not is_quiet and step not in told:
                told.add(step)
                warn(f"{step} ...")

        yield tell
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn
    from rich.progress import Progress as Bars

    columns = list(Bars.get_default_columns())
    columns[2:3] = [MofNCompleteColumn()]
    bars = Bars(*columns, console=Console(stderr=True), speed_estimate_period=SPEED_PERIOD)
    tasks: dict[str, Any] = {}

    def report(step: str, done: int, total: int) -> None:
        if not tasks:
            bars.start()
        if step not in tasks:
            tasks[step] = bars.add_task(step, total=total)
        bars.update(tasks[step], completed=done, total=total)

    try:
        yield report
    finally:
        if tasks:
            bars.stop()


@contextmanager
def compiling_told(is_quiet: bool) -> Iterator[None]:
    """Say so, once, when something has to be compiled while this is open."""
    from maxcon._system.kernel_cache import on_compilation

    is_told = is_quiet or not sys.stderr.isatty()

    def tell() -> None:
        nonlocal is_told
        if not is_told:
            is_told = True
            typer.echo(COMPILING, err=True)

    with on_compilation(tell):
        yield


class Stop(SystemExit):
    """A signal has come: the exit code is that of a shell, 128 and its number."""

    is_told = False


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
