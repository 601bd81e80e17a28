# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What every reader of point clouds offers: a header, then chunks of points; and what guards their memory."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MaxconError, OptionError

# Most bytes of a file's records that are held at a time: long records make shorter chunks.
MAX_CHUNK_BYTES = 2**28
# Below this a file may unpack to any multiple of its size.
SMALL_BYTES = 2**24


class Bounds(NamedTuple):
    """A rectangle in the coordinates of a file, its sides included."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float


@dataclass(frozen=True, slots=True)
class CloudHeader:
    """What is known of a cloud before its points are read.

    path: the file.
    n_points: how many points it holds.
    crs: coordinate reference system as WKT; None where the file names none that can be used.
    crs_fault: what the file has instead of one, in words; empty where it names none at all.
    has_asprs_classes: whether classes are those of the ASPRS (LAS), not of any scheme.
    has_normals, has_classes, has_times: which of these come with each chunk.
    """

    path: Path
    n_points: int
    crs: str | None = None
    has_normals: bool = False
    has_classes: bool = False
    has_times: bool = False
    has_asprs_classes: bool = False
    crs_fault: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class CloudChunk:
    """Some points of a cloud, as they stand in the file: also those with NaN or infinite coordinates.

    points: shape (k, 3), float64; global coordinates, m.
    normals: shape (k, 3), float64, or None; not checked to be unit vectors.
    classes: shape (k,), uint8, or None; classification codes, e.g. 2 for ground.
    times: shape (k,), float64, or None; gps_time, s.
    is_withheld: shape (k,), bool, or None; points that the file marks as deleted (LAS).
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64] | None = None
    classes: NDArray[np.uint8] | None = None
    times: NDArray[np.float64] | None = None
    is_withheld: NDArray[np.bool_] | None = None


class CloudReader(ABC):
    """An open cloud. Opening reads the header only; each call of `chunks` begins at the first point."""

    header: CloudHeader

    def __init__(self) -> None:
        self._running: list[Generator[CloudChunk]] = []

    @abstractmethod
    def _read(self, max_points: int) -> Generator[CloudChunk]:
        """Yield all points, at most `max_points` at a time, and hold the file open only in between."""

    def _read_within(self, max_points: int, bounds: Bounds) -> Generator[CloudChunk]:
        """As `_read`, without parts of the file that are known to hold no points in a rectangle."""
        return self._read(max_points)

    def close(self) -> None:
        """End all iterations, which closes the file."""
        while self._running:
            self._running.pop().close()

    def chunks(self, max_points: int = 1_000_000, bounds: Bounds | None = None) -> Iterator[CloudChunk]:
        """Return an iterator over the points in order, never holding more than one chunk.

        max_points: most points of one chunk; a million take about 100 MB while they are read. OptionError if it is not
            1 or more.
        bounds: parts of the file known to hold no points there are left out (COPC); others come as a whole.
        """
        if max_points < 1:
            raise OptionError(f"Expected max_points >= 1, got {max_points}. The default is 1,000,000.")
        self._running.append(self._read(max_points) if bounds is None else self._read_within(max_points, bounds))
        return self._running[-1]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@contextmanager
def as_file_error(file: Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser raises on a broken file (also the panics of compiled ones) into FileError.

    `kind` is what the file should be, e.g. "a LAS or LAZ file".
    """
    try:
        yield
    except (MaxconError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        words = (str(error).strip().splitlines() or [type(error).__name__])[0][:120]
        raise FileError(
            f"Expected {file} to be {kind}, complete, got: {words}. Copy it again, or write it anew with the program"
            " it comes from."
        ) from error


def check_unpacked_size(what: str, unpacked: int, packed: int, max_ratio: int, advice: str) -> None:
    """Refuse a large file that claims to unpack to more than `max_ratio` times its bytes: it would exhaust memory."""
    if unpacked > max(SMALL_BYTES, max_ratio * packed):
        raise FileError(
            f"Expected {what} to unpack to at most {max_ratio} times its size, got {unpacked / max(1, packed):.0f}"
            f" times. Is it real data? {advice}"
        )


def as_classes(file: Path, name: str, values: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Return class codes of any type of number as uint8; FileError if one is no whole number from 0 to 255."""
    if values.dtype == np.uint8:
        return np.array(values, dtype=np.uint8)
    numbers = values.astype(np.float64)
    is_code = (numbers >= 0) & (numbers <= 255) & (numbers == np.floor(numbers))
    if not is_code.all():
        raise FileError(
            f"Expected class codes from 0 to 255 as {name!r} in {file}, got {numbers[~is_code][0]:g}."
            " Rename it, if it does not hold classes, or map it to such codes."
        )
    return numbers.astype(np.uint8)


def as_float64(values: NDArray[Any]) -> NDArray[np.float64]:
    """Return a copy as float64; broken files hold bit patterns that numpy would warn of."""
    with np.errstate(invalid="ignore", over="ignore"):
        return values.astype(np.float64)


def rows_at_a_time(max_points: int, record_bytes: int) -> int:
    """How many records of a file to hold at a time: at most `max_points`, and at most 256 MiB."""
    return max(1, min(max_points, MAX_CHUNK_BYTES // max(1, record_bytes)))
