"""Workers of a dask cluster that somebody has started: found, watched, and left as they were."""

import asyncio
import gc
import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from maxcon.errors import OptionError

if TYPE_CHECKING:
    from distributed import Client

JOIN_TIMEOUT = 30  # s until a scheduler answers, and until it has a worker
LONGEST_ALONE = 180.0  # s without any worker until that is an error
TASKS_OF_WORKER = 3  # the one in work, and two ahead


@contextmanager
def joined_cluster(address: str, close: Callable[[], None], warn: Callable[[str], None] | None) -> Iterator["Cluster"]:
    """Yield the workers of the scheduler at an address, each of which calls `close` in the end."""
    from distributed import Client, fire_and_forget

    with _quiet(), ExitStack() as stack:
        try:
            _greet(address)
            client = stack.enter_context(Client(address, timeout=JOIN_TIMEOUT, set_as_default=False))
            if warn is not None and not client.nthreads():
                warn(f"waiting up to {JOIN_TIMEOUT} s for a worker at {address}")
            client.wait_for_workers(1, timeout=JOIN_TIMEOUT)
        except (OSError, TimeoutError, ValueError, TypeError, RuntimeError) as error:
            said = str(error).rstrip(".") or "no answer in time"
            raise OptionError(
                f"Expected a dask scheduler with workers at {address}, got: {said}. Start them: dask scheduler --host"
                " 127.0.0.1, then dask worker tcp://127.0.0.1:8786 --nthreads 1, and name that address."
            ) from error
        cluster = Cluster(client)
        try:
            yield cluster
        finally:
            cluster.executor.shutdown(wait=False)
            for worker in cluster.addresses():
                fire_and_forget(client.submit(close, workers=[worker], pure=False))


class Cluster:
    """The workers of a cluster, used as `engine.Processes`: dask itself reports a task that ends four of them."""

    allowed_deaths = 0

    def __init__(self, client: "Client") -> None:
        from distributed import KilledWorker

        self.lost: type[Exception] = KilledWorker
        self.executor = client.get_executor(pure=False)
        self.submit: Callable[..., Future[Any]] = self.executor.submit
        self._client = client
        self._last_seen = time.monotonic()

    @property
    def n_ahead(self) -> int:
        """Tasks to submit before the first is done."""
        return TASKS_OF_WORKER * max(1, len(self.addresses()))

    def gone(self) -> str:
        """Say why no result is waited for any longer: the scheduler or all workers are gone. Empty if they are not."""
        if self._client.status in ("closed", "closing"):
            return "the scheduler is gone"
        if self.addresses():
            self._last_seen = time.monotonic()
        is_alone = time.monotonic() - self._last_seen > LONGEST_ALONE
        return f"there has been none for {LONGEST_ALONE:.0f} s" if is_alone else ""

    def addresses(self) -> list[str]:
        """Return where the workers are that the scheduler knows; none while it does not answer."""
        try:
            return list(self._client.nthreads()) if self._client.status == "running" else []
        except (OSError, TimeoutError, CancelledError):
            return []


def _greet(address: str) -> None:
    """Connect to a scheduler and leave: a client would wait for ever at a port that takes connections and is silent."""
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
    loggers = [logging.getLogger(name) for name in [*logging.root.manager.loggerDict] if name.split(".")[0] in parts]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        gc.collect()  # what is left of requests that nobody waits for is told when it is collected
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
