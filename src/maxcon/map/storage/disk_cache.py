# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""DiskCache: records that came over a network, kept on disk by their checksums, within a budget (decision 28)."""

import hashlib
import os
import threading
import uuid
from contextlib import suppress
from pathlib import Path

from maxcon.errors import FileError, OptionError
from maxcon.map.storage.record_place import RecordPlace

__all__ = ["DiskCache", "default_cache"]

DEFAULT_GB = 10.0
FOLDER, BUDGET = "MAXCON_CACHE_DIR", "MAXCON_CACHE_GB"
"""Environment variables: the folder of the cache, and its size in GB; 0 for none."""


def default_cache() -> "DiskCache | None":
    """Return the cache that the environment asks for; None if it asks for none.

    Raises
    ------
    OptionError
        If its size is no number.
    """
    text = os.environ.get(BUDGET, str(DEFAULT_GB))
    try:
        budget_bytes = int(float(text) * 1e9)
    except (ValueError, OverflowError):
        raise OptionError(
            f"Expected {BUDGET} to be a number of gigabytes, got {text!r}. Leave it out, or say 10."
        ) from None
    if budget_bytes <= 0:
        return None
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return DiskCache(Path(os.environ.get(FOLDER) or Path(home, "maxcon", "tiles")), budget_bytes)


FULL_AGAIN = 0.9
"""Share of the budget that is still filled after records were removed because it was exceeded."""


class DiskCache:
    """Records by their checksums, which are verified whenever one is read.

    The ones used longest ago are removed first, by the times of their files. Any number of processes share one.

    Parameters
    ----------
    folder : Path
        Where they are kept; made when the first one is.
    budget_bytes : int
        Size of all of them.
    """

    def __init__(self, folder: Path, budget_bytes: int) -> None:
        self._folder = folder
        self._budget_bytes = budget_bytes
        self._until_look = 0
        self._lock = threading.Lock()

    def has(self, place: RecordPlace) -> bool:
        """Whether a record is kept; not whether it is whole."""
        return self._path(place).exists()

    def get(self, place: RecordPlace) -> memoryview | None:
        """Return a record, None unless it is kept and whole; it counts as the one used last then."""
        path = self._path(place)
        try:
            content = path.read_bytes()
        except OSError:
            return None  # not there, or taken away meanwhile
        if hashlib.sha256(content).digest() != place.sha256:
            self._remove(path)
            return None
        with suppress(OSError):
            os.utime(path)
        return memoryview(content)

    def put(self, place: RecordPlace, content: memoryview) -> None:
        """Keep a record.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        path = self._path(place)
        partial = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_bytes(content)
            with suppress(FileNotFoundError):  # removed by another process that made room meanwhile
                partial.replace(path)
        except OSError as error:
            raise FileError(
                f"Expected to be able to keep tiles in {self._folder}, got: {error.strerror or error}."
                f" Name another folder by {FOLDER}, or keep none by {BUDGET}=0."
            ) from None
        finally:
            self._remove(partial)
        with self._lock:
            self._until_look -= len(content)
            if self._until_look < 0:
                self._until_look = self._trim() // 4

    def _trim(self) -> int:
        """Remove what was used longest ago where the budget is exceeded; return what is left of it.

        A part is left free, so that the folder is not looked through for every record of a full cache.
        """
        found = []
        for path in self._folder.glob("??/*"):
            with suppress(OSError):
                stat = path.stat()
                found.append((stat.st_mtime_ns, stat.st_size, path))
        used_bytes = sum(size for _, size, _ in found)
        if used_bytes <= self._budget_bytes:
            return self._budget_bytes - used_bytes
        for _, size, path in sorted(found):
            if used_bytes <= FULL_AGAIN * self._budget_bytes:
                break
            self._remove(path)
            used_bytes -= size
        return self._budget_bytes - used_bytes

    def _path(self, place: RecordPlace) -> Path:
        name = place.sha256.hex()
        return self._folder / name[:2] / name

    def _remove(self, path: Path) -> None:
        with suppress(OSError):  # another process was faster
            path.unlink(missing_ok=True)
