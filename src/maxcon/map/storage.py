"""Storage of a map: a folder of this machine, or an object store or a web server through obstore.

Every request has a time-out: a server that is gone is an error in a line, never a wait without end.
"""

import errno
import os
import re
from collections.abc import Callable
from datetime import timedelta
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

from maxcon._system.regular_file import open_regular, read_regular
from maxcon.errors import OptionError, needs_extra

ADDRESS = re.compile(r"(s3|https?):/{1,2}(?=[^/])")  # how an address begins; a `Path` of one has lost a slash
ANY_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/(/|$)|(s3|https?|gs|ftp|file):(/|$)")
"""How names begin that mean an address of any kind, not a folder."""
CONNECT_SECONDS, READ_SECONDS, REQUEST_SECONDS = 5.0, 15.0, 120.0
"""Time-outs of a connection, between two pieces of an answer, and of a whole request."""
RETRIES, RETRY_SECONDS = 2, 20.0  # how often a request is repeated, and for how long
KEYS, ANONYMOUS = "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY", "AWS_SKIP_SIGNATURE"
CAUSES = {
    "the server sends no ranges of files, by which tiles are read: serve the map by one that does, or copy its folder"
    " to this machine": r"Range request not supported",
    # A machine of Amazon would have them from there.
    f"no keys were found: set {KEYS} (AWS_SESSION_TOKEN too, where they are temporary), or {ANONYMOUS}=true for a"
    " bucket that anybody may read": r"169\.254\.169\.254|/latest/(api/token|meta-data)|instance metadata",
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


class ByteRange(NamedTuple):
    """Bytes of a file of a map: its name, the first byte, and how many."""

    name: str
    offset: int
    length: int


def address_of(name: str | os.PathLike[str]) -> str | None:
    """Return a name as an address, `s3://`, `http://` or `https://`; None if it is the path of a folder."""
    text = os.fspath(name)
    begin = ADDRESS.match(text)
    if begin is None and ANY_ADDRESS.match(text):
        raise OptionError(
            f"Expected a folder, s3://BUCKET/PREFIX, http:// or https:// and a host, got {text:.80}. Correct it."
        )
    return f"{begin[1]}://{text[begin.end() :].rstrip('/')}" if begin else None


class Folder:
    """The files of a map in a folder, copied into private memory, so that later changes do no harm."""

    remedy = "Build the map again with `maxcon map build`."

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)

    def where(self, name: str) -> str:
        """Return the file's path."""
        return str(self._path / name)

    def read(self, name: str, max_bytes: int) -> bytes | memoryview:
        """Return all of a file; one that is larger is cut."""
        return read_regular(self._path / name, max_bytes)

    def read_range(self, wanted: ByteRange) -> memoryview:
        """Return some bytes of a file, in memory of their own; fewer where the file ends before."""
        with open_regular(self._path / wanted.name) as file:
            left = os.fstat(file.fileno()).st_size - wanted.offset  # no more memory than there are bytes
            file.seek(wanted.offset)
            return memoryview(file.read(max(min(wanted.length, left), 0)))


class Remote:
    """The files of a map behind an address, `s3://bucket/prefix`, `http://server/path` or `https://server/path`."""

    remedy = "Check the server and the address, and try again."

    def __init__(self, address: str) -> None:
        with needs_extra("obstore", f"to read {address}", "remote"):
            import obstore
        self._obstore = obstore
        self._address = address
        self._is_s3 = address.startswith("s3:")

    def where(self, name: str) -> str:
        """Return the file's address."""
        return f"{self._address}/{name}" if name else self._address

    def read(self, name: str, max_bytes: int) -> bytes | memoryview:
        """Return all of a file; one that is larger is refused."""

        def ask() -> memoryview:
            result = self._obstore.get(self._store, name)
            if result.meta["size"] > max_bytes:
                raise OSError(errno.EFBIG, f"{result.meta['size']:,} bytes, more than there can be in it")
            return memoryview(result.bytes())

        return self._asked(ask)

    def read_range(self, wanted: ByteRange) -> memoryview:
        """Return some bytes of a file."""
        name, start, length = wanted
        return self._asked(lambda: memoryview(self._obstore.get_range(self._store, name, start=start, length=length)))

    def write(self, name: str, content: bytes | Path) -> None:
        """Write a file, or replace it, in one step."""
        self._asked(lambda: self._obstore.put(self._store, name, content))

    def size(self, name: str) -> int | None:
        """Return the size of a file, bytes; None if there is none."""
        try:
            return int(self._asked(lambda: self._obstore.head(self._store, name))["size"])
        except FileNotFoundError:
            return None

    @cached_property
    def _store(self) -> Any:
        from obstore.store import HTTPStore, S3Store

        endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL", "")
        options: dict[str, Any] = {
            "client_options": {
                "connect_timeout": timedelta(seconds=CONNECT_SECONDS),
                "read_timeout": timedelta(seconds=READ_SECONDS),
                "timeout": timedelta(seconds=REQUEST_SECONDS),
                "allow_http": (endpoint if self._is_s3 else self._address).startswith("http:"),
            },
            "retry_config": {"max_retries": RETRIES, "retry_timeout": timedelta(seconds=RETRY_SECONDS)},
        }
        if not self._is_s3:
            return HTTPStore(self._address, **options)
        return S3Store.from_url(self._address, config={"endpoint": endpoint} if endpoint else {}, **options)

    def _asked(self, ask: Callable[[], Answer]) -> Answer:
        """Return the answer of the server; its errors become OSError with words for the user."""
        from obstore.exceptions import BaseError

        try:
            return ask()
        except FileNotFoundError as error:
            missing = "no such bucket" if "NoSuchBucket" in str(error) else os.strerror(errno.ENOENT)
            raise FileNotFoundError(errno.ENOENT, missing) from None
        except (BaseError, ValueError) as error:
            raise OSError(errno.EIO, _in_words(error, is_s3=self._is_s3)) from None


MapStorage: TypeAlias = Folder | Remote
"""The files of a map, by their names in it. Errors are OSError, with the cause in `strerror`."""


def open_storage(name: str | os.PathLike[str]) -> MapStorage:
    """Return access to the files of a map in a folder or at an address, which needs obstore; nothing is read yet."""
    address = address_of(name)
    return Folder(name) if address is None else Remote(address)


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
