"""Points on their way into tiles (external bucketing), and the moments of each voxel: normals and vegetation (D5)."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS, TileKey

# One point: its voxel, its position in the voxel (m), and the direction to the sensor, its normal, or zeros.
POINT = np.dtype([("column", "<i2", 2), ("layer", "<i4"), ("inside", "<f4", 3), ("side", "<f4", 3)])
BUFFER_BYTES = 128 * 2**20  # in memory; what is beyond goes to disk

PADDING = 16  # voxels at both ends of a row and of a layer
ROW = TILE_VOXELS + 2 * PADDING
LAYER = ROW * ROW

REACH = 2  # neighbourhoods are (2 reach + 1)^3 voxels: cubes of 30 cm at 6 cm
COUNT_CAP = 8.0  # a voxel weighs at most as many points
LEAST_VOXELS = 4  # fewer occupied voxels in a neighbourhood leave its plane or shape open
N_LEVELS = 3  # where a plane is left open (few points, a line, a bush), voxels of 2 and of 4 times the edge are tried
FLATNESS = 0.3  # largest ratio of the smallest to the middle eigenvalue of a plane
HALO_VOXELS = 8  # the coarsest neighbourhood of normals: 2 voxels of 4 cells on each side

SHAPE_EDGE = 0.12  # m, of the voxels whose shape tells vegetation: the power of two of a map's voxels nearest to this
SCATTERED = 0.2  # smallest ratio of eigenvalues, smallest to largest, of scattered points: a house's corner stays below
LEAST_SCATTERED = 0.55  # smallest fraction of scattered voxels within cubes of 1.2 m of vegetation


def point_records(
    points: NDArray[np.float64], sides: NDArray[np.float32], cell: float
) -> tuple[NDArray[np.int32], NDArray[np.void]]:
    """Tiles, shape (n, 2), and records (`POINT`) of points, shape (n, 3), local frame, m, and their sides, (n, 3)."""
    indices = voxel_indices(points, cell)
    records = np.empty(len(points), POINT)
    keys = indices[:, :2] // TILE_VOXELS
    records["column"] = indices[:, :2] - keys * TILE_VOXELS
    records["layer"] = indices[:, 2]
    records["inside"] = points - indices * cell
    records["side"] = sides
    return keys, records


class TileBuckets:
    """Records of one kind sorted into tiles; beyond `BUFFER_BYTES` they are appended to a file per tile."""

    def __init__(self, folder: Path, record: "np.dtype[np.void]", suffix: str) -> None:
        self._folder, self._record, self._suffix = folder, record, suffix
        self._buffers: dict[TileKey, list[NDArray[np.void]]] = defaultdict(list)
        self._buffered_bytes = 0
        self._keys: set[TileKey] = set()
        self._has_files = False

    @property
    def keys(self) -> list[TileKey]:
        """Tiles that got records, sorted."""
        return sorted(self._keys)

    def add(self, keys: NDArray[np.int32], records: NDArray[np.void]) -> None:
        """Take records and the (x, y) of the tile of each, shape (n, 2)."""
        if not len(records):
            return
        corner = keys.min(axis=0)
        x, y = (keys - corner).astype(np.int64).T
        slots = y * (int(x.max()) + 1) + x
        order = np.argsort(slots, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(slots[order])) + 1):
            key_x, key_y = keys[group[0]].tolist()
            self._buffers[key_x, key_y].append(records[group])
        self._keys.update(self._buffers)
        self._buffered_bytes += records.nbytes
        if self._buffered_bytes > BUFFER_BYTES:
            self._flush()

    def complete(self, *, to_disk: bool = False) -> None:
        """Say that all records have come; `to_disk` if other processes will look for them there."""
        if to_disk or self._has_files:
            self._flush()

    def _flush(self) -> None:
        for key, parts in self._buffers.items():
            with self._path(key).open("ab") as file:
                for part in parts:
                    file.write(part.tobytes())
        self._has_files = True
        self._buffers.clear()
        self._buffered_bytes = 0

    def records(self, key: TileKey, n_at_once: int = 2_000_000) -> Iterator[NDArray[np.void]]:
        """Yield the records of a tile, at most `n_at_once` together; FileNotFoundError if there are none."""
        if key in self._buffers:
            whole = np.concatenate(self._buffers[key])
            yield from (whole[start : start + n_at_once] for start in range(0, len(whole), n_at_once))
            return
        with self._path(key).open("rb") as file:
            while part := file.read(n_at_once * self._record.itemsize):
                yield np.frombuffer(part, self._record)

    def load(self, key: TileKey) -> NDArray[np.void]:
        """Return all records of a tile; none if it got none."""
        is_there = key in self._buffers or self._path(key).exists()
        return np.concatenate([np.empty(0, self._record), *(self.records(key) if is_there else ())])

    def remove(self, key: TileKey) -> None:
        """Delete the records of a tile, if there are any."""
        if self._buffers.pop(key, None) is None:
            self._path(key).unlink(missing_ok=True)

    def _path(self, key: TileKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.{self._suffix}"


class TileArrays:
    """Named arrays of tiles between steps, in memory up to `memory_bytes`, else in NPZ files; any thread may call."""

    def __init__(self, folder: Path, memory_bytes: int = 0) -> None:
        self._folder = folder
        self._free_bytes = memory_bytes
        self._in_memory: dict[tuple[TileKey, str], dict[str, NDArray[Any]]] = {}
        self._lock = Lock()

    def put(self, key: TileKey, kind: str, **arrays: NDArray[Any]) -> None:
        """Keep arrays of a tile, in place of earlier ones of this kind on disk."""
        n_bytes = sum(array.nbytes for array in arrays.values())
        with self._lock:
            fits = n_bytes <= self._free_bytes
            self._free_bytes -= n_bytes if fits else 0
        if fits:
            self._in_memory[key, kind] = arrays
            return
        with atomic_file(self._path(key, kind)) as partial, partial.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    def get(self, key: TileKey, kind: str) -> dict[str, NDArray[Any]]:
        """Return the arrays of a tile; FileNotFoundError if there are none."""
        if (kept := self._in_memory.get((key, kind))) is not None:
            return kept
        with np.load(self._path(key, kind), allow_pickle=False) as arrays:
            return dict(arrays)

    def has(self, key: TileKey, kind: str) -> bool:
        """Whether there are arrays of this kind of a tile."""
        return (key, kind) in self._in_memory or self._path(key, kind).exists()

    def _path(self, key: TileKey, kind: str) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.{kind}.npz"


@dataclass(frozen=True, slots=True, eq=False)
class VoxelMoments:
    """Moments of the voxels of one tile (and its halo), by ascending (z, y, x)."""

    # (n, 3): (x, y, z) voxel indices; x and y less the tile's first, so -8 to 519 with the halo
    indices: NDArray[np.int32]
    counts: NDArray[np.float64]  # (n,): Points in each voxel
    sums: NDArray[np.float64]  # (n, 3): Sum of positions from the voxel's corner, m
    outers: NDArray[np.float64]  # (n, 6): Sum of products xx, xy, xz, yy, yz, zz, m^2
    sides: NDArray[np.float64]  # (n, 3): Sum of the points' directions to the sensor, or of their normals

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def keys(self) -> NDArray[np.int64]:
        """Number z * LAYER + y * ROW + x of each voxel, ascending."""
        return voxel_keys(self.indices)

    @property
    def is_own(self) -> NDArray[np.bool_]:
        """Which voxels lie in the tile itself, not in its halo."""
        return np.asarray(((self.indices[:, :2] >= 0) & (self.indices[:, :2] < TILE_VOXELS)).all(axis=1))

    def mean_heights(self, cell: float) -> NDArray[np.float64]:
        """Mean height of the points of each voxel, local frame, m."""
        return np.asarray(self.indices[:, 2] * cell + self.sums[:, 2] / self.counts)

    @classmethod
    def from_records(cls, parts: Iterable[NDArray[np.void]]) -> Self:
        """Moments of points (`POINT`) that come in parts; memory is bounded by the voxels."""
        moments = cls._of_part(np.empty(0, POINT))
        for records in parts:
            moments = cls.concatenate([moments, cls._of_part(records)])
        return moments

    @classmethod
    def _of_part(cls, records: NDArray[np.void]) -> Self:
        indices, voxel = _voxels_of(np.column_stack([records["column"], records["layer"]]).astype(np.int32))
        n, (x, y, z) = len(indices), records["inside"].T.astype(np.float64)
        outers = _sums(voxel, n, (one * other for one, other in ((x, x), (x, y), (x, z), (y, y), (y, z), (z, z))))
        counts = np.bincount(voxel, minlength=n).astype(np.float64)
        return cls(indices, counts, _sums(voxel, n, (x, y, z)), outers, _sums(voxel, n, records["side"].T))

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Moments of all parts; voxels that occur in several are summed."""
        indices, voxel = _voxels_of(np.concatenate([part.indices for part in parts]))

        def total(name: str) -> NDArray[np.float64]:
            return _sums(voxel, len(indices), np.concatenate([getattr(part, name) for part in parts]).T)

        counts = np.bincount(voxel, np.concatenate([part.counts for part in parts]), len(indices))
        return cls(indices, counts.astype(np.float64), total("sums"), total("outers"), total("sides"))

    def select(self, is_chosen: NDArray[np.bool_], shift: tuple[int, int] = (0, 0)) -> Self:
        """Keep some voxels, with x and y moved by `shift` voxels."""
        chosen = {name: values[is_chosen] for name, values in self.arrays.items()}
        chosen["indices"] = chosen["indices"] + np.array([*shift, 0], dtype=np.int32)
        return type(self)(**chosen)

    def coarser(self, edge: float) -> Self:
        """Moments of voxels twice as large; `edge` is that of these voxels, m."""
        from maxcon.mapping.kernels import merge_voxels

        parents = self.indices >> 1
        indices, voxel = _voxels_of(parents)
        n, shifts = len(indices), (self.indices - 2 * parents) * edge
        merged = type(self)(indices, np.zeros(n), np.zeros((n, 3)), np.zeros((n, 6)), np.zeros((n, 3)))
        merge_voxels(voxel, shifts, self.counts, self.sums, self.outers, merged.counts, merged.sums, merged.outers)
        return merged


