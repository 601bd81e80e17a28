# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Crew: the workers of a cluster at one job; who ends is told apart from who was at work beside it."""

import time
import uuid
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from itertools import chain
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from maxcon._system.engine.job import Job
from maxcon._system.engine.worker import Errand, Opening, close_jobs
from maxcon.errors import MaxconError

if TYPE_CHECKING:
    from distributed import Client, Future, LocalCluster

__all__ = ["Crew"]

TASKS_AHEAD = 2
"""Tasks sent ahead of those in work, per worker: enough to keep it busy, few enough to stop at once."""
LOOK_EVERY = 1.0
"""s between looks at whether anybody is still there."""
FETCH_TIMEOUT = 60.0
"""s until a result that is ready should be here."""
LONGEST_ALONE = 180.0
"""s without any worker until that is said."""
LOST = "each worker that was given it ended: it crashes, or memory is short"


class Crew:
    """Gives tasks of a job to the workers of a cluster.

    Parameters
    ----------
    client : distributed.Client
        Of the cluster.
    job : Job
        What is to be done.
    cluster : distributed.LocalCluster, optional
        The cluster, if it was started for this job: workers that do not come back are replaced.
    """

    def __init__(self, client: "Client", job: Job[Any, Any], cluster: "LocalCluster | None" = None) -> None:
        self._client = client
        self._cluster = cluster
        self._job = job
        self._opening = Opening(uuid.uuid4().hex, job)
        self._n_workers = self._count()
        self._last_look = self._last_seen = time.monotonic()
        self._ended: SimpleQueue[Future[Any]] = SimpleQueue()
        self._begun: dict[Future[Any], Any] = {}

    def results(self, tasks: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
        """Yield each task, or the parts of one that was split, with its result.

        Raises
        ------
        MaxconError
            What the job raises; or if there are no workers any more.
        """
        suspects: list[Any] = []
        waiting = iter(tasks)
        while True:
            for task in waiting:
                self._send(task)
                if len(self._begun) >= (1 + TASKS_AHEAD) * max(1, self._n_workers):
                    break
            if not self._begun:
                break
            task, result, is_lost = self._next()
            if is_lost:  # by this task, or by the one that its workers had in work
                suspects.append(task)
            else:
                yield task, result
        for task in chain.from_iterable(self._job.split(task) for task in suspects):
            self._send(task)
            _, result, is_lost = self._next()
            yield task, self._job.lost(task, LOST) if is_lost else result

    def dismiss(self) -> None:
        """Let workers that live on let go of the job, each behind what it has in work."""
        from distributed import fire_and_forget

        if self._client.status == "running":
            for address in self._client.scheduler_info(n_workers=-1)["workers"]:
                key = f"close-{uuid.uuid4()}"
                fire_and_forget(self._client.submit(close_jobs, key=key, workers=[address], pure=False))

    def _send(self, task: Any) -> None:
        key = f"{self._job.name}-{uuid.uuid4()}"
        future = self._client.submit(Errand(self._opening, task), key=key, pure=False)
        self._begun[future] = task
        future.add_done_callback(self._ended.put)

    def _next(self) -> tuple[Any, Any, bool]:
        """Wait for a task to end; return it, its result, and whether it has ended all workers it was given to."""
        from distributed import KilledWorker

        future = None
        while future is None:
            with suppress(Empty):
                future = self._ended.get(timeout=LOOK_EVERY)
            if time.monotonic() - self._last_look > LOOK_EVERY:
                self._look_around()
        task = self._begun.pop(future)
        try:
            return task, self._fetched(future), False
        except KilledWorker:
            return task, None, True
        except CancelledError as error:
            raise self._is_gone("the scheduler is gone") from error

    def _fetched(self, future: "Future[Any]") -> Any:
        """Fetch the result of a task; it is done once more where its worker has gone with it."""
        while True:
            try:
                return future.result(timeout=FETCH_TIMEOUT)
            except TimeoutError:
                if future.status == "error":  # the job's own
                    raise
                self._look_around()

    def _count(self) -> int:
        """How many workers the scheduler knows; none while it does not answer."""
        try:
            return len(self._client.scheduler_info(n_workers=-1)["workers"])
        except (OSError, TimeoutError):
            return 0

    def _look_around(self) -> None:
        """See how many workers there are; wait for those that were started here, but not for ever."""
        if self._client.status in ("closed", "closing"):
            raise self._is_gone("the scheduler is gone")
        self._n_workers, now = self._count(), time.monotonic()
        self._last_look = now
        if self._n_workers:
            self._last_seen = now
        elif now - self._last_seen > LONGEST_ALONE:
            raise self._is_gone(f"there has been none for {LONGEST_ALONE:.0f} s")
        if self._cluster is not None:
            self._cluster.scale(len(self._cluster.worker_spec))

    @staticmethod
    def _is_gone(what: str) -> MaxconError:
        return MaxconError(
            f"Expected the workers to live on, but {what}. What is done is kept: the same command goes on."
        )
