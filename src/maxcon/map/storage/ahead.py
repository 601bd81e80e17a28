# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""FetchAhead: records that will be asked for soon are fetched in the background, several at a time."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from queue import SimpleQueue

from maxcon.map.storage.record_place import RecordPlace

__all__ = ["FetchAhead"]

N_THREADS = 8
MOST_BYTES = 2**28
"""Most bytes of announced records that were not asked for yet; beyond that the oldest are given up."""


class FetchAhead:
    """Fetches records in the background. Its threads end with the process, whatever they wait for.

    Parameters
    ----------
    fetch : callable
        Returns the bytes of a record. What it raises is raised again by whoever asks for the record.
    keep : callable
        Called with a record and its bytes after they were fetched. What it raises is raised by whoever asks next.
    """

    def __init__(
        self, fetch: Callable[[RecordPlace], memoryview], keep: Callable[[RecordPlace, memoryview], None]
    ) -> None:
        self._fetch = fetch
        self._keep = keep
        self._not_kept: Exception | None = None
        self._begun: OrderedDict[RecordPlace, Future[memoryview]] = OrderedDict()
        self._n_bytes = 0
        self._queue: SimpleQueue[tuple[RecordPlace, Future[memoryview]]] = SimpleQueue()
        self._lock = threading.Lock()
        self._n_threads = 0

    def announce(self, places: Sequence[RecordPlace]) -> None:
        """Begin to fetch records; those that were announced before are not fetched twice."""
        with self._lock:
            for place in places:
                if place in self._begun:
                    self._begun.move_to_end(place)
                    continue
                future: Future[memoryview] = Future()
                self._begun[place] = future
                self._n_bytes += place.length
                self._queue.put((place, future))
            while self._n_bytes > MOST_BYTES:
                given_up, future = self._begun.popitem(last=False)
                future.cancel()
                self._n_bytes -= given_up.length
            while self._n_threads < min(N_THREADS, len(self._begun)):
                threading.Thread(target=self._work, name="tiles ahead", daemon=True).start()
                self._n_threads += 1

    def take(self, place: RecordPlace) -> memoryview:
        """Return the bytes of a record, waiting for them if needed.

        Raises
        ------
        OSError, FileError
            What `fetch` raises.
        """
        with self._lock:
            future = self._begun.pop(place, None)
            self._n_bytes -= place.length if future is not None else 0
            not_kept, self._not_kept = self._not_kept, None
        if not_kept is not None:
            raise not_kept
        if future is not None and not future.cancel():  # else nobody has begun with it
            return future.result()
        content = self._fetch(place)
        self._keep(place, content)
        return content

    def _work(self) -> None:
        while True:
            place, future = self._queue.get()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                content = self._fetch(place)
            except Exception as error:  # noqa: BLE001 - raised again by who asks for the record
                future.set_exception(error)
                continue
            future.set_result(content)
            try:
                self._keep(place, content)
            except Exception as error:  # noqa: BLE001 - raised again by who asks next
                self._not_kept = error
