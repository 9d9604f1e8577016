"""Recordings of messages of any type, as ROS 2 (`ros2 bag`) and Foxglove read and write them.

with BagWriter("run.mcap") as bag:
    bag.write("/joint_states", message, time=1_500_000_000)
for topic, time, message in Bag("run.mcap").messages():
    ...
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, NamedTuple, Self

from pepper_kin.exceptions import (
    FileFormatError,
    FileFormatWarning,
    InvalidValueError,
    UnknownNameError,
    optional,
    shortened,
)
from pepper_kin.file_access.atomic_file import PathName, as_path, whole_file
from pepper_kin.ros_messages.cdr import decode, encode
from pepper_kin.ros_messages.definitions import full_name, message_names
from pepper_kin.ros_messages.errors import MessageError
from pepper_kin.ros_messages.messages import Message, message_type
from pepper_kin.ros_messages.recorded import RecordedTopic
from pepper_kin.ros_messages.rosbag2_storage import open_storage
from pepper_kin.ros_messages.schemas import schema_text, schema_type

_ENCODING, _SCHEMA = "cdr", "ros2msg"
_NO_SYNTAX = ("", "unknown")  # what rosbag2 states of a type whose definition it did not find


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
        writer = optional("mcap.writer", extra="mcap", need="an MCAP file")
        self.path = as_path(path)
        self._channels: dict[str, tuple[str, int]] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._whole: AbstractContextManager[BinaryIO] | None = whole_file(path)
        self._writer = writer.Writer(self._whole.__enter__())
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
        path: An MCAP file, with or without a summary; the folder of a bag (`metadata.yaml` and its files,
            compressed by zstd or not); or a `.db3` file.

    Raises:
        MissingDependencyError: where the package `mcap` is needed and not installed.
        FileFormatError: where it cannot be read or is not a complete recording.
    """

    def __init__(self, path: PathName) -> None:
        self.path = path
        self._storage = open_storage(path)
        self._classes: dict[RecordedTopic, type[Message]] = {}

    @cached_property
    def topics(self) -> dict[str, str]:
        """Name -> type of all topics; "" for a topic without a type.

        Raises:
            FileFormatError: as the class.
        """
        return dict(sorted((topic.name, topic.type_name) for topic in self._storage.topics()))

    def messages(
        self, topics: Collection[str] | None = None, types: Collection[str] | None = None
    ) -> Iterator[BagMessage]:
        """Yield messages in the order of their times.

        Args:
            topics: Only of these topics.
            types: Only of these types, by full name.

        Raises:
            UnknownNameError: for one of `topics` that the recording does not have.
            FileFormatError: for a damaged file, naming topic and time of a message that cannot be read, or
                the topic that was chosen and is not of ROS 2, or whose definition cannot be used.

        Warns:
            FileFormatWarning: naming each topic that is left out for such a reason where none was chosen.
        """
        for name in topics or ():
            if name not in self.topics:
                raise UnknownNameError("topic", name, self.topics)
        chosen = set()
        for topic in self._storage.topics():
            if topics is not None and topic.name not in topics:
                continue
            if types is not None and full_name(topic.type_name) not in types:
                continue
            try:
                self._classes[topic] = _class_of(topic)
            except MessageError as error:
                reason = f"{shortened(topic.name)}: {shortened(error)}"
                if topics is not None or types is not None:
                    raise FileFormatError(self.path, reason) from error
                what = f"{self.path}: left out {reason}"
                warnings.warn(what, FileFormatWarning, stacklevel=2)
            else:
                chosen.add(topic)
        for topic, time, data in self._storage.records(chosen.__contains__):
            try:
                message = decode(self._classes[topic], data)
            except (MessageError, UnicodeDecodeError, RecursionError) as error:
                reason = f"{shortened(topic.name)} at {time} ns: {shortened(error)}"
                raise FileFormatError(self.path, reason) from error
            yield BagMessage(topic.name, time, message)


def _class_of(topic: RecordedTopic) -> type[Message]:
    """Return the class of a topic's messages; MessageError where they are not of ROS 2, saying why."""
    name = full_name(topic.type_name)
    if topic.serialization != _ENCODING:
        reason = f"messages are stored as {topic.serialization!r}, expected {_ENCODING!r}"
        raise MessageError(topic.type_name or "no type", reason)
    if topic.syntax in _NO_SYNTAX and not topic.definition.strip():
        if name in message_names():
            return message_type(name)
        raise MessageError(topic.type_name or "no type", "the recording has no definition of it")
    if topic.syntax != _SCHEMA:
        raise MessageError(topic.type_name, f"is defined in {topic.syntax!r}, expected {_SCHEMA!r}")
    try:
        return schema_type(topic.type_name, topic.definition.decode())
    except (UnicodeDecodeError, RecursionError) as error:
        raise MessageError(topic.type_name, f"definition cannot be read: {error}") from error
