"""Reader of MCAP files; the optional summary is used if it is complete."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

from pepper_kin.exceptions import FileFormatError, optional, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.ros_messages.recorded import RecordedMessage, RecordedTopic, most_bytes


class McapStorage:
    """An MCAP file.

    Args:
        path: The file, for errors.
        content: Bytes of the file.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
    """

    def __init__(self, path: PathName, content: bytes) -> None:
        optional("mcap.reader", extra="mcap", need="an MCAP file")
        self.path, self._content = path, content

    def topics(self) -> tuple[RecordedTopic, ...]:
        """Return all topics.

        Raises:
            FileFormatError: for a damaged file.
        """
        summary = self._index
        if summary is None:
            return tuple(dict.fromkeys(self._scanned[0].values()))
        found = (_topic(channel, summary.schemas) for channel in summary.channels.values())
        return tuple(dict.fromkeys(found))

    def records(self, chosen: Callable[[RecordedTopic], bool]) -> Iterator[RecordedMessage]:
        """Yield the messages of the chosen topics in the order of their times.

        Raises:
            FileFormatError: for a damaged file.
        """
        source = self._records()
        known: dict[int, tuple[RecordedTopic, bool]] = {}
        while True:
            try:
                schemas, channel, message = next(source)
            except StopIteration:
                return
            except FileFormatError:
                raise
            except Exception as error:  # the library's errors for damaged files have no common base class
                raise self._damaged(error) from error
            if channel.id not in known:
                topic = _topic(channel, schemas)
                known[channel.id] = topic, chosen(topic)
            topic, wanted = known[channel.id]
            if wanted:
                yield RecordedMessage(topic, int(message.log_time), message.data)

    def _records(self) -> Iterator[tuple[Any, Any, Any]]:
        """Yield schemas by number, channel and message, in the order of times."""
        from mcap.reader import make_reader

        summary = self._index
        if summary is None:
            _, channels, schemas, messages = self._scanned
            for message in messages:
                yield schemas, channels[message.channel_id], message
            return
        reader = make_reader(io.BytesIO(self._content), validate_crcs=True)
        for _, channel, message in reader.iter_messages():
            yield summary.schemas, channel, message

    @cached_property
    def _index(self) -> Any:
        """The summary, if it lists every channel, schema and chunk; else None: all records are scanned.

        Raises:
            FileFormatError: for a damaged file, or one that would need too much memory when decompressed.
        """
        from mcap.reader import make_reader
        from mcap.records import Chunk, Message
        from mcap.stream_reader import StreamReader

        most, size, chunks, single = most_bytes(len(self._content)), 0, 0, False
        try:
            for record in StreamReader(io.BytesIO(self._content), emit_chunks=True).records:
                if isinstance(record, Chunk):
                    chunks += 1
                    size += _decompressed_size(record, most)
                single |= isinstance(record, Message)
                if size > most:
                    raise FileFormatError(self.path, f"is more than {most} bytes when decompressed")
            summary = make_reader(io.BytesIO(self._content)).get_summary()
        except FileFormatError:
            raise
        except Exception as error:  # as above
            raise self._damaged(error) from error
        if summary is None or summary.statistics is None or single:
            return None
        counted = summary.statistics
        complete = (
            len(summary.chunk_indexes) == chunks
            and len(summary.channels) == counted.channel_count
            and len(summary.schemas) == counted.schema_count
            and {channel.schema_id for channel in summary.channels.values()} <= {0, *summary.schemas}
        )
        return summary if complete else None

    @cached_property
    def _scanned(self) -> tuple[dict[int, RecordedTopic], dict[int, Any], dict[int, Any], list[Any]]:
        """Topics, channels and schemas by number, and the messages in the order of their times."""
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader

        channels: dict[int, Any] = {}
        schemas: dict[int, Any] = {}
        messages: list[Any] = []
        try:
            for record in StreamReader(io.BytesIO(self._content), validate_crcs=True).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channels[record.channel_id]  # raises KeyError for a message before its channel
                    messages.append(record)
            topics = {number: _topic(channel, schemas) for number, channel in channels.items()}
        except Exception as error:  # as above
            raise self._damaged(error) from error
        messages.sort(key=lambda message: message.log_time)
        return topics, channels, schemas, messages

    def _damaged(self, error: Exception) -> FileFormatError:
        what = f"{type(error).__name__}: {shortened(error)}"
        return FileFormatError(self.path, f"is not a complete MCAP file: {what}")


def _topic(channel: Any, schemas: dict[int, Any]) -> RecordedTopic:
    if channel.schema_id == 0:
        return RecordedTopic(channel.topic, "", channel.message_encoding, "", b"")
    schema = schemas[channel.schema_id]
    return RecordedTopic(
        channel.topic, schema.name, channel.message_encoding, schema.encoding, bytes(schema.data)
    )


def _decompressed_size(chunk: Any, most: int) -> int:
    """Return the decompressed size of a chunk in the package `mcap` [bytes], or any number above `most`."""
    if chunk.compression == "zstd":
        import zstandard

        # The frame's size is used, whatever the chunk's header says; without it the header's is the limit.
        announced = int(zstandard.frame_content_size(chunk.data))
        return announced if announced >= 0 else int(chunk.uncompressed_size)
    if chunk.compression == "lz4":
        import lz4.frame

        announced = int(lz4.frame.get_frame_info(chunk.data)["content_size"])
        if announced > most:  # this size is allocated before decompression
            return announced
        return len(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1))
    return max(int(chunk.uncompressed_size), len(chunk.data))
