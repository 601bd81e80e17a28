# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What every recording offers: opening lists its topics, iterating yields the messages of some of them."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.text import printable

__all__ = ["LARGEST_CHUNK", "Message", "Recording", "Topic", "as_extra_missing", "printable"]

LARGEST_CHUNK = 2**29
"""Bytes; recorders write chunks of about a megabyte, and more where a single message is larger."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One stream of messages of a kind.

    Parameters
    ----------
    name : str
        Such as /points.
    type : str
        Kind of its messages: sensor_msgs/msg/PointCloud2.
    n_messages : int
        How many there are.
    """

    name: str
    type: str
    n_messages: int

    @property
    def words(self) -> str:
        """Return "/points (sensor_msgs/msg/PointCloud2)", on one line whatever the name."""
        return f"{printable(self.name)} ({printable(self.type)})"


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """One message, not decoded yet.

    Parameters
    ----------
    topic : str
        Name of its topic.
    type : str
        Its kind.
    encoding : str
        cdr (ROS 2) or ros1; others cannot be decoded.
    recorded : int
        When it was recorded, ns.
    data : bytes
        Its content.
    """

    topic: str
    type: str
    encoding: str
    recorded: int
    data: bytes


class Recording(ABC):
    """An open recording. Opening reads its index, iterating one chunk of it after the other.

    Parameters
    ----------
    path : Path
        The file, or the folder of several.
    """

    kind = "a recording"
    topics: tuple[Topic, ...]
    notes: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        self.path = path
        self._running: list[Generator[Message]] = []

    @abstractmethod
    def _read(self, topics: Collection[str], start: int | None) -> Generator[Message]:
        """Yield the messages of some topics, from a time of recording (ns) on."""

    def messages(self, topics: Collection[str], start: int | None = None) -> Iterator[Message]:
        """Yield the messages of some topics in the order of their recording, one in memory at a time.

        Parameters
        ----------
        topics : collection of str
            Names.
        start : int, optional
            Messages recorded before this time, ns, are passed over.

        Raises
        ------
        FileError
            If the recording is broken.
        """
        running = self._guarded(topics, start)
        self._running.append(running)
        return running

    def _guarded(self, topics: Collection[str], start: int | None) -> Generator[Message]:
        with as_file_error(self.path, self.kind):
            yield from self._read(topics, start)

    def of_type(self, *types: str) -> list[Topic]:
        """Return the topics of some kinds that have messages."""
        return [topic for topic in self.topics if topic.type in types and topic.n_messages]

    def close(self) -> None:
        """End all iterations and close the files."""
        while self._running:
            with suppress(FileError):
                self._running.pop().close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def as_extra_missing(path: Path, package: str) -> MissingExtraError:
    """Return the error of a recording that needs a package which is not installed."""
    return MissingExtraError(
        f"Expected the package {package} to read {path}, got none installed. pip install 'maxcon[recordings]'"
    )
