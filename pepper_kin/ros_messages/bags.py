"""Recordings of messages of any type, in the formats of ROS 2 (`ros2 bag`) and Foxglove.

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
_NO_SYNTAX = ("", "unknown")  # rosbag2's value for a type without a known definition


class BagMessage(NamedTuple):
    """A message of a recording.

    Attributes:
        topic: Topic of the message.
        time: Time of recording [ns].
        message: The message, of the package's class if the recording's definition agrees with it,
            otherwise of a class created from that definition.
    """

    topic: str
    time: int
    message: Message


class BagWriter:
    """Writer of messages to a file, which is complete after `close`; a context manager.

    If the context ends by an exception, no file is left.

    Args:
        path: The file; its folder must exist.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
        FileFormatError: if the file cannot be written.
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
            topic: Topic of the message.
            message: Message of the same type as the topic's first one.
            time: Time of recording [ns], not below 0.

        Raises:
            InvalidValueError: for a value that the type cannot hold, with the field's name; an invalid time.
            FileFormatError: for a topic with messages of another type, after `close`, or if the file
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
            FileFormatError: if it cannot be written; no file is left then.
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
        """Delete the unfinished file; an earlier file at the path stays."""
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
    """Raised to end the context of a discarded file."""


class Bag:
    """Reader of a recording.

    Args:
        path: MCAP file, with or without a summary; folder of a bag (`metadata.yaml` and its files,
            compressed by zstd or not); or a `.db3` file.

    Raises:
        MissingDependencyError: if the package `mcap` is needed and not installed.
        FileFormatError: if it cannot be read or is not a complete recording.
    """

    def __init__(self, path: PathName) -> None:
        self.path = path
        self._storage = open_storage(path)
        self._classes: dict[RecordedTopic, type[Message]] = {}

    @cached_property
    def topics(self) -> dict[str, str]:
        """Name -> type of each topic; "" for a topic without a type.

        Raises:
            FileFormatError: if the recording cannot be read or is not complete.
        """
        return dict(sorted((topic.name, topic.type_name) for topic in self._storage.topics()))

    def messages(
        self, topics: Collection[str] | None = None, types: Collection[str] | None = None
    ) -> Iterator[BagMessage]:
        """Yield messages in the order of their times.

        Args:
            topics: Names of the topics to read; all if omitted.
            types: Full names of the types to read; all if omitted.

        Raises:
            UnknownNameError: for a topic in `topics` that the recording does not have.
            FileFormatError: for a damaged file; for a message that cannot be read, with topic and time; or
                for a chosen topic that is not of ROS 2 or has an unusable definition.

        Warns:
            FileFormatWarning: for each topic left out for the same reason, without `topics` and `types`.
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
    """Return the class of a topic's messages; raise MessageError if they are not of ROS 2."""
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
