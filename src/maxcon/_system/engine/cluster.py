# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where tasks go: worker processes on this machine, started here, or a cluster that somebody has started."""

import gc
import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

from maxcon.errors import MaxconError, MissingExtraError, OptionError

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

__all__ = ["check_dask", "has_dask", "joined_cluster", "local_cluster"]

LOOPBACK = "127.0.0.1"
START_TIMEOUT = 120
"""s until something answers that was just started, perhaps on a busy machine."""
JOIN_TIMEOUT = 30
"""s for a cluster that is there already."""
REFUSED_TIMEOUT = 5
"""s in which a scheduler that was just started begins to listen: so long its host refuses connections."""
TOLD_AFTER = 1.0
"""s of waiting, until it is told."""
ALLOWED_DEATHS = 3
"""Times that a task may end its worker and is given to another."""

# The libraries of a worker use one thread: there are as many workers as processors.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
SETTINGS = {
    "distributed.nanny.pre-spawn-environ": ONE_THREAD,
    "distributed.worker.profile.enabled": False,
    "distributed.comm.timeouts.connect": f"{START_TIMEOUT} s",
    "distributed.comm.timeouts.tcp": f"{START_TIMEOUT} s",
}


def has_dask() -> bool:
    """Whether the packages of the extra `engine` are there."""
    return all(find_spec(name) is not None for name in ("distributed", "cryptography"))


def check_dask() -> None:
    """Refuse to go on without them.

    Raises
    ------
    MissingExtraError
        If they are missing.
    """
    if not has_dask():
        raise MissingExtraError(
            "Expected dask.distributed for several processes, but it is not installed: pip install 'maxcon[engine]'"
        )


@contextmanager
def local_cluster(n_workers: int) -> "Iterator[tuple[Client, LocalCluster, str]]":
    """Start workers on this machine; yield the client, the cluster, and where a browser finds its dashboard.

    They listen on the loopback interface only, and to those alone who hold the certificate that was made for them:
    what dask sends is unpickled, and any user of the machine could reach the ports. The dashboard shows and takes no
    orders. It is "" where bokeh is not installed.

    Raises
    ------
    MaxconError
        If they do not start.
    """
    import dask.config
    from distributed import Client, LocalCluster
    from distributed.security import Security

    with dask.config.set(SETTINGS), _quiet(), _environment_restored():
        try:
            with _interrupts_held_back():
                cluster = LocalCluster(
                    n_workers, threads_per_worker=1, host=LOOPBACK, security=Security.temporary(),
                    dashboard_address=f"{LOOPBACK}:0", silence_logs=logging.CRITICAL, memory_limit=0,
                    scheduler_kwargs={"allowed_failures": ALLOWED_DEATHS},
                )  # fmt: skip
        except (OSError, RuntimeError, TimeoutError) as error:
            raise MaxconError(
                f"Expected {n_workers} worker processes to start, got: {_words(error)}. A script needs its last lines"
                ' behind if __name__ == "__main__"; or memory is short: take fewer --workers.'
            ) from error
        with cluster, Client(cluster, timeout=START_TIMEOUT, set_as_default=False) as client:
            yield client, cluster, cluster.dashboard_link if find_spec("bokeh") is not None else ""


@contextmanager
def joined_cluster(address: str, warn: Callable[[str], None]) -> "Iterator[Client]":
    """Yield a client of the scheduler at an address; certificates are those of dask's own configuration.

    Parameters
    ----------
    address : str
        Of the scheduler.
    warn : callable
        Called with a line for the user where it has to be waited for.

    Raises
    ------
    OptionError
        If there is none, or it has no workers.
    """
    from distributed import Client

    with _quiet():
        with _waiting_told("a scheduler", address, warn):
            _check_listens(address)
            _check_answers(address)
        try:
            client = Client(address, timeout=JOIN_TIMEOUT, set_as_default=False)
        except (OSError, TimeoutError, RuntimeError) as error:
            raise _no_scheduler(address, error) from error
        with client:
            try:
                with _waiting_told("a worker", address, warn):
                    client.wait_for_workers(1, timeout=JOIN_TIMEOUT)
            except TimeoutError as error:
                raise OptionError(
                    f"Expected workers at {address}, but there is none after {JOIN_TIMEOUT} s. Start some: dask worker"
                    f" {address} --nthreads 1."
                ) from error
            yield client


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


def _check_listens(address: str) -> None:
    """Refuse a host that is none, or on which nobody listens; what is no address is refused by dask.

    Dask itself tries again whatever the reason is, until its time is up.

    Raises
    ------
    OptionError
        If it is one.
    """
    from distributed.comm import get_address_host_port

    try:
        host, port = get_address_host_port(address)
    except (ValueError, TypeError, NotImplementedError):
        return
    end = time.monotonic() + min(REFUSED_TIMEOUT, JOIN_TIMEOUT)
    while True:
        try:
            with socket.create_connection((host, port), REFUSED_TIMEOUT):
                return
        except (ConnectionRefusedError, socket.gaierror) as error:
            if time.monotonic() > end:
                raise _no_scheduler(address, error) from error
        except ValueError as error:  # no name of a host
            raise _no_scheduler(address, error) from error
        except OSError:
            return
        time.sleep(0.1)


def _check_answers(address: str) -> None:
    """Refuse an address where no scheduler answers; a client would wait for ever at some.

    Raises
    ------
    OptionError
        If it is one.
    """
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
    except (OSError, TimeoutError, ValueError, TypeError, RuntimeError) as error:
        raise _no_scheduler(address, error) from error
    finally:
        runner.stop()


def _no_scheduler(address: str, error: Exception) -> OptionError:
    return OptionError(
        f"Expected a dask scheduler at {address}, got: {_words(error)}. Start one: dask scheduler --host"
        f" {LOOPBACK}, and name its address, as tcp://{LOOPBACK}:8786."
    )


def _words(error: Exception) -> str:
    """What an error says; time-outs say nothing."""
    return (getattr(error, "strerror", None) or str(error)).rstrip(".") or "no answer in time"


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what dask logs off stderr: a worker that ended is told by what becomes of its tasks."""
    import distributed  # noqa: F401 - sets levels of its own, when it is loaded

    parts = ("distributed", "tornado", "bokeh", "asyncio")
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


@contextmanager
def _environment_restored() -> Iterator[None]:
    """Take back what dask puts into the environment of this process, for the workers to find it."""
    before = {name: os.environ.get(name) for name in (*ONE_THREAD, "MALLOC_TRIM_THRESHOLD_")}
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Let threads and processes started here never hear what comes from the terminal: the caller answers it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing.resource_tracker import ensure_running

    ensure_running()  # the thread that starts it would listen to interrupts again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
