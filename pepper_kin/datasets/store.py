"""Folder of a dataset, on a disk or on a file system of fsspec."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import posixpath
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from pepper_kin.exceptions import FileFormatError, InvalidValueError, MissingDependencyError
from pepper_kin.file_access.atomic_file import PathName, as_path, make_folder, whole_file

_PIECE = 1 << 20  # number of bytes that are read at once
_LOCK = ".lock"


class Store:
    """Files of a dataset by name; each is written whole or not at all.

    Args:
        place: A folder, or an address that fsspec knows, such as "s3://bucket/folder" or "memory://folder".

    Raises:
        MissingDependencyError: for an address if `fsspec`, or its package for the address, is not installed.
        InvalidValueError: for an address that fsspec does not know.
    """

    def __init__(self, place: PathName) -> None:
        self.place = os.fspath(place)
        self._fs: Any = None
        if isinstance(self.place, str) and "://" in self.place:
            try:
                import fsspec

                self._fs, self._root = fsspec.core.url_to_fs(self.place)
            except ImportError as error:
                raise MissingDependencyError("fsspec", "pip install fsspec", f"{self.place}") from error
            except ValueError as error:
                raise InvalidValueError("folder", self.place, f"an address of fsspec: {error}") from error
        else:
            self._root = str(as_path(place, "folder").absolute())

    @property
    def local(self) -> Path | None:
        """The folder if it is on a disk, else None."""
        return Path(self._root) if self._fs is None else None

    def path(self, name: str) -> str:
        """Return the path or address of a file, for messages."""
        return posixpath.join(self.place, name)

    def names(self, folder: str) -> list[str]:
        """Return the names of the files in a folder, sorted; none if it does not exist."""
        with self._named(folder):
            try:
                if self._fs is None:
                    found = os.listdir(os.path.join(self._root, folder))
                else:
                    found = [posixpath.basename(p) for p in self._fs.ls(self._at(folder), detail=False)]
            except FileNotFoundError:
                return []
            return sorted(found)

    def files(self, folder: str) -> list[str]:
        """Return the files in a folder and its subfolders, by their names in the store, sorted."""
        with self._named(folder):
            if self._fs is None:
                below = Path(self._at(folder)).rglob("*")
                return sorted(path.relative_to(self._root).as_posix() for path in below if path.is_file())
            if not self._fs.exists(self._at(folder)):
                return []
            root = self._fs._strip_protocol(self._at(""))
            return sorted(posixpath.relpath(path, root) for path in self._fs.find(self._at(folder)))

    def exists(self, name: str) -> bool:
        """Return whether a file exists."""
        return bool(os.path.exists(self._at(name)) if self._fs is None else self._fs.exists(self._at(name)))

    @contextlib.contextmanager
    def write(self, name: str) -> Iterator[BinaryIO]:
        """Open a file for writing; it gets its name, with its content on the disk, when the context ends.

        Raises:
            FileFormatError: naming the file and the reason if it cannot be written.
        """
        if self._fs is None:
            path = Path(self._at(name))
            make_folder(path.parent)
            with whole_file(path) as file:
                yield file
            with self._named(name):
                folder = os.open(path.parent, os.O_RDONLY)
                try:
                    os.fsync(folder)  # the new name, too
                finally:
                    os.close(folder)
            return
        temporary = self._at(
            f"{posixpath.dirname(name)}/.{posixpath.basename(name)}.{os.urandom(6).hex()}.part"
        )
        with self._named(name):
            try:
                self._fs.makedirs(posixpath.dirname(self._at(name)), exist_ok=True)
                with self._fs.open(temporary, "wb") as file:
                    yield file
                self._fs.mv(temporary, self._at(name))
            except BaseException:
                with contextlib.suppress(Exception):
                    self._fs.rm(temporary)
                raise

    def write_text(self, name: str, text: str) -> None:
        """Write a file of text."""
        with self.write(name) as file:
            file.write(text.encode())

    def open(self, name: str) -> BinaryIO:
        """Open a file for reading.

        Raises:
            FileFormatError: if it cannot be opened.
        """
        with self._named(name, "read"):
            return open(self._at(name), "rb") if self._fs is None else self._fs.open(self._at(name), "rb")

    def read_text(self, name: str) -> str:
        """Return the text of a file.

        Raises:
            FileFormatError: if it cannot be read, or is not UTF-8.
        """
        with self.open(name) as file:
            try:
                return file.read().decode()
            except UnicodeDecodeError as error:
                raise FileFormatError(self.path(name), "is not text in UTF-8") from error

    def sha256(self, name: str) -> tuple[str, int]:
        """Return the SHA-256 of a file and its size [bytes]."""
        engine, size = hashlib.sha256(), 0
        with self.open(name) as file, self._named(name, "read"):
            while piece := file.read(_PIECE):
                engine.update(piece)
                size += len(piece)
        return engine.hexdigest(), size

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the store against other drivers on this machine, until the context or the process ends.

        On an address of fsspec there is no lock: two drivers do the same work twice, and write equal files.

        Raises:
            InvalidValueError: if another process makes this dataset.
        """
        if self._fs is not None:
            yield
            return
        make_folder(self._root)
        with self._named(_LOCK):
            handle = os.open(self._at(_LOCK), os.O_RDWR | os.O_CREAT, 0o644)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                other = os.read(handle, 20).decode(errors="replace").strip() or "unknown"
                allowed = f"one that no other process makes now (process {other} does)"
                raise InvalidValueError("folder", self.place, allowed) from None
            os.ftruncate(handle, 0)
            os.pwrite(handle, str(os.getpid()).encode(), 0)
            yield
        finally:
            os.close(handle)

    def clean(self, folder: str) -> None:
        """Remove partial files of killed processes from a disk."""
        if self._fs is None:
            for name in self.names(folder):
                if name.startswith(".") and name.endswith(".part"):
                    with contextlib.suppress(OSError):
                        os.unlink(self._at(f"{folder}/{name}"))

    def remove(self) -> None:
        """Remove everything in the store."""
        with self._named("", "removed"):
            if self._fs is None:
                shutil.rmtree(self._root, ignore_errors=not os.path.exists(self._root))
            elif self._fs.exists(self._root):
                self._fs.rm(self._root, recursive=True)

    def _at(self, name: str) -> str:
        return posixpath.join(self._root, name)

    @contextlib.contextmanager
    def _named(self, name: str, what: str = "written") -> Iterator[None]:
        try:
            yield
        except FileNotFoundError as error:
            if what != "read":
                raise FileFormatError(self.path(name), f"cannot be {what}: {error}") from error
            raise FileFormatError(self.path(name), "is missing") from error
        except OSError as error:
            raise FileFormatError(self.path(name), f"cannot be {what}: {error.strerror or error}") from error
