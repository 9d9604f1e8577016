"""Recordings of messages of any type as MCAP files, which ROS 2 (`ros2 bag`) and Foxglove read and write.

with BagWriter("run.mcap") as bag:
    bag.write("/joint_states", message, time=1_500_000_000)
for topic, time, message in Bag("run.mcap").messages():
    ...
"""

from __future__ import annotations

import io
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple, Self

from pepper_kin.exceptions import FileFormatError, InvalidValueError, MissingDependencyError, shortened
from pepper_kin.file_access.atomic_file import PathName, as_path, whole_file
from pepper_kin.file_access.reading import read_bytes
from pepper_kin.ros_messages.cdr import decode, encode
from pepper_kin.ros_messages.errors import MessageError
from pepper_kin.ros_messages.messages import Message
from pepper_kin.ros_messages.schemas import schema_text, schema_type

_ENCODING, _SCHEMA = "cdr", "ros2msg"

MOST_BYTES = 250_000_000
"""Most that is decompressed [bytes] of a file that is small; of others MOST_TIMES their size."""
MOST_TIMES = 50


class BagMessage(NamedTuple):
    """A message of a recording.

    Attributes:
        topic: Where it was published.
        time: When it was recorded [ns].
        message: The message; its class is the package's where the recording's definition agrees with it,
            otherwise one that is made from that definition.
    """

    topic: str
    time: int
    message: Message