def voxel_keys(indices: NDArray[np.int32]) -> NDArray[np.int64]:
    """One number per voxel that ascends with (z, y, x); rows are padded, so neighbours in x differ by 1."""
    x, y, z = indices.T.astype(np.int64)
    return np.asarray(z * LAYER + (y + PADDING) * ROW + (x + PADDING))


def _voxels_of(indices: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Indices of the voxels that occur, by ascending (z, y, x), and the number of each row's among them."""
    _, first, voxel = np.unique(voxel_keys(indices), return_index=True, return_inverse=True)
    return indices[first], voxel


def _sums(group: NDArray[np.intp], n: int, columns: Iterable[NDArray[np.floating]]) -> NDArray[np.float64]:
    """Sums of columns, of shape (m,) each, over the rows of each of n groups, shape (n, columns)."""
    return np.column_stack([np.bincount(group, column, n) for column in columns])


def sums_around(
    indices: NDArray[np.int32], values: NDArray[np.float64], reach: int, edge: int = 1
) -> NDArray[np.float64]:
    """Sums of values (n, m) over the (2 reach + 1)^3 blocks, of `edge` voxels, around that of each voxel (n, 3)."""
    from maxcon.mapping.kernels import sums_near

    blocks, block = np.unique(voxel_keys(indices // edge), return_inverse=True)
    of_blocks = _sums(block, len(blocks), values.T)
    totals = np.zeros_like(of_blocks)
    sums_near(blocks, of_blocks, ROW, LAYER, reach, totals)
    return np.asarray(totals[block])


def plane_normals(
    moments: VoxelMoments, cell: float, is_wanted: NDArray[np.bool_], *, is_signed: bool = False
) -> NDArray[np.float64]:
    """Unit normals of wanted voxels, of the smallest neighbourhood with a plane, to the sensor's side if signed."""
    normals = np.zeros((len(moments), 3))
    if len(moments) < LEAST_VOXELS:  # at no level are there more
        return normals
    for level, edge, place in islice(_levels(moments, cell), N_LEVELS):
        is_open = is_wanted & ~normals.any(axis=1)
        is_asked = np.zeros(len(level), bool)
        is_asked[place[is_open]] = True
        values, fitted = _planes(level, edge, is_asked)
        fitted[~((values[:, 1] >= 0.25 * edge * edge) & (values[:, 0] <= FLATNESS * values[:, 1]))] = 0.0
        normals[is_open] = fitted[place[is_open]]
    return turn_to_side(normals, moments.sides) if is_signed else normals


def _planes(
    moments: VoxelMoments, edge: float, is_asked: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues of covariances, ascending, m^2, and normals around voxels, (n, 3); NaN and zeros where left open."""
    from maxcon.mapping.kernels import neighbourhood_planes

    values, normals = np.full((len(moments), 3), np.nan), np.zeros((len(moments), 3))
    neighbourhood_planes(
        moments.keys, moments.counts, moments.sums, moments.outers, is_asked, edge, ROW, LAYER, REACH,
        COUNT_CAP, LEAST_VOXELS, values, normals,
    )  # fmt: skip
    return values, normals


def _levels(moments: VoxelMoments, edge: float) -> Iterator[tuple[VoxelMoments, float, NDArray[np.intp]]]:
    """Yield voxels of this edge (m), of twice, four times ... it, the edge, and which of them holds each first one."""
    place = np.arange(len(moments))
    while True:
        yield moments, edge, place
        coarser = moments.coarser(edge)
        place = np.searchsorted(coarser.keys, voxel_keys(moments.indices >> 1))[place]
        moments, edge = coarser, 2.0 * edge


def turn_to_side(normals: NDArray[np.float64], sides: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn normals, shape (n, 3), to the side of the sensor, shape (n, 3); zeros where the side is not known."""
    return np.asarray(normals * np.sign((normals * sides).sum(axis=1))[:, None])


def is_vegetation(moments: VoxelMoments, cell: float) -> NDArray[np.bool_]:
    """Which voxels of a tile with its halo, without the ground, are vegetation: points scatter in all directions."""
    n_coarser = max(0, round(math.log2(SHAPE_EDGE / cell)))
    level, edge, place = next(islice(_levels(moments, cell), n_coarser, None))
    values, _ = _planes(level, edge, np.ones(len(level), bool))
    is_known = values[:, 2] > 0.0
    is_scattered = np.divide(values[:, 0], values[:, 2], out=np.zeros(len(level)), where=is_known) > SCATTERED
    n_scattered, n_known = sums_around(level.indices, np.column_stack([is_scattered, is_known]), REACH, edge=2).T
    is_green = (n_known > 0.0) & (n_scattered >= LEAST_SCATTERED * n_known)
    return np.asarray(is_green[place])
