"""Opens a bag of ROS 1, a bag of ROS 2, or an MCAP file, by its path; chunks of them unpack within bounds."""

import bz2
import io
import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from maxcon.errors import FileError, needs_extra
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.recording import Message, Recording, Topic
from maxcon.io.text import SCAN_SUFFIXES, in_natural_order

LARGEST_CHUNK = 2**29  # bytes; recorders write chunks of about a megabyte, and more where a single message is larger
RECORDING_SUFFIXES = (".bag", ".mcap", ".db3")
CAPTURE_SUFFIX = ".pcap"


def is_recording(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a recording or a capture by its suffix, or the folder of a ROS 2 bag without scans in files."""
    place = Path(path)
    if not os.path.isdir(place):  # noqa: PTH112  (a name that is too long is no folder, not an error)
        return place.suffix.lower() in (*RECORDING_SUFFIXES, CAPTURE_SUFFIX)
    try:
        names = [file.name for file in place.iterdir() if file.is_file()]
    except OSError:
        return False
    suffixes = {Path(name).suffix.lower() for name in names}
    return ("metadata.yaml" in names or ".mcap" in suffixes) and suffixes.isdisjoint(SCAN_SUFFIXES)


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return a path that is a file; FileError if it is missing, a folder, or a pipe."""
    place = Path(path)
    if not os.path.isfile(place):  # noqa: PTH113
        got = "which is no file" if os.path.lexists(place) else "no such file or folder"
        raise FileError(f"Expected a recording at {place}, got {got}. Check the path.")
    return place


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Open a .bag (ROS 1), a .mcap, a .db3, or the folder of a ROS 2 bag; its index is read, no message."""
    place = Path(path)
    suffix = place.suffix.lower()
    if os.path.lexists(place) and (suffix == CAPTURE_SUFFIX or not is_recording(place)):
        raise FileError(
            f"Expected a recording with suffix {', '.join(RECORDING_SUFFIXES)}, or the folder of a ROS 2 bag, got"
            f" {place}. Check the path."
        )
    if os.path.isdir(place):  # noqa: PTH112
        files = in_natural_order([file for file in place.glob("*.mcap") if file.is_file()])
        return _open_mcap(place, files) if files else _open_bag(place, is_ros1=False)
    file = existing_file(place)
    return _open_mcap(file, [file]) if suffix == ".mcap" else _open_bag(file, is_ros1=suffix == ".bag")


def _open_bag(path: Path, *, is_ros1: bool) -> Recording:
    """Open a .bag of ROS 1; or a folder of ROS 2 with .db3 files and their metadata.yaml, or one .db3 file."""
    kind, encoding = ("a ROS 1 bag", "ros1") if is_ros1 else ("a ROS 2 bag", "cdr")
    counts: Counter[tuple[str, str]] = Counter()  # a topic has a connection for each of its publishers
    with as_file_error(path, kind):
        with needs_extra("rosbags", f"to read {path}", "recordings"):
            if is_ros1:
                import lz4.frame  # for the chunks
                from rosbags.rosbag1 import Reader
            else:
                from rosbags.rosbag2 import Reader  # type: ignore[assignment]
        reader: Any = Reader(path)
        reader.open()
        for connection in reader.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
    if is_ros1:  # rosbags does not bound what a chunk unpacks to
        bounded = {bz2.decompress: bz2.BZ2Decompressor, lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor}
        for position, chunk in list(reader.chunks.items()):
            if chunk.decompressor in bounded:
                unpack = partial(_bounded, bounded[chunk.decompressor])
                reader.chunks[position] = chunk._replace(decompressor=unpack)

    def read(topics: Collection[str], start: int) -> Iterator[Message]:
        if wanted := [connection for connection in reader.connections if connection.topic in topics]:
            for connection, recorded, data in reader.messages(connections=wanted, start=start or None):
                yield Message(connection.topic, connection.msgtype, encoding, recorded, data)

    return Recording(path, kind, _topics_of(counts), read, reader.close)


def _topics_of(counts: Counter[tuple[str, str]]) -> tuple[Topic, ...]:
    return tuple(Topic(*key, count) for key, count in sorted(counts.items()))


def _bounded(decompressor: Callable[[], Any], packed: bytes) -> bytes:
    """Unpack a chunk, but no more than one may hold."""
    data: bytes = decompressor().decompress(packed, LARGEST_CHUNK + 1)
    if len(data) > LARGEST_CHUNK:
        raise ValueError(f"a chunk that unpacks to more than {LARGEST_CHUNK:,} bytes")
    return data


def _open_mcap(path: Path, names: Sequence[Path]) -> Recording:
    """Open one MCAP file, or the several of a bag (whose folder is `path`) in the order of time."""
    with needs_extra("mcap", f"to read {path}", "recordings"):
        import mcap.records  # noqa: F401
    kind, files, counts = "an MCAP file", list[_McapFile](), Counter[tuple[str, str]]()
    for name in names:
        with as_file_error(name, kind):
            file = _McapFile(name)
            for channel, count in file.counts.items():
                counts[file.channels[channel].topic, file.type_of(channel)] += count
            files.append(file)
    cut_off = [file.path.name for file in files if not file.is_closed]
    notes = tuple(f"{name} was not closed by its recorder: what is whole in it is read" for name in cut_off)

    def read(topics: Collection[str], start: int) -> Iterator[Message]:
        for file in files:
            yield from file.messages(topics, start)

    return Recording(path, kind, _topics_of(counts), read, notes=notes)


class _McapFile:
    """One MCAP file: its channels with their schemas, how many messages each has, and where its chunks are."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Any] = {}
        self.schemas: dict[int, Any] = {}
        self.counts: Counter[int] = Counter()
        self.is_closed = True
        self._chunks: list[Any] = []
        with _BoundedFile(path) as stream:
            if not self._read_summary(stream):
                self.channels, self.schemas, self._chunks = {}, {}, []
                stream.seek(0)
                found = (record.channel_id for record in self._from_beginning(stream))
                self.counts = Counter(channel for channel in found if channel in self.channels)

    def type_of(self, channel: int) -> str:
        """Type of the messages of a channel, as ROS 2 writes it."""
        schema = self.schemas.get(self.channels[channel].schema_id)
        name = schema.name if schema is not None else "no schema"
        package, slash, kind = name.partition("/")
        return f"{package}/msg/{kind}" if slash and "/" not in kind else name

    def messages(self, topics: Collection[str], start: int) -> Iterator[Message]:
        """Yield the messages of some topics recorded at a time (ns) or later, by time within each chunk."""
        wanted = {key: channel for key, channel in self.channels.items() if channel.topic in topics}
        types = {key: self.type_of(key) for key in wanted}
        with _BoundedFile(self.path) as stream:
            for record in self._of_chunks(stream, start) if self._chunks else self._from_beginning(stream):
                if record.channel_id in wanted and record.log_time >= start:
                    of, kind = wanted[record.channel_id], types[record.channel_id]
                    yield Message(of.topic, kind, of.message_encoding, record.log_time, record.data)

    def _read_summary(self, stream: BinaryIO) -> bool:
        """Take what the end of the file says of its content; False where it says nothing, or not enough."""
        from mcap.exceptions import McapError
        from mcap.reader import SeekingReader

        size = stream.seek(0, io.SEEK_END)
        stream.seek(0)
        try:
            summary = SeekingReader(stream, record_size_limit=LARGEST_CHUNK).get_summary()
        except (McapError, OSError, ValueError, KeyError):
            return False
        if summary is None or summary.statistics is None or not summary.chunk_indexes:
            return False
        self.channels, self.schemas = dict(summary.channels), dict(summary.schemas)
        counts = summary.statistics.channel_message_counts
        self.counts = Counter({key: count for key, count in counts.items() if key in self.channels})
        self._chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.message_start_time)
        return all(chunk.chunk_start_offset + chunk.chunk_length <= size for chunk in self._chunks)

    def _of_chunks(self, stream: BinaryIO, start: int) -> Iterator[Any]:
        """Yield the message records of chunks that end at a time (ns) or later."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk
        from mcap.records import Message as MessageRecord

        for index in self._chunks:
            if index.message_end_time >= start:
                stream.seek(index.chunk_start_offset + 9)  # behind its kind and length
                records = unpacked_records(Chunk.read(ReadDataStream(stream)))
                messages = [record for record in records if isinstance(record, MessageRecord)]
                yield from sorted(messages, key=lambda record: record.log_time)

    def _from_beginning(self, stream: BinaryIO) -> Iterator[Any]:
        """Yield the message records in the order of the file, up to where it was cut off."""
        from mcap.exceptions import EndOfFile
        from mcap.records import Channel, Chunk, Footer, Schema
        from mcap.records import Message as MessageRecord
        from mcap.stream_reader import StreamReader

        self.is_closed = False
        records = StreamReader(stream, emit_chunks=True, record_size_limit=LARGEST_CHUNK).records
        while True:
            try:
                record = next(records, None)
                parts = unpacked_records(record) if isinstance(record, Chunk) else [record]
            except (EndOfFile, _TruncatedError):
                return
            if record is None:
                return
            for part in parts:
                if isinstance(part, Channel):
                    self.channels[part.id] = part
                elif isinstance(part, Schema):
                    self.schemas[part.id] = part
                elif isinstance(part, MessageRecord):
                    yield part
            self.is_closed |= isinstance(record, Footer)


class _BoundedFile(io.BufferedReader):
    """A file of which no more is read than there is: a buffer is never as large as what a header claims."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))

    def read(self, size: int | None = -1, /) -> bytes:
        """Return so many bytes, or those that are left."""
        if size is not None and size > io.DEFAULT_BUFFER_SIZE:
            size = min(size, max(0, os.fstat(self.fileno()).st_size - self.tell()))
        return super().read(size)


class _TruncatedError(Exception):
    """The last chunk of a file ends before it should."""


def unpacked_records(chunk: Any) -> list[Any]:
    """Return the records of a chunk; ValueError if it claims, another error if it holds, another number of bytes."""
    from mcap.stream_reader import breakup_chunk

    size, packed = chunk.uncompressed_size, chunk.data
    if size > LARGEST_CHUNK or chunk.compression not in ("", "zstd", "lz4"):
        raise ValueError(f"a chunk of {size:,} bytes packed by {chunk.compression[:20]!r}")
    # Unpack at most one byte more than there should be.
    if chunk.compression == "zstd":
        from zstandard import ZstdDecompressor

        with ZstdDecompressor().stream_reader(packed) as stream:
            packed = bytes(stream.read(size + 1))
    elif chunk.compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        packed = bytes(LZ4FrameDecompressor().decompress(packed, size + 1))
    if len(packed) != size:
        raise _TruncatedError(f"a chunk of {len(packed):,} bytes instead of {size:,}")
    return breakup_chunk(replace(chunk, compression="", data=packed), validate_crc=True)
