# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""KeptTiles: a cache of the tiles that were used last, within a budget of memory."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from maxcon.map.layout import TileKey

__all__ = ["KeptTiles"]


class Sized(Protocol):
    """A tile, or something derived from one."""

    @property
    def n_bytes(self) -> int:
        """Memory it holds, with its indices."""
        ...


TileT = TypeVar("TileT", bound=Sized)


class KeptTiles(OrderedDict[TileKey, TileT]):
    """Tiles by their keys; the ones used longest ago go first.

    Parameters
    ----------
    most_bytes : int
        Size of all kept tiles and their indices; the last one is kept whatever its size.
    """

    def __init__(self, most_bytes: int) -> None:
        super().__init__()
        self._most_bytes = most_bytes
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return KeptTiles, (self._most_bytes,)  # a copy, as in another process, begins empty

    def load(self, key: TileKey, make: Callable[[], TileT]) -> TileT:
        """Return the tile of a key from the cache, or else make it, and keep it."""
        with self._lock:
            tile = self.get(key)
            if tile is not None:
                self.move_to_end(key)
                return tile
            tile = self[key] = make()
            used_bytes = sum(kept.n_bytes for kept in self.values())
            while used_bytes > self._most_bytes and len(self) > 1:
                _, oldest = self.popitem(last=False)
                used_bytes -= oldest.n_bytes
            return tile
