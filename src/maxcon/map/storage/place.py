# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MapFiles, the interface to the files of a map, and which of its kinds a path or address means."""

import os
import re
from collections.abc import Sequence
from typing import Protocol

from maxcon.errors import OptionError
from maxcon.map.storage.folder import Folder
from maxcon.map.storage.record_place import RecordPlace

__all__ = ["MapFiles", "address_of", "open_place"]

ADDRESS = re.compile(r"(s3|https?):/{1,2}(?=[^/])")
"""How an address begins; a `Path` of one has lost a slash."""
ANY_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/(/|$)|(s3|https?|gs|ftp|file):(/|$)")
"""How names begin that mean an address of any kind, not a folder."""


class MapFiles(Protocol):
    """The files of a map, by their names in it, such as `manifest.json`.

    Errors are OSError, with the cause in `strerror`; FileNotFoundError where there is no such file.
    """

    @property
    def remedy(self) -> str:
        """What helps where a file cannot be read, for messages."""
        ...

    def where(self, name: str) -> str:
        """Return the file's whole name, for messages."""
        ...

    def what_is_there(self, name: str, error: OSError) -> str:
        """Return what there is instead of a file that was not found, in words for a message."""
        ...

    def read(self, name: str, most_bytes: int) -> memoryview:
        """Return all of a file, in memory of its own; one that is larger is refused."""
        ...

    def read_record(self, place: RecordPlace) -> memoryview:
        """Return the bytes of a record, in memory of their own; fewer where the file ends before."""
        ...

    def announce(self, places: Sequence[RecordPlace]) -> None:
        """Announce records that will be read soon; over a network they are fetched in the background."""
        ...


def address_of(place: str | os.PathLike[str]) -> str | None:
    """Return a name as an address, `s3://`, `http://` or `https://`; None if it is the path of a folder.

    Raises
    ------
    OptionError
        If it is an address of another kind, or one without a bucket or a host.
    """
    text = os.fspath(place)
    begin = ADDRESS.match(text)
    if begin is None and ANY_ADDRESS.match(text):
        raise OptionError(
            f"Expected a folder, s3://BUCKET/PREFIX, http:// or https:// and a host, got {text:.80}. Correct it."
        )
    return f"{begin[1]}://{text[begin.end() :].rstrip('/')}" if begin else None


def open_place(place: str | os.PathLike[str], *, uses_cache: bool = True) -> MapFiles:
    """Return access to the files of a map; nothing is read yet.

    Parameters
    ----------
    place : path or str
        A folder, or an address: `s3://bucket/prefix`, `http://` or `https://`.
    uses_cache : bool
        Whether records from an address are kept on this machine's disk.

    Raises
    ------
    MissingExtraError
        If it is an address, and the package for it is not installed.
    """
    address = address_of(place)
    if address is None:
        return Folder(place)
    from maxcon.map.storage.disk_cache import default_cache
    from maxcon.map.storage.remote import Remote

    return Remote(address, default_cache() if uses_cache else None)
