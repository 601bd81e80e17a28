"""VoxelTile: the voxels of one square of the map, in the order the search reads them, and the cache of tiles."""

import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry.arrays import read_only_view
from maxcon.map.layout import MEAN_STEPS, PATCH_VOXELS, TILE_VOXELS, WORD_BITS, SurfaceClass, TileKey

PATCH_WORDS = PATCH_VOXELS**2 // WORD_BITS


@dataclass(frozen=True, slots=True, eq=False)
class TileIndex:
    """Where each patch of 16 x 16 voxels of one height layer begins in its tile."""

    layers: NDArray[np.int32]  # (n_layers,): the z indices that occur, ascending
    # (n_layers * n_patches**2 + 1,): the voxels of patch (py, px) of layer k, of n_patches along each edge of the tile,
    # are those from number (k * n_patches + py) * n_patches + px to the next. Patches that follow each other along x
    # are one run of voxels.
    patch_starts: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Which patches and voxels a tile holds, a bit each: a single voxel is found without a search.

    Patches are numbered by (patch y, patch x, layer): what stands upright, as walls do, lies together in memory.
    """

    # (n_patches, n_patches, n): whether patch (py, px) of each layer holds voxels: bit k % 64 of word k // 64 for layer
    # k. Bit n_layers is never set: it stands for heights at which the tile has no layer.
    held: NDArray[np.uint64]
    # (n_patches, n_patches, n): number of the first patch of each word; those of its others follow, in the order of
    # their bits
    numbers: NDArray[np.int32]
    # (m, 4): four rows of a patch each: its voxel (x, y) is bit (y % 4) * PATCH_VOXELS + x of word y // 4
    words: NDArray[np.uint64]
    # (m, 4): number in the tile of each word's first voxel; those of its others follow, in the order of their bits
    firsts: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class VoxelTile:
    """The voxels of one tile of the map, sorted by (z, patch y, patch x, y, x): 512 x 512 columns, 30.72 m at 6 cm."""

    key: TileKey  # the tile's (x, y) index
    columns: NDArray[np.int16]  # (n, 2): (x, y) voxel index less the tile's first, from 0 to `edge` - 1
    layers: NDArray[np.int32]  # (n,): z voxel index
    counts: NDArray[np.int32]  # (n,): how many map points the voxel holds
    normals: NDArray[np.float32]  # (n, 3): their mean unit normal; zeros where there is none
    means: NDArray[np.uint8]  # (n, 3): where in the voxel their mean lies, in 256ths of its edge, from its corner
    edge: int = TILE_VOXELS  # voxels along an edge of the tile, a power of two
    classes: NDArray[np.uint8] | None = None  # (n,): `SurfaceClass` of each voxel; all are known if None

    def __len__(self) -> int:
        return len(self.layers)

    def without(self, left_out: Collection[SurfaceClass]) -> "VoxelTile":
        """Return the tile without the voxels of some classes; those that are left have none any more."""
        if self.classes is None:
            return self
        is_kept = ~np.isin(self.classes, list(left_out))
        return replace(self.rows(is_kept), classes=None)

    def rows(self, chosen: NDArray[np.bool_] | NDArray[np.integer]) -> "VoxelTile":
        """Return a tile of some of the voxels, which must ascend."""
        return replace(
            self, columns=self.columns[chosen], layers=self.layers[chosen], counts=self.counts[chosen],
            normals=self.normals[chosen], means=self.means[chosen],
            classes=None if self.classes is None else self.classes[chosen],
        )  # fmt: skip

    @property
    def surface_classes(self) -> NDArray[np.uint8]:
        """`SurfaceClass` of each voxel; all are known in a tile without classes."""
        return np.full(len(self), SurfaceClass.KNOWN, np.uint8) if self.classes is None else self.classes

    @property
    def corner(self) -> tuple[int, int]:
        """(x, y) index of its first voxel."""
        return self.key[0] * self.edge, self.key[1] * self.edge

    @property
    def n_patches(self) -> int:
        """How many patches there are along an edge."""
        return self.edge // PATCH_VOXELS

    @cached_property
    def _found(self) -> tuple[TileIndex, int]:
        """Where each patch begins, and how many patches hold voxels; -1 if voxels are not in order."""
        from maxcon.map import tile_kernels

        columns, layers = read_only_view(self.columns), read_only_view(self.layers)
        *index, n_held = tile_kernels.find_patches(columns, layers, self.edge)
        return TileIndex(*index), n_held

    @property
    def index(self) -> TileIndex:
        """Where each patch begins."""
        return self._found[0]

    @property
    def is_in_order(self) -> bool:
        """Whether columns lie inside the tile and voxels are in search order, on which all searches rely."""
        return self._found[1] >= 0

    @cached_property
    def fullest(self) -> int:
        """How many map points the fullest voxel holds."""
        return int(self.counts.max(initial=1))

    @cached_property
    def normal_products(self) -> NDArray[np.float64]:
        """Sums of the products of x and y of the normals, shape (2, 2): which axis they determine."""
        horizontal = self.normals[:, :2].astype(np.float64)
        return horizontal.T @ horizontal

    @cached_property
    def occupancy(self) -> Occupancy:
        """Which voxels there are."""
        from maxcon.map import tile_kernels

        index, n_held = self._found
        held = np.zeros((self.n_patches**2, len(index.layers) // WORD_BITS + 1), np.uint64)
        numbers = np.empty(held.shape, np.int32)
        found = tile_kernels.find_occupancy(index.patch_starts, read_only_view(self.columns), n_held, held, numbers)
        shape = (self.n_patches, self.n_patches, held.shape[1])
        return Occupancy(held.reshape(shape), numbers.reshape(shape), *found)

    @cached_property
    def layer_numbers(self) -> NDArray[np.int32]:
        """Number of each height layer from the lowest to the highest, -1 where there is none."""
        layers = self.index.layers
        height = int(layers[-1]) - int(layers[0]) + 1 if len(layers) else 0
        numbers = np.full(height, -1, np.int32)
        numbers[layers - layers[:1]] = np.arange(len(layers))
        return numbers

    @property
    def voxels(self) -> NDArray[np.int32]:
        """(x, y, z) voxel indices in the local frame, shape (n, 3)."""
        return np.column_stack([self.columns + np.array(self.corner, dtype=np.int32), self.layers])

    def mean_points(self, cell: float) -> NDArray[np.float64]:
        """Mean of the points of each voxel of edge `cell` (m), local frame, shape (n, 3), m; to 1/512 of the edge."""
        inside = (self.means + 0.5) / MEAN_STEPS
        return np.asarray((self.voxels + inside) * cell, dtype=np.float64)

    @cached_property
    def n_bytes(self) -> int:
        """Memory this tile holds once its index and its occupancy are made."""
        arrays = (self.columns, self.layers, self.counts, self.normals, self.means)
        index = (self.index.layers, self.index.patch_starts, self.layer_numbers)
        n_words = self.n_patches**2 * (len(self.index.layers) // WORD_BITS + 1)
        n_words += PATCH_WORDS * self._found[1]
        occupancy = n_words * (np.uint64().nbytes + np.int32().nbytes)
        return sum(array.nbytes for array in arrays + index) + occupancy


def search_order(columns: NDArray[np.int16], layers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the order (z, patch y, patch x, y, x) of voxels with these indices."""
    patches = columns // PATCH_VOXELS
    return np.lexsort((columns[:, 0], columns[:, 1], patches[:, 0], patches[:, 1], layers))


