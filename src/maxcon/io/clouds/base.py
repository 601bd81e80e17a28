"""What every reader of point clouds offers: a header, then chunks of points; and what guards their memory."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MaxconError

MAX_CHUNK_BYTES = 2**28  # of a file's records that are held at a time: long records make shorter chunks
SMALL_BYTES = 2**24  # below this a file may unpack to any multiple of its size


class Bounds(NamedTuple):
    """A rectangle in the coordinates of a file, its sides included."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float


@dataclass(frozen=True, slots=True)
class CloudHeader:
    """What is known of a cloud before its points are read."""

    path: Path
    n_points: int
    crs: str | None = None  # coordinate reference system as WKT; None where the file names none that can be used
    has_normals: bool = False  # likewise classes and times: whether they come with each chunk
    has_classes: bool = False
    has_times: bool = False
    has_asprs_classes: bool = False  # whether classes are those of the ASPRS (LAS), not of any scheme
    crs_fault: str = ""  # what the file has instead of one, in words; empty where it names none at all
    reader: "CloudReader | None" = None  # of what is no file for `open_cloud`; `n_points` is an estimate then


@dataclass(frozen=True, slots=True, eq=False)
class CloudChunk:
    """Some points of a cloud, as they stand in the file: also those with NaN or infinite coordinates."""

    points: NDArray[np.float64]  # shape (k, 3), float64; global coordinates, m
    normals: NDArray[np.float64] | None = None  # shape (k, 3), float64, or None; not checked to be unit vectors
    classes: NDArray[np.uint8] | None = None  # shape (k,), uint8, or None; classification codes, e.g. 2 for ground
    times: NDArray[np.float64] | None = None  # shape (k,), float64, or None; gps_time, s
    is_withheld: NDArray[np.bool_] | None = None  # shape (k,), or None; marked as deleted by the file (LAS)


def cloud_chunk(**columns: NDArray[Any]) -> CloudChunk:
    """Return points, and normals, classes, times if given, of any types of numbers; ValueError if a class is none."""
    as_own = {"classes": _as_classes}
    converted: dict[str, Any] = {name: as_own.get(name, as_float64)(values) for name, values in columns.items()}
    return CloudChunk(**converted)


class CloudReader(ABC):
    """An open cloud. Opening reads the header only; each call of `chunks` begins at the first point."""

    header: CloudHeader

    def __init__(self) -> None:
        self._running: list[Generator[CloudChunk]] = []

    @abstractmethod
    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        """Yield the points as `chunks` does, and hold the file open only in between."""

    def chunks(self, max_points: int = 1_000_000, bounds: Bounds | None = None) -> Iterator[CloudChunk]:
        """Return an iterator over the points in order, one chunk in memory; of COPC without parts outside of bounds."""
        self._running.append(self._read(max_points, bounds))
        return self._running[-1]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        while self._running:
            self._running.pop().close()


@contextmanager
def as_file_error(file: Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser raises on a broken file (also the panics of compiled ones) into FileError."""
    try:
        yield
    except (MaxconError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        said = (error.strerror if isinstance(error, OSError) else None) or str(error).strip()
        words = (said.splitlines() or [type(error).__name__])[0][:200].rstrip(".")
        raise FileError(
            f"Expected {file} to be {kind}, complete, got: {words}. Copy it again, or write it anew with the program"
            " it comes from."
        ) from error


def check_unpacked_size(unpacked: int, packed: int, max_ratio: int) -> None:
    """Refuse a large file that claims to unpack to more than `max_ratio` times its bytes: it would exhaust memory."""
    if unpacked > max(SMALL_BYTES, max_ratio * packed):
        times = unpacked / max(1, packed)
        raise ValueError(f"points that unpack to {times:.0f} times their size, not at most {max_ratio} as real ones")


def _as_classes(values: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Return class codes of any type of number as uint8; ValueError if one is no whole number from 0 to 255."""
    numbers = values.astype(np.float64)
    is_code = (numbers >= 0) & (numbers <= 255) & (numbers == np.floor(numbers))
    if not is_code.all():
        raise ValueError(f"{numbers[~is_code][0]:g} as a class, which is no code from 0 to 255")
    return numbers.astype(np.uint8)


def as_float64(values: NDArray[Any]) -> NDArray[np.float64]:
    """Return a copy as float64; broken files hold bit patterns that numpy would warn of."""
    with np.errstate(invalid="ignore", over="ignore"):
        return values.astype(np.float64)


def rows_at_a_time(max_points: int, record_bytes: int) -> int:
    """How many records of a file to hold at a time: at most `max_points`, and at most 256 MiB."""
    return max(1, min(max_points, MAX_CHUNK_BYTES // max(1, record_bytes)))
