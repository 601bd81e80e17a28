"""Voxel tables: the tiles around a place as one tuple of arrays, as compiled look-ups read them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from threading import Lock
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from maxcon.map.layout import TILE_PATCHES, TileKey
from maxcon.map.tile import VoxelTile

VoxelTable: TypeAlias = tuple[NDArray[Any], ...]
"""Arrays of several tiles, so that one call of a kernel looks up points in all of them.

rows: shape (n_tiles + 1, 5), int64; for each tile: z index of its lowest height layer; how many layers there are up to
    the highest, and where their numbers begin in `layers`; how many words each column of patches has, and where they
    begin in `held`. The first row is for where there is no tile.
grid: shape (ny, nx), int32; rows of the tiles, by their keys; corner: shape (2,), int64; key (x, y) of the first.
layers: int32; the `layer_numbers` of the tiles.
held, numbers, words, firsts: as in `Occupancy`, flat; patches and voxels are numbered through all tiles.
normals, counts, means: as in `VoxelTile`, of all voxels.
"""

COLUMNS: tuple[tuple[type, tuple[int, ...]], ...] = (
    (np.int64, (5,)), (np.int32, ()), (np.uint64, ()), (np.int32, ()), (np.uint64, ()), (np.int32, ()),
    (np.float32, (3,)), (np.int32, ()), (np.uint8, (3,)),
)  # fmt: skip
ROWS, HELD, NUMBERS = 0, 2, 3
MOST_BYTES, LARGE, ROOM = 2**29, 2**25, 1.25
"""A table that holds more is begun anew, with the tiles that are asked for. Arrays grow by this factor; of a table
larger than `LARGE` once, to what the largest needs: memory is given where it is written, copies hold up a search."""


class TileTable:
    """Tiles one after the other in arrays with room for more: an epoch adds those that no one before it needed.

    What is in the arrays is never written again: tables that were given out stay as they are. Who adds tiles holds up
    none who asks for others.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._begin()
        self._publish()

    def __reduce__(self) -> tuple[type["TileTable"], tuple[()]]:
        return TileTable, ()  # a copy, perhaps in another process, begins empty

    def _begin(self) -> None:
        """Forget all tiles; the first row is of none, without patches."""
        self._arrays: list[NDArray[Any]] = [np.empty((0, *shape), kind) for kind, shape in COLUMNS]
        self._sizes = [0] * len(COLUMNS)
        self._rows: dict[TileKey, int] = {}
        self._n_patches = 0
        self._extend(ROWS, [np.array([[0, 0, 0, 1, 0]])])
        self._extend(HELD, [np.zeros(TILE_PATCHES**2)])
        self._extend(NUMBERS, [np.zeros(TILE_PATCHES**2)])

    def of(self, keys: Iterable[TileKey], load: Callable[[Sequence[TileKey]], Sequence[VoxelTile]]) -> VoxelTable:
        """Return the table of some tiles; `load` returns those that are not there yet."""
        wanted, loaded = set(keys), dict[TileKey, VoxelTile]()
        while True:
            (rows, *others), numbers = self._published
            if numbers.keys() >= wanted:
                return rows, *grid_of_rows({key: numbers[key] for key in wanted}), *others
            with self._lock:
                self._add([tile for key, tile in loaded.items() if key not in self._rows])
                missing = wanted - self._rows.keys()
                if not missing:
                    self._publish()
                elif self.n_bytes > MOST_BYTES:
                    self._begin()
                    missing = wanted
            # Without the lock: several threads read at the same time.
            loaded |= {tile.key: tile for tile in load(sorted(missing - loaded.keys()))}

    def _publish(self) -> None:
        """Give out all tiles that are there."""
        columns = [array[:size] for array, size in zip(self._arrays, self._sizes, strict=True)]
        self._published = columns, self._rows.copy()

    @property
    def n_bytes(self) -> int:
        """Memory of what it holds."""
        return sum(array[:size].nbytes for array, size in zip(self._arrays, self._sizes, strict=True))

    def _add(self, tiles: Sequence[VoxelTile]) -> None:
        """Take tiles behind those that are there."""
        parts: list[list[NDArray[Any]]] = [[] for _ in COLUMNS]
        _, n_layers, n_held, _, _, _, n_voxels, _, _ = self._sizes
        for tile in tiles:
            occupancy, layers = tile.occupancy, tile.layer_numbers
            lowest = int(tile.index.layers[0]) if len(layers) else 0
            self._rows[tile.key] = self._sizes[ROWS] + len(parts[ROWS])
            columns: tuple[NDArray[Any], ...] = (
                np.array([[lowest, len(layers), n_layers, occupancy.held.shape[2], n_held]]), layers,
                occupancy.held.reshape(-1), occupancy.numbers.reshape(-1) + np.int32(self._n_patches),
                occupancy.words.reshape(-1), occupancy.firsts.reshape(-1) + np.int32(n_voxels), tile.normals,
                tile.counts, tile.means,
            )  # fmt: skip
            for part, values in zip(parts, columns, strict=True):
                part.append(values)
            n_layers, n_held, n_voxels = n_layers + len(layers), n_held + occupancy.held.size, n_voxels + len(tile)
            self._n_patches += len(occupancy.words)
        n_bytes = self.n_bytes + sum(values.nbytes for part in parts for values in part)
        room = ROOM * max(1.0, MOST_BYTES / n_bytes) if n_bytes > LARGE else ROOM
        for column, part in enumerate(parts if tiles else ()):
            self._extend(column, part, room)

    def _extend(self, column: int, parts: Sequence[NDArray[Any]], room: float = 1.0) -> None:
        """Put values behind those of a column, in an array `room` times as large if they have no room."""
        array, size = self._arrays[column], self._sizes[column]
        end = size + sum(map(len, parts))
        if end > len(array):
            grown = np.empty((int(room * end), *array.shape[1:]), array.dtype)
            grown[:size] = array[:size]
            self._arrays[column] = array = grown
        np.concatenate(parts, out=array[size:end], casting="unsafe")
        self._sizes[column] = end


def voxel_table(tiles: Sequence[VoxelTile]) -> VoxelTable:
    """Return the table of some tiles, numbered in their order."""
    of_key = {tile.key: tile for tile in tiles}
    table = TileTable()
    return table.of(of_key, lambda keys: [of_key[key] for key in of_key if key in set(keys)])


def grid_of_rows(rows: Mapping[TileKey, int]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the grid of a table that has only these tiles, by their rows, and its corner."""
    keys = np.array(list(rows), np.int64).reshape(-1, 2)
    corner = keys.min(axis=0, initial=2**31)
    nx, ny = keys.max(axis=0) - corner + 1 if rows else (0, 0)
    grid = np.zeros((int(ny), int(nx)), np.int32)
    grid[tuple((keys - corner).T[::-1])] = list(rows.values())
    return grid, corner
