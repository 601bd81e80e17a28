# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The files of a map on an object store or a web server, through obstore (decision 28).

Every request has a time-out: a server that is gone is an error in a line, never a wait without end.
"""

import errno
import os
import re
from collections.abc import Callable, Sequence
from datetime import timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from maxcon.errors import MissingExtraError
from maxcon.map.storage.ahead import FetchAhead
from maxcon.map.storage.disk_cache import DiskCache
from maxcon.map.storage.record_place import RecordPlace

if TYPE_CHECKING:
    from obstore.store import ClientConfig, RetryConfig, S3Config

__all__ = ["Remote"]

CONNECT_SECONDS, READ_SECONDS, REQUEST_SECONDS = 5.0, 15.0, 120.0
"""Time-outs of a connection, between two pieces of an answer, and of a whole request."""
RETRIES, RETRY_SECONDS = 2, 20.0
"""How often a request is repeated, and for how long."""
NO_BUCKET = "no such bucket"
NO_RANGES = (
    "the server sends no ranges of files, by which tiles are read: serve the map by one that does, or copy its folder"
    " to this machine"
)
KEYS = "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
ANONYMOUS = "AWS_SKIP_SIGNATURE"
NO_KEYS = (
    f"no keys were found: set {KEYS} (AWS_SESSION_TOKEN too, where they are temporary), or {ANONYMOUS}=true for a"
    " bucket that anybody may read"
)
CAUSES = {
    NO_RANGES: r"Range request not supported",
    # A machine of Amazon would have them from there.
    NO_KEYS: r"169\.254\.169\.254|/latest/(api/token|meta-data)|instance metadata",
    f"half of the keys: set both, {KEYS}": r"Missing ?(SecretAccessKey|AccessKeyId)",
    "no permission": r"PermissionDenied|Forbidden|AccessDenied|\b403\b",
    "the server does not know these credentials": r"Unauthenticated|InvalidAccessKeyId|SignatureDoesNotMatch|\b401\b",
    "no server there: connection refused": r"[Cc]onnection ?refused",
    "the server does not answer: timed out": r"timed out|TimedOut|timeout",
    "no server of this name": r"dns error|failed to lookup",
}
"""Words for the user, by a pattern in the message of an error."""
SECRETS = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN")
"""Environment variables whose values no message has."""
Answer = TypeVar("Answer")


class Remote:
    """The files of a map behind an address.

    Parameters
    ----------
    address : str
        `s3://bucket/prefix`, `http://server/path` or `https://server/path`.
    cache : DiskCache or None
        Where records are kept on this machine; None for nowhere.

    Raises
    ------
    MissingExtraError
        If obstore is not installed.
    """

    def __init__(self, address: str, cache: DiskCache | None) -> None:
        try:
            import obstore
        except ImportError as error:
            raise MissingExtraError(
                f"Expected the package obstore, to read {address}, but it is not installed."
                " Install it: pip install 'maxcon[remote]'."
            ) from error
        self._obstore = obstore
        self._address = address
        self._cache = cache
        self._is_s3 = address.startswith("s3:")
        self._has_ranges = False
        """Whether a web server has sent one."""
        self._ahead = FetchAhead(self._fetch, self._keep)

    @property
    def remedy(self) -> str:
        """What helps where a file cannot be read, for messages."""
        return "Check the server and the address, and try again."

    def where(self, name: str) -> str:
        """Return the file's address."""
        return f"{self._address}/{name}" if name else self._address

    def what_is_there(self, name: str, error: OSError) -> str:
        """Return what there is instead of a file that was not found, in words for a message."""
        return error.strerror if error.strerror == NO_BUCKET else f"no {name} there"

    def read(self, name: str, most_bytes: int) -> memoryview:
        """Return all of a file; the first of a web server also tells whether ranges of files can be had there.

        Raises
        ------
        OSError
            If it cannot be read, is larger than `most_bytes`, or there are no ranges.
        """

        def read() -> memoryview:
            result = self._obstore.get(self._store, name)
            if result.meta["size"] > most_bytes:
                raise OSError(errno.EFBIG, f"{result.meta['size']:,} bytes, more than there can be in it")
            return memoryview(result.bytes())

        content = self._asked(read)
        if not (self._is_s3 or self._has_ranges) and len(content):
            self._asked(lambda: self._obstore.get_range(self._store, name, start=0, length=1))
            self._has_ranges = True
        return content

    def read_record(self, place: RecordPlace) -> memoryview:
        """Return the bytes of a record: kept on this machine, announced before, or fetched now.

        Raises
        ------
        OSError
            If they cannot be read.
        """
        return self._ahead.take(place)

    def announce(self, places: Sequence[RecordPlace]) -> None:
        """Fetch records in the background that will be read soon, unless they are kept on this machine."""
        cache = self._cache
        self._ahead.announce([place for place in places if cache is None or not cache.has(place)])

    def write(self, name: str, content: bytes | Path) -> None:
        """Write a file, or replace it, in one step.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        self._asked(lambda: self._obstore.put(self._store, name, content))

    def size(self, name: str) -> int | None:
        """Return the size of a file, bytes; None if there is none.

        Raises
        ------
        OSError
            If the server does not tell.
        """
        try:
            return int(self._asked(lambda: self._obstore.head(self._store, name))["size"])
        except FileNotFoundError:
            return None

    def _fetch(self, place: RecordPlace) -> memoryview:
        kept = self._cache.get(place) if self._cache is not None else None
        if kept is not None:
            return kept
        return self._asked(
            lambda: memoryview(
                self._obstore.get_range(self._store, place.name, start=place.offset, length=place.length)
            )
        )

    def _keep(self, place: RecordPlace, content: memoryview) -> None:
        """Put a record into the cache; a damaged one is noticed when it is read, and fetched again."""
        if self._cache is not None and not self._cache.has(place):
            self._cache.put(place, content)

    @cached_property
    def _store(self) -> Any:
        """The store of obstore, made when first used."""
        from obstore.store import HTTPStore, S3Store

        endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL", "")
        client: ClientConfig = {
            "connect_timeout": timedelta(seconds=CONNECT_SECONDS),
            "read_timeout": timedelta(seconds=READ_SECONDS),
            "timeout": timedelta(seconds=REQUEST_SECONDS),
            "allow_http": (endpoint if self._is_s3 else self._address).startswith("http:"),
        }
        retry: RetryConfig = {"max_retries": RETRIES, "retry_timeout": timedelta(seconds=RETRY_SECONDS)}
        if not self._is_s3:
            return HTTPStore(self._address, client_options=client, retry_config=retry)
        config: S3Config = {"endpoint": endpoint} if endpoint else {}
        return S3Store.from_url(self._address, config=config, client_options=client, retry_config=retry)

    def _asked(self, ask: Callable[[], Answer]) -> Answer:
        """Return the answer of the server; its errors become OSError with words for the user."""
        from obstore.exceptions import BaseError

        try:
            return ask()
        except FileNotFoundError as error:
            missing = NO_BUCKET if "NoSuchBucket" in str(error) else os.strerror(errno.ENOENT)
            raise FileNotFoundError(errno.ENOENT, missing) from None
        except (BaseError, ValueError) as error:
            raise OSError(errno.EIO, _in_words(error, is_s3=self._is_s3)) from None


def _in_words(error: Exception, *, is_s3: bool) -> str:
    """Return the cause of an error of obstore in one line, without what is secret."""
    text = " ".join(str(error).split())
    words = next((words for words, pattern in CAUSES.items() if re.search(pattern, text)), "")
    if words == "no permission" and is_s3:
        is_anonymous = os.environ.get(ANONYMOUS, "").lower() in ("1", "true", "yes", "on", "y")
        without = f"without keys, as {ANONYMOUS} asks for: set {KEYS} instead"
        return f"{words} {without}" if is_anonymous else f"{words}: check AWS_ACCESS_KEY_ID and its rights"
    for name in SECRETS:
        text = text.replace(os.environ.get(name) or name, name)
    return words or text[:200]
