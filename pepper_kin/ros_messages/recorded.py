"""Records of recordings as they are stored: topics with the texts of their types, and messages as bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from pepper_kin.exceptions import FileFormatError, optional
from pepper_kin.file_access.atomic_file import PathName

MOST_BYTES = 250_000_000
"""Most that is decompressed [bytes] of a file that is small; of others MOST_TIMES their size."""
MOST_TIMES = 50


class RecordedTopic(NamedTuple):
    """A topic of a recording.

    Attributes:
        name: Of the topic.
        type_name: Of its messages; "" where none is stated.
        serialization: How messages are stored: "cdr" by ROS 2.
        syntax: Of the definition: "ros2msg", "ros2idl", ...; "" where there is none.
        definition: Text of the type and of those within it.
    """

    name: str
    type_name: str
    serialization: str
    syntax: str
    definition: bytes


class RecordedMessage(NamedTuple):
    """A message of a recording: its topic, when it was recorded [ns], and its bytes."""

    topic: RecordedTopic
    time: int
    data: bytes


class Storage(Protocol):
    """A recording, or one file of it."""

    def topics(self) -> tuple[RecordedTopic, ...]:
        """Return all topics."""

    def records(self, chosen: Callable[[RecordedTopic], bool]) -> Iterator[RecordedMessage]:
        """Yield the messages of the topics chosen in the order of their times."""


def most_bytes(size: int) -> int:
    """Return how much may be decompressed of a file of this size [bytes]."""
    return max(MOST_BYTES, MOST_TIMES * size)


def decompressed(path: PathName, data: bytes, most: int) -> bytes:
    """Return what zstd has compressed.

    Args:
        path: For errors.
        data: One frame.
        most: The largest size [bytes].

    Raises:
        MissingDependencyError: without the package `zstandard`.
        FileFormatError: for other bytes, or more than `most`.
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
