# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Workers of a dask cluster that somebody has started: found, watched, and left as they were."""

import gc
import logging
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from maxcon._system.job import Opening, close_jobs, do_task, workers_gone
from maxcon.errors import MissingExtraError, OptionError

if TYPE_CHECKING:
    from distributed import Client

JOIN_TIMEOUT = 30
"""s until a scheduler answers and has a worker."""
TOLD_AFTER = 1.0
"""s of waiting, until it is told."""
LONGEST_ALONE = 180.0
"""s without any worker until that is an error."""
TASKS_OF_WORKER = 3
"""The one in work, and two ahead."""


def check_dask() -> None:
    """Refuse to go on without dask; MissingExtraError if so."""
    if find_spec("distributed") is None:
        raise MissingExtraError(
            "Expected dask.distributed for workers of a cluster, but it is not installed: pip install 'maxcon[engine]'"
        )


@contextmanager
def joined_cluster(address: str, warn: Callable[[str], None]) -> Iterator["Cluster"]:
    """Yield the workers of the scheduler at an address; certificates are those of dask's own configuration.

    OptionError if there is no scheduler, or it has no workers; `warn` is called with a line where it is waited for.
    """
    from distributed import Client

    with _quiet():
        try:
            with _waiting_told("a scheduler", address, warn):
                _greet(address)
                client = Client(address, timeout=JOIN_TIMEOUT, set_as_default=False)
        except (OSError, TimeoutError, ValueError, TypeError, RuntimeError) as error:
            said = (getattr(error, "strerror", None) or str(error)).rstrip(".") or "no answer in time"
            raise OptionError(
                f"Expected a dask scheduler at {address}, got: {said}. Start one: dask scheduler --host 127.0.0.1, and"
                " name its address, as tcp://127.0.0.1:8786."
            ) from error
        with client:
            try:
                with _waiting_told("a worker", address, warn):
                    client.wait_for_workers(1, timeout=JOIN_TIMEOUT)
            except TimeoutError as error:
                raise OptionError(
                    f"Expected workers at {address}, but there is none after {JOIN_TIMEOUT} s. Start some: dask worker"
                    f" {address} --nthreads 1."
                ) from error
            cluster = Cluster(client)
            try:
                yield cluster
            finally:
                cluster.dismiss()


class Cluster:
    """The workers of a cluster, as `engine.Workers`: a task that ends four is told apart by the scheduler."""

    lost: type[Exception]
    allowed_deaths: int = 0

    def __init__(self, client: "Client") -> None:
        from distributed import KilledWorker

        self.lost = KilledWorker
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._last_seen = time.monotonic()

    @property
    def n_ahead(self) -> int:
        """Tasks to submit before the first is done."""
        return TASKS_OF_WORKER * max(1, len(self._addresses()))

    def submit(self, opening: Opening, task: Any) -> Future[Any]:
        """Let one of them do a task."""
        key = f"{opening.job.name}-{uuid.uuid4()}"
        future: Future[Any] = self._executor.submit(do_task, opening, task, key=key)
        return future

    def check(self) -> None:
        """Refuse to wait any longer where the scheduler or all workers are gone; MaxconError if so."""
        now = time.monotonic()
        if self._client.status in ("closed", "closing"):
            raise workers_gone("the scheduler is gone")
        if self._addresses():
            self._last_seen = now
        elif now - self._last_seen > LONGEST_ALONE:
            raise workers_gone(f"there has been none for {LONGEST_ALONE:.0f} s")

    def dismiss(self) -> None:
        """Let the workers let go of the job, each behind what it has in work."""
        from distributed import fire_and_forget

        self._executor.shutdown(wait=False)
        for address in self._addresses():
            fire_and_forget(self._client.submit(close_jobs, workers=[address], pure=False))

    def _addresses(self) -> list[str]:
        """Where the workers are that the scheduler knows; none while it does not answer."""
        try:
            return list(self._client.nthreads()) if self._client.status == "running" else []
        except (OSError, TimeoutError, CancelledError):
            return []


@contextmanager
def _waiting_told(what: str, address: str, warn: Callable[[str], None]) -> Iterator[None]:
    """Tell the user that something is waited for, if it takes a moment."""
    timer = threading.Timer(TOLD_AFTER, warn, [f"waiting up to {JOIN_TIMEOUT} s for {what} at {address}"])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _greet(address: str) -> None:
    """Connect to a scheduler and leave: a client would wait for ever at a port that takes connections and is silent."""
    import asyncio

    from distributed.comm import connect
    from distributed.security import Security
    from distributed.utils import LoopRunner

    async def greet() -> None:
        credentials = Security().get_connection_args("client")
        comm = await asyncio.wait_for(connect(address, timeout=JOIN_TIMEOUT, **credentials), JOIN_TIMEOUT)
        comm.abort()

    runner = LoopRunner()
    runner.start()
    try:
        runner.run_sync(greet)
    finally:
        runner.stop()


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what dask logs off stderr: a worker that ended is told by what becomes of its tasks."""
    import distributed  # noqa: F401 - sets levels of its own, when it is loaded

    parts = ("distributed", "tornado", "asyncio")
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in parts]
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        gc.collect()  # what is left of requests that nobody waits for is told when it is collected
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
