"""Work that may be killed at any moment and gone on with: its folder, its table, and whether it is the same work."""

import hashlib
import inspect
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maxcon._system.atomic import LOCK, atomic_file, check_folder, locked, make_folder, sweep
from maxcon.errors import FileError, OptionError

if TYPE_CHECKING:
    import pyarrow


@contextmanager
def work_folder(folder: str | os.PathLike[str], what: str, record: str) -> Iterator[None]:
    """Hold a folder of work while the block runs; one with other files and no `record` is somebody else's."""
    root = Path(folder)
    check_folder(root)
    sweep(root)
    others = sorted(path.name for path in root.iterdir() if path.name != LOCK) if root.exists() else []
    if others and record not in others:
        raise FileError(f"Expected {what} or an empty folder in {root}, but it holds {others[0]}. Name another folder.")
    make_folder(root)
    with locked(root / LOCK, str(root)):
        yield


def describe(value: Any) -> Any:
    """Describe an object as JSON can hold it: the name of its class and its public fields, recursively."""
    if isinstance(value, Enum | np.generic):
        return describe(value.value if isinstance(value, Enum) else value.item())
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return {"class": "array", "type": str(value.dtype), "shape": list(value.shape), "sha256": digest}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, tuple | list):
        return [describe(item) for item in value]
    if isinstance(value, dict):
        return {str(key): describe(item) for key, item in value.items()}
    kind = type(value)
    is_ours = kind.__module__.startswith("maxcon.")
    own = {"class": kind.__qualname__ if is_ours else f"{kind.__module__}.{kind.__qualname__}"}
    if not is_ours:
        own["source"] = _source(kind)
    return own | {key: describe(item) for key, item in _fields(value).items()}


def _source(kind: type) -> str:
    """First 16 digits of the hash of the source of a user's class: it changes when the class is edited."""
    try:
        return hashlib.sha256(inspect.getsource(kind).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        return "unknown"


def _fields(value: Any) -> dict[str, Any]:
    """Public values of an object by their names."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value) if field.repr}
    if not hasattr(value, "__dict__") or isinstance(value, type) or callable(value):
        raise OptionError(
            f"Expected a method made of numbers, words and objects of such, got {value!r} in it, which cannot be"
            " written down. Make it a dataclass, or hide it behind an underscore."
        )
    return {key: item for key, item in sorted(vars(value).items()) if not key.startswith("_")}


def differences(before: Any, now: Any, where: str = "") -> str:
    """Say what differs between two descriptions, values by names: "space.half_width 3.0, got 3.6"."""
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return f"{where or 'it'} {before}, got {now}"
    keys = [key for key in {**before, **now} if before.get(key) != now.get(key)]
    return "; ".join(differences(before.get(key), now.get(key), f"{where}.{key}".strip(".")) for key in keys)


class ResumableTable:
    """Parquet table that grows by parts, each whole or not there, which are merged into one file in the end (D10)."""

    def __init__(self, path: Path, parts: Path, schema: "pyarrow.Schema", keys: Sequence[str], what: str) -> None:
        self.path, self.parts = path, parts  # of the merged file; a folder of this table alone
        self._schema, self._what = schema, what
        self._keys = keys  # columns that name a row, in whose order rows are; of equal ones the merged row counts

    def part_paths(self) -> list[Path]:
        """Return the files of rows that are not merged."""
        return sorted(self.parts.glob("[!.]*.parquet"))

    def add(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write rows as one more part; values left out are null. FileError if it cannot be written."""
        import pyarrow

        table = pyarrow.Table.from_pylist([dict(row) for row in rows], schema=self._schema)
        _write(self.parts / f"{uuid.uuid4().hex}.parquet", table)

    def read(self) -> "pyarrow.Table":
        """Return all rows, merged or not, each key once, in order; FileError if a file is broken."""
        import pyarrow

        paths = [self.path] if self.path.exists() else []
        tables = [self._schema.empty_table(), *map(self.read_file, [*paths, *self.part_paths()])]
        table = pyarrow.concat_tables(tables)
        rows = zip(*(table.column(name).to_pylist() for name in self._keys), strict=True)
        first = {key: row for row, key in reversed(list(enumerate(rows)))}
        kept = table.take(pyarrow.array(sorted(first.values()), pyarrow.int64()))
        return kept.sort_by([(name, "ascending") for name in self._keys])

    def read_file(self, path: Path, columns: Sequence[str] | None = None) -> "pyarrow.Table":
        """Return the rows of a file of this table, or some columns of them; FileError if it is broken."""
        import pyarrow
        import pyarrow.parquet

        names = self._schema.names if columns is None else columns
        schema = pyarrow.schema([self._schema.field(name) for name in names])
        try:
            return pyarrow.parquet.ParquetFile(path).read(names).cast(schema)
        except (OSError, ValueError, pyarrow.ArrowException) as error:
            raise FileError(
                f"Expected {self._what} in {path}, got: {error}. Is it readable? If it is broken, remove it: the same"
                " command makes its rows anew."
            ) from error

    def merge(self) -> "pyarrow.Table":
        """Put all rows into the merged file, remove the parts, and return the rows; FileError if it cannot be done."""
        table = self.read()
        if self.part_paths() or not self.path.exists():
            sweep(self.path.parent, self.path.name)
            _write(self.path, table)
        self.clear()
        return table

    def clear(self) -> None:
        """Remove the parts, with what a kill may have left half written among them."""
        shutil.rmtree(self.parts, ignore_errors=True)


def _write(path: Path, table: "pyarrow.Table") -> None:
    import pyarrow.parquet

    make_folder(path.parent)
    with atomic_file(path) as partial:
        pyarrow.parquet.write_table(table, partial, compression="zstd")
