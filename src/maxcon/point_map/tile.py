# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""VoxelTile: the voxels of one square of the map, in the order the search reads them."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "PATCH_VOXELS",
    "TILE_PATCHES",
    "TILE_VOXELS",
    "Addresses",
    "Occupancy",
    "TileIndex",
    "TileKey",
    "VoxelTile",
    "search_order",
]

TileKey = tuple[int, int]
"""(x, y) index of a tile: floor(voxel index / TILE_VOXELS)."""

TILE_VOXELS = 512
PATCH_VOXELS = 16
TILE_PATCHES = TILE_VOXELS // PATCH_VOXELS
# A drive turns: along and across two streets.
MOST_DERIVED = 4
WORD_BITS = 64
PATCH_WORDS = PATCH_VOXELS**2 // WORD_BITS


class Sized(Protocol):
    """Anything that knows what memory it takes."""

    @property
    def n_bytes(self) -> int:
        """Bytes."""
        ...


T = TypeVar("T", bound=Sized)


@dataclass(frozen=True, slots=True)
class TileIndex:
    """Where each patch of 16 x 16 voxels of one height layer begins in its tile.

    Parameters
    ----------
    layers : array, shape (n_layers,), int32
        The z indices that occur, ascending.
    patch_starts : array, shape (n_layers * TILE_PATCHES**2 + 1,), int64
        The voxels of patch (py, px) of layer k are those from number (k * TILE_PATCHES + py) * TILE_PATCHES
        + px to the next. Patches that follow each other along x are one run of voxels.
    """

    layers: NDArray[np.int32]
    patch_starts: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Which patches and voxels a tile holds, a bit each: a single voxel is found without a search.

    Patches that hold voxels are numbered in the order (patch y, patch x, layer): what stands upright, as walls do,
    lies together in memory.

    Parameters
    ----------
    held : array, shape (TILE_PATCHES, TILE_PATCHES, n), uint64
        Whether patch (py, px) of each layer holds voxels: bit k % 64 of word k // 64 for layer k. The last bit is
        never set: for heights at which the tile has no layer.
    numbers : array, shape (TILE_PATCHES, TILE_PATCHES, n), int32
        Number of the first patch of each word; those of its others follow, in the order of their bits.
    words : array, shape (n_patches, 4), uint64
        Four rows of a patch each: its voxel (x, y) is bit (y % 4) * PATCH_VOXELS + x of word y // 4.
    firsts : array, shape (n_patches, 4), int32
        Number in the tile of each word's first voxel; those of its others follow, in the order of their bits.
    """

    held: NDArray[np.uint64]
    numbers: NDArray[np.int32]
    words: NDArray[np.uint64]
    firsts: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where the arrays of a tile lie in memory: its occupancy (held, numbers, words, firsts), normals and counts.

    Parameters
    ----------
    values : array, shape (6,), uint64
        Addresses of their first items.
    kept : tuple of arrays
        The arrays, in one piece each: they live as long as their addresses.
    """

    values: NDArray[np.uint64]
    kept: tuple[NDArray[Any], ...]

    @classmethod
    def of(cls, *arrays: NDArray[Any]) -> "Addresses":
        """Addresses of arrays, or of copies in one piece."""
        kept = tuple(np.ascontiguousarray(array) for array in arrays)
        return cls(np.array([array.ctypes.data for array in kept], np.uint64), kept)

    def __reduce__(self) -> tuple[Any, ...]:
        return Addresses.of, self.kept  # a copy lies elsewhere


