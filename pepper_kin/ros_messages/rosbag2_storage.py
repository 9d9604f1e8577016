"""Reader of bags of `ros2 bag`: folders with `metadata.yaml`, and SQLite files (`.db3`, the older default).

Source: rosbag2's `rosbag2_storage_sqlite3` (schema versions 1 to 4) and `metadata.yaml` (versions 1 to 9).
"""

from __future__ import annotations

import heapq
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import FileFormatError, shortened
from pepper_kin.file_access.atomic_file import PathName, as_path
from pepper_kin.file_access.reading import read_bytes, read_text
from pepper_kin.ros_messages.mcap_storage import McapStorage
from pepper_kin.ros_messages.recorded import RecordedMessage, RecordedTopic, Storage, decompressed, most_bytes

METADATA = "metadata.yaml"
_LARGEST_METADATA = 5_000_000  # bytes; the YAML reader is slow


def open_storage(path: PathName) -> Storage:
    """Open the storage of a recording.

    Args:
        path: MCAP file, `.db3` file, or folder of a bag.

    Raises:
        MissingDependencyError: if the package `mcap` is needed and not installed.
        FileFormatError: if it cannot be read.
    """
    place = as_path(path)
    if place.is_dir():
        return FolderStorage(place)
    return _file_storage(place, None)


def _file_storage(place: Path, content: bytes | None) -> Storage:
    """Open the storage of a file; `content` has its bytes if they were decompressed."""
    suffixes = [suffix.lower() for suffix in place.suffixes]
    if ".db3" in suffixes[-2:]:
        return SqliteStorage(place, content)
    return McapStorage(place, read_bytes(place) if content is None else content)


class FolderStorage:
    """The folder of a bag, with one or several files.

    Args:
        path: The folder.

    Raises:
        FileFormatError: for a missing file, or an unknown storage or compression.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not (path / METADATA).is_file():
            raise FileFormatError(path, f"is a folder without {METADATA}: not a bag of `ros2 bag`")
        stated = _metadata(path / METADATA)
        storage, names = stated.get("storage_identifier"), stated.get("relative_file_paths")
        form, mode = stated.get("compression_format") or "", str(stated.get("compression_mode") or "").lower()
        if storage not in ("sqlite3", "mcap"):
            raise FileFormatError(path / METADATA, f"has the storage {storage!r}, expected sqlite3 or mcap")
        if mode not in ("", "none", "file", "message") or (mode in ("file", "message") and form != "zstd"):
            reason = f"has the compression {mode!r} by {form!r}, expected file or message by zstd"
            raise FileFormatError(path / METADATA, reason)
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise FileFormatError(path / METADATA, "has no list relative_file_paths")
        files = [path / Path(name).name for name in names]  # older versions include the folder in the names
        for file in files:
            if not file.is_file():
                raise FileFormatError(path, f"lacks {file.name}, which {METADATA} names")
        self._messages = mode == "message"
        self._parts = [_file_storage(file, _content(file) if mode == "file" else None) for file in files]

    def topics(self) -> tuple[RecordedTopic, ...]:
        """Return all topics."""
        return tuple(dict.fromkeys(topic for part in self._parts for topic in part.topics()))

    def records(self, chosen: Callable[[RecordedTopic], bool]) -> Iterator[RecordedMessage]:
        """Yield the messages of the chosen topics in the order of their times."""
        most = most_bytes(0)
        parts = (part.records(chosen) for part in self._parts)
        for record in heapq.merge(*parts, key=lambda record: record.time):
            if self._messages:
                record = record._replace(data=decompressed(self.path, record.data, most))
            yield record


def _content(file: Path) -> bytes:
    data = read_bytes(file)
    return decompressed(file, data, most_bytes(len(data)))


def _metadata(path: Path) -> dict[str, Any]:
    """Return the information about a bag in its metadata."""
    import yaml

    if path.stat().st_size > _LARGEST_METADATA:
        raise FileFormatError(path, f"has more than {_LARGEST_METADATA} bytes")
    try:
        root = yaml.safe_load(read_text(path))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise FileFormatError(path, f"is not YAML: {shortened(error)}") from error
    stated = root.get("rosbag2_bagfile_information") if isinstance(root, dict) else None
    if not isinstance(stated, dict):
        raise FileFormatError(path, "has no rosbag2_bagfile_information")
    return stated


class SqliteStorage:
    """A `.db3` file.

    Args:
        path: The file.
        content: Bytes of the database, if the file is compressed.

    Raises:
        FileFormatError: if it cannot be read or is no `.db3` file.
    """

    def __init__(self, path: Path, content: bytes | None = None) -> None:
        self.path, self._bytes = path, content
        if content is None and not path.is_file():
            read_bytes(path)  # raises with the reason
        with closing(self._open()) as database:
            self._topics = self._read_topics(database)

    def topics(self) -> tuple[RecordedTopic, ...]:
        """Return all topics."""
        return tuple(dict.fromkeys(self._topics.values()))

    def records(self, chosen: Callable[[RecordedTopic], bool]) -> Iterator[RecordedMessage]:
        """Yield the messages of the chosen topics in the order of their times.

        Raises:
            FileFormatError: for a damaged file.
        """
        wanted = {number for number, topic in self._topics.items() if chosen(topic)}
        with closing(self._open()) as database:
            query = "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
            rows = self._rows(database, query)
            for number, time, data in rows:
                if number not in self._topics or type(time) is not int or not isinstance(data, bytes):
                    reason = f"has a message of topic {number!r} at {time!r} that is none"
                    raise FileFormatError(self.path, reason)
                if number in wanted:
                    yield RecordedMessage(self._topics[number], time, data)

    def _open(self) -> sqlite3.Connection:
        try:
            if self._bytes is None:
                return sqlite3.connect(f"{self.path.resolve().as_uri()}?mode=ro", uri=True)
            database = sqlite3.connect(":memory:")
            database.deserialize(self._bytes)
            return database
        except sqlite3.Error as error:
            raise self._damaged(error) from error

    def _rows(self, database: sqlite3.Connection, query: str) -> Iterator[tuple[Any, ...]]:
        try:
            yield from database.execute(query)
        except sqlite3.Error as error:
            raise self._damaged(error) from error

    def _read_topics(self, database: sqlite3.Connection) -> dict[int, RecordedTopic]:
        """Read the topics of the database, by number, with their definitions."""
        tables = {
            name for (name,) in self._rows(database, "SELECT name FROM sqlite_master WHERE type='table'")
        }
        if not {"topics", "messages"} <= tables:
            raise FileFormatError(self.path, "is not a bag: it lacks the tables topics and messages")
        definitions: dict[str, tuple[str, bytes]] = {}
        if "message_definitions" in tables:
            query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            for name, syntax, text in self._rows(database, query):
                definitions[name] = str(syntax), str(text).encode()
        topics = {}
        for number, name, kind, form in self._rows(
            database, "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        ):
            syntax, text = definitions.get(kind, ("", b""))
            topics[number] = RecordedTopic(str(name), str(kind), str(form), syntax, text)
        return topics

    def _damaged(self, error: sqlite3.Error) -> FileFormatError:
        return FileFormatError(self.path, f"is not a complete SQLite file: {shortened(error)}")