class BagWriter:
    """Writes messages to a file, which is there, whole, after `close`; a context manager.

    Where the context ends by an exception, nothing is left.

    Args:
        path: The file; its folder must exist.

    Raises:
        MissingDependencyError: where the package `mcap` is not installed.
        FileFormatError: where the file cannot be written.
    """

    def __init__(self, path: PathName) -> None:
        try:
            from mcap.writer import Writer
        except ImportError as error:
            raise missing() from error
        self.path = as_path(path)
        self._channels: dict[str, tuple[str, int]] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._whole: AbstractContextManager[BinaryIO] | None = whole_file(path)
        self._writer = Writer(self._whole.__enter__())
        self._writer.start(profile="ros2", library="pepper_kin")

    def write(self, topic: str, message: Message, time: int) -> None:
        """Append a message.

        Args:
            topic: Where it was published.
            message: Of the type of the topic's first message.
            time: When [ns], not below 0.

        Raises:
            InvalidValueError: naming the field, for a value that the type cannot hold; for another time.
            FileFormatError: for a topic with messages of another type, after `close`, or where the file
                cannot be written.
        """
        if self._whole is None:
            raise FileFormatError(self.path, "is complete: nothing can be added")
        type_name, channel = self._channels.get(topic, (message.type_name, -1))
        if type_name != message.type_name:
            raise FileFormatError(self.path, f"topic {topic} has {type_name}, not {message.type_name}")
        if not 0 <= time < 1 << 64:
            raise InvalidValueError("time", time, "nanoseconds from 0 to 2**64 - 1")
        data = encode(message)
        try:
            if channel < 0:
                channel = self._writer.register_channel(topic, _ENCODING, self._schema(type(message)))
                self._channels[topic] = type_name, channel
            count = self._counts[channel] = self._counts.get(channel, -1) + 1
            self._writer.add_message(channel, log_time=time, data=data, publish_time=time, sequence=count)
        except OSError as error:
            self.discard()
            raise FileFormatError(self.path, f"cannot be written: {error.strerror or error}") from error

    def close(self) -> Path:
        """Complete the file and return its path; a second call does nothing.

        Raises:
            FileFormatError: where it cannot be written; nothing is left then.
        """
        if self._whole is not None:
            try:
                self._writer.finish()
            except OSError as error:
                self.discard()
                raise FileFormatError(self.path, f"cannot be written: {error.strerror or error}") from error
            whole, self._whole = self._whole, None
            whole.__exit__(None, None, None)
        return self.path

    def discard(self) -> None:
        """Leave nothing of it; what was at the path before stays."""
        if self._whole is not None:
            whole, self._whole = self._whole, None
            with suppress(_DiscardedError):
                whole.__exit__(_DiscardedError, _DiscardedError(), None)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close, or discard after an exception."""
        if kind is None:
            self.close()
        else:
            self.discard()

    def _schema(self, kind: type[Message]) -> int:
        if kind.type_name not in self._schemas:
            data = schema_text(kind).encode()
            self._schemas[kind.type_name] = self._writer.register_schema(kind.type_name, _SCHEMA, data)
        return self._schemas[kind.type_name]


class _DiscardedError(Exception):
    """Ends the context of a file that is not wanted."""


class Bag:
    """A recording that is read.

    Args:
        path: The file.

    Raises:
        MissingDependencyError: where the package `mcap` is not installed.
        FileFormatError: where it cannot be read or is not a complete MCAP file.
    """

    def __init__(self, path: PathName) -> None:
        try:
            from mcap.reader import make_reader
        except ImportError as error:
            raise missing() from error
        self.path = path
        self._content = read_bytes(path)
        self._make_reader: Any = make_reader
        self._classes: dict[int, type[Message]] = {}

    @cached_property
    def topics(self) -> dict[str, str]:
        """Name -> type of all topics; "" for a topic without a type.

        Raises:
            FileFormatError: as the class.
        """
        try:
            self._check_size()
            summary = self._reader().get_summary()
        except FileFormatError:
            raise
        except Exception as error:  # a damaged file makes the library fail in ways without a common base
            raise self._damaged(error) from error
        if summary is None:
            raise FileFormatError(self.path, "is not a complete MCAP file: it has no summary")
        found = {}
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            found[channel.topic] = "" if schema is None else schema.name
        return dict(sorted(found.items()))

    def messages(
        self, topics: Collection[str] | None = None, types: Collection[str] | None = None
    ) -> Iterator[BagMessage]:
        """Yield messages in the order of their times.

        Args:
            topics: Only of these topics.
            types: Only of these types, by full name; otherwise of all that ROS 2 has written.

        Raises:
            FileFormatError: for a damaged file, naming topic and time of a message that cannot be read.
        """
        source = self._records(topics, types)
        while True:
            try:
                schema, channel, record = next(source)
            except StopIteration:
                return
            except FileFormatError:
                raise
            except Exception as error:  # as above
                raise self._damaged(error) from error
            try:
                if schema.id not in self._classes:
                    self._classes[schema.id] = schema_type(schema.name, schema.data.decode())
                message = decode(self._classes[schema.id], record.data)
            except (MessageError, UnicodeDecodeError, RecursionError) as error:
                reason = f"{shortened(channel.topic)} at {record.log_time} ns: {shortened(error)}"
                raise FileFormatError(self.path, reason) from error
            yield BagMessage(channel.topic, int(record.log_time), message)

    def _records(
        self, topics: Collection[str] | None, types: Collection[str] | None
    ) -> Iterator[tuple[Any, Any, Any]]:
        self.topics  # noqa: B018  # a file without a summary is refused
        for schema, channel, record in self._reader().iter_messages():
            if topics is not None and channel.topic not in topics:
                continue
            if schema is None or schema.encoding != _SCHEMA or channel.message_encoding != _ENCODING:
                continue
            if types is None or schema.name in types:
                yield schema, channel, record

    def _check_size(self) -> None:
        """Refuse a file that is small and takes all memory when it is decompressed."""
        from mcap.records import Chunk
        from mcap.stream_reader import StreamReader

        most, size = max(MOST_BYTES, MOST_TIMES * len(self._content)), 0
        for record in StreamReader(io.BytesIO(self._content), emit_chunks=True).records:
            if isinstance(record, Chunk):
                size += _decompressed_size(record, most)
            if size > most:
                raise FileFormatError(self.path, f"is more than {most} bytes when decompressed")

    def _reader(self) -> Any:
        return self._make_reader(io.BytesIO(self._content), validate_crcs=True)

    def _damaged(self, error: Exception) -> FileFormatError:
        what = f"{type(error).__name__}: {shortened(error)}"
        return FileFormatError(self.path, f"is not a complete MCAP file: {what}")


def _decompressed_size(chunk: Any, most: int) -> int:
    """Return how many bytes the package `mcap` will make of a chunk, or any number above `most`."""
    if chunk.compression == "zstd":
        import zstandard

        # What the frame announces is made, whatever the chunk announces; else that is the limit.
        announced = int(zstandard.frame_content_size(chunk.data))
        return announced if announced >= 0 else int(chunk.uncompressed_size)
    if chunk.compression == "lz4":
        import lz4.frame

        announced = int(lz4.frame.get_frame_info(chunk.data)["content_size"])
        if announced > most:  # so much is set aside before anything is decompressed
            return announced
        return len(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1))
    return max(int(chunk.uncompressed_size), len(chunk.data))


def missing() -> MissingDependencyError:
    """Return the error for the package `mcap`."""
    return MissingDependencyError("mcap", 'pip install "pepper_kin[mcap]"', "an MCAP file")