@dataclass(frozen=True)
class VoxelTile:
    """The voxels of one tile of the map: 512 x 512 columns, 30.72 m at 6 cm.

    Sorted by (z, patch y, patch x, y, x), see `search_order`. The arrays may be read-only views of a
    mapped file.

    Parameters
    ----------
    key : tuple of 2 int
        The tile's (x, y) index.
    columns : array, shape (n, 2), int16
        (x, y) voxel index less the tile's first, 0 to 511.
    layers : array, shape (n,), int32
        z voxel index.
    counts : array, shape (n,), int32
        How many map points the voxel holds.
    normals : array, shape (n, 3), float32
        Their mean unit normal; zeros where there is none.
    """

    key: TileKey
    columns: NDArray[np.int16]
    layers: NDArray[np.int32]
    counts: NDArray[np.int32]
    normals: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.layers)

    @property
    def corner(self) -> tuple[int, int]:
        """(x, y) index of its first voxel."""
        return self.key[0] * TILE_VOXELS, self.key[1] * TILE_VOXELS

    @cached_property
    def index(self) -> TileIndex:
        """Where each patch begins; made when first asked for."""
        layers, patch = self._patches()
        sizes = np.bincount(patch, minlength=len(layers) * TILE_PATCHES**2)
        return TileIndex(layers, np.concatenate([[0], np.cumsum(sizes)]))

    @cached_property
    def fullest(self) -> int:
        """How many map points the fullest voxel holds; counted when first asked for."""
        return int(self.counts.max(initial=1))

    @cached_property
    def occupancy(self) -> Occupancy:
        """Which voxels there are; made when first asked for."""
        sizes, n_layers = np.diff(self.index.patch_starts), len(self.index.layers)
        patches = np.flatnonzero(sizes)
        n_words = n_layers // WORD_BITS + 1
        layer, place = np.divmod(patches, TILE_PATCHES**2)
        order = np.lexsort((layer, place))
        held, numbers = _set_bits((place * n_words * WORD_BITS + layer)[order], TILE_PATCHES**2 * n_words)
        number_of_patch = np.empty(len(patches), np.int64)
        number_of_patch[order] = np.arange(len(patches))
        x, y = self.columns.T & (PATCH_VOXELS - 1)
        bits = np.repeat(number_of_patch * PATCH_VOXELS**2, sizes[patches]) + (y * PATCH_VOXELS + x)
        words, firsts = _set_bits(bits, len(patches) * PATCH_WORDS)
        shape = (TILE_PATCHES, TILE_PATCHES, n_words)
        return Occupancy(
            held.reshape(shape),
            numbers.reshape(shape),
            words.reshape(-1, PATCH_WORDS),
            firsts.reshape(-1, PATCH_WORDS),
        )

    @cached_property
    def addresses(self) -> Addresses:
        """Where the arrays lie that single voxels are looked up in; made when first asked for."""
        occupancy = self.occupancy
        normals, counts = (
            self.normals.astype(np.float32, copy=False),
            self.counts.astype(np.int32, copy=False),
        )
        bits = (occupancy.held, occupancy.numbers, occupancy.words, occupancy.firsts)
        return Addresses.of(*bits, normals, counts)

    def derived(self, key: Hashable, make: Callable[["VoxelTile"], T]) -> T:
        """What is made of this tile for a search, kept with it as long as it is among the last ones asked for.

        Parameters
        ----------
        key : hashable
            What it is.
        make : callable
            Makes it, of this tile. It has `n_bytes`.
        """
        kept = self._derived
        made = kept.pop(key, None)
        if made is None:
            made = make(self)
        kept[key] = made
        while len(kept) > MOST_DERIVED:
            kept.pop(next(iter(kept)), None)  # another thread may have been here
        return cast(T, made)

    @cached_property
    def _derived(self) -> dict[Hashable, "Sized"]:
        return {}

    def _patches(self) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Return the z indices that occur, and the number of each voxel's patch."""
        layers, layer_of_voxel = np.unique(self.layers, return_inverse=True)
        patches = self.columns.astype(np.int64) // PATCH_VOXELS
        return layers, (layer_of_voxel * TILE_PATCHES + patches[:, 1]) * TILE_PATCHES + patches[:, 0]

    @property
    def is_in_order(self) -> bool:
        """Whether columns lie inside the tile, and voxels in the order of the search: what it relies on."""
        if not len(self):
            return True
        if self.columns.min() < 0 or self.columns.max() >= TILE_VOXELS:
            return False
        inside = self.columns.astype(np.int64) % PATCH_VOXELS
        places = (self._patches()[1] * PATCH_VOXELS + inside[:, 1]) * PATCH_VOXELS + inside[:, 0]
        return bool((np.diff(places) > 0).all())

    @property
    def voxels(self) -> NDArray[np.int32]:
        """(x, y, z) voxel indices in the local frame, shape (n, 3)."""
        return np.column_stack([self.columns + np.array(self.corner, dtype=np.int32), self.layers])

    @property
    def n_bytes(self) -> int:
        """Memory this tile holds once its index and its occupancy are made, and what is derived from it by now."""
        arrays = (self.columns, self.layers, self.counts, self.normals)
        index = (self.index.layers, self.index.patch_starts)
        n_words = TILE_PATCHES**2 * (len(self.index.layers) // WORD_BITS + 1)
        n_words += PATCH_WORDS * int(np.count_nonzero(np.diff(self.index.patch_starts)))
        occupancy = n_words * (np.uint64().nbytes + np.int32().nbytes)
        derived = sum(made.n_bytes for made in list(self._derived.values()))
        return sum(array.nbytes for array in arrays + index) + occupancy + derived


def search_order(columns: NDArray[np.int16], layers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the order (z, patch y, patch x, y, x) of voxels with these indices."""
    patches = columns // PATCH_VOXELS
    return np.lexsort((columns[:, 0], columns[:, 1], patches[:, 0], patches[:, 1], layers))


def _set_bits(bits: NDArray[np.int64], n_words: int) -> tuple[NDArray[np.uint64], NDArray[np.int32]]:
    """Words in which these bits are set, and how many come before each that is not empty.

    Bits of a word follow each other.
    """
    words, before = np.zeros(n_words, np.uint64), np.zeros(n_words, np.int32)
    if len(bits):
        word = bits >> (WORD_BITS.bit_length() - 1)
        firsts = np.flatnonzero(np.diff(word, prepend=-1))
        one = np.left_shift(np.uint64(1), (bits & (WORD_BITS - 1)).astype(np.uint64))
        words[word[firsts]] = np.bitwise_or.reduceat(one, firsts)
        before[word[firsts]] = firsts
    return words, before
