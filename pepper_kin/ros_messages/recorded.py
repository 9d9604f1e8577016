"""Stored parts of recordings: topics with the texts of their types, and messages as bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from pepper_kin.exceptions import FileFormatError, optional
from pepper_kin.file_access.atomic_file import PathName

MOST_BYTES = 250_000_000
"""Maximum decompressed size of a small file [bytes]; of larger files MOST_TIMES their size."""
MOST_TIMES = 50


class RecordedTopic(NamedTuple):
    """A topic of a recording.

    Attributes:
        name: Name of the topic.
        type_name: Type of its messages; "" if none is given.
        serialization: Encoding of the messages: "cdr" in ROS 2.
        syntax: Syntax of the definition: "ros2msg", "ros2idl", ...; "" without a definition.
        definition: Text of the type and of all types within it.
    """

    name: str
    type_name: str
    serialization: str
    syntax: str
    definition: bytes


class RecordedMessage(NamedTuple):
    """A message of a recording: topic, time of recording [ns] and bytes."""

    topic: RecordedTopic
    time: int
    data: bytes


class Storage(Protocol):
    """A stored recording, or one file of it."""

    def topics(self) -> tuple[RecordedTopic, ...]:
        """Return all topics."""

    def records(self, chosen: Callable[[RecordedTopic], bool]) -> Iterator[RecordedMessage]:
        """Yield the messages of the chosen topics in the order of their times."""


def most_bytes(size: int) -> int:
    """Return the maximum decompressed size of a file of a size [bytes]."""
    return max(MOST_BYTES, MOST_TIMES * size)


def decompressed(path: PathName, data: bytes, most: int) -> bytes:
    """Decompress zstd data.

    Args:
        path: Path of the file, for errors.
        data: One frame of zstd.
        most: Maximum decompressed size [bytes].

    Raises:
        MissingDependencyError: without the package `zstandard`.
        FileFormatError: for invalid data, or more than `most` bytes.
    """
    zstandard = optional("zstandard", extra="mcap", need="a compressed bag")
    try:
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
            content = bytes(stream.read(most + 1))
    except (zstandard.ZstdError, MemoryError) as error:
        raise FileFormatError(path, f"is not compressed by zstd: {error}") from error
    if len(content) > most:
        raise FileFormatError(path, f"is more than {most} bytes when decompressed")
    return content
