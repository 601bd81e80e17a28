# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""RecordedCloud: one cloud of a recording; and where clouds come from, a topic or a capture."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from maxcon.errors import FileError
from maxcon.io.point_times import PointTimes
from maxcon.io.recordings.point_cloud2 import CloudPoints, CloudRecord, FieldDescription, decode_cloud, decode_times

__all__ = ["CloudSource", "RecordedCloud"]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedCloud:
    """One cloud of a recording, decoded when it is asked for its content.

    Parameters
    ----------
    label : str
        File and topic, for messages.
    recorded : int
        When it was recorded, ns.
    stamp : int
        Time of its message, ns.
    record : CloudRecord or FileError
        The cloud as stored, or why its message cannot be read.
    """

    label: str
    recorded: int
    stamp: int
    record: CloudRecord | FileError

    def points(self) -> CloudPoints:
        """Return its returns.

        Raises
        ------
        FileError
            If it is broken.
        """
        with self._naming():
            return decode_cloud(self._record())

    def times(self) -> PointTimes:
        """Return the times of its returns; errors as of `points`."""
        with self._naming():
            return decode_times(self._record())

    @property
    def fields(self) -> tuple[FieldDescription, ...]:
        """What was stored of each point."""
        return () if isinstance(self.record, FileError) else self.record.fields

    def _record(self) -> CloudRecord:
        if isinstance(self.record, FileError):
            raise self.record
        return self.record

    @contextmanager
    def _naming(self) -> Iterator[None]:
        try:
            yield
        except FileError as error:
            if error is self.record:
                raise
            raise FileError(f"{self.label}: {error}") from error


class CloudSource(ABC):
    """Clouds of one scanner; opening one reads none of them."""

    path: Path
    label: str
    notes: tuple[str, ...] = ()
    n_clouds: int = 0
    """Number of clouds; 0 if it is not known without reading them all."""

    @property
    def frame(self) -> str:
        """Name of the scanner's frame, where its clouds tell it; one is read."""
        return ""

    @abstractmethod
    def clouds(self, start: int | None = None) -> Iterator[RecordedCloud]:
        """Yield the clouds in the order of their recording, from a time of recording (ns) on, one in memory at a time.

        Raises
        ------
        FileError
            If the recording is broken.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the files."""