TileT = TypeVar("TileT")
PREFETCH_THREADS = 8
_waited = threading.local()


def n_waited_for() -> int:
    """Return how many tiles this thread had to make or to wait for so far, of maps, of their levels and of ground."""
    return getattr(_waited, "n_tiles", 0)


class TilesInMemory(Generic[TileT]):
    """Tiles that were made here, by their keys."""

    def __init__(self, tiles: Mapping[TileKey, TileT]) -> None:
        self._tiles = tiles
        self.keys = frozenset(tiles)

    def load(self, key: TileKey) -> TileT:
        """Return one of them."""
        return self._tiles[key]


class TileCache(Generic[TileT]):
    """Tiles that are made when asked for, in an LRU cache bounded in bytes; the last one is kept whatever its size.

    Threads make different tiles at once; a tile that several ask for is made once, and the others wait for it.
    """

    def __init__(self, make: Callable[[TileKey], TileT], max_bytes: int, keys: Iterable[TileKey] = ()) -> None:
        self.keys = frozenset(keys)
        self._make = make
        self._max_bytes = max_bytes
        self._n_bytes = 0
        self._tiles: OrderedDict[TileKey, Any] = OrderedDict()
        self._loading: dict[TileKey, Future[TileT]] = {}
        self._ahead: dict[TileKey, Future[None]] = {}
        self._lock = threading.Lock()

    def prefetch(self, keys: Iterable[TileKey]) -> None:
        """Begin to make tiles that will be needed soon, several at a time, in threads that end with this cache."""
        with self._lock:
            for key in keys:
                if key in self.keys and not any(key in each for each in (self._tiles, self._loading, self._ahead)):
                    self._ahead[key] = self._pool.submit(_load_ahead, weakref.ref(self), key)

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        pool = ThreadPoolExecutor(PREFETCH_THREADS, thread_name_prefix="prefetch")
        weakref.finalize(self, pool.shutdown, wait=False, cancel_futures=True)
        return pool

    def load(self, key: TileKey) -> TileT:
        """Return a tile that is kept, or else make it, or wait for the thread that does."""
        with self._lock:
            if key in self._tiles:
                self._tiles.move_to_end(key)
                return self._tiles[key]  # type: ignore[no-any-return]
            _waited.n_tiles = n_waited_for() + 1
            loading, mine = self._loading.get(key), Future[TileT]()
            if loading is None:
                self._loading[key] = mine
        if loading is not None:
            return loading.result()
        try:
            tile: Any = self._make(key)
            n_bytes = tile.n_bytes  # makes the index of a tile
        except BaseException as error:
            del self._loading[key]
            mine.set_exception(error)
            raise
        with self._lock:
            self._tiles[key] = tile
            self._n_bytes += n_bytes
            while self._n_bytes > self._max_bytes and len(self._tiles) > 1:
                self._n_bytes -= self._tiles.popitem(last=False)[1].n_bytes
            del self._loading[key]
        mine.set_result(tile)
        return tile  # type: ignore[no-any-return]


def _load_ahead(cache: "weakref.ref[TileCache[Any]]", key: TileKey) -> None:
    """Load a tile for a cache that nothing else may keep alive, so that its threads end with it."""
    tiles = cache()
    if tiles is None:
        return
    try:
        tiles.load(key)
    except Exception:  # what else is coming would fail as well; who asks for a tile gets the error
        with tiles._lock:
            for future in tiles._ahead.values():
                future.cancel()
            tiles._ahead.clear()
        raise
    finally:
        with tiles._lock:
            tiles._ahead.pop(key, None)


TileSource: TypeAlias = TilesInMemory[TileT] | TileCache[TileT]
"""Where the tiles or the ground of a map come from: memory, or disk, a network, and finer tiles behind a cache."""
