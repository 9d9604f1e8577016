"""Text of a description from a robot, a text or a file."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from pepper_kin.exceptions import InvalidValueError, ModelError
from pepper_kin.file_access.atomic_file import as_path
from pepper_kin.file_access.reading import read_text
from pepper_kin.model.dynamics_model import described
from pepper_kin.model.pepper_model import PepperModel


def read_source(source: PepperModel | str | Path) -> str:
    """Return the URDF text of a loaded robot, of a text (it begins with "<"), or of a file.

    Raises:
        FileFormatError: for a file that cannot be read as text.
        ModelError: for a robot whose `pinocchio_model` was changed by hand.
    """
    if isinstance(source, PepperModel):
        described(source)
        return source.urdf
    if isinstance(source, str) and is_text(source):
        return source.lstrip("\ufeff \t\r\n")
    return read_text(source)


@contextlib.contextmanager
def warned(source: PepperModel | str | Path) -> Iterator[None]:
    """Put the file's name, if any, in front of a `ModelError` about a description."""
    try:
        yield
    except ModelError as error:
        if isinstance(source, PepperModel) or (isinstance(source, str) and is_text(source)):
            raise
        raise ModelError(f"{source}: {error}") from error


def mesh_folders(source: PepperModel | str | Path, package_dirs: Sequence[str | Path]) -> list[Path]:
    """Return the folders in which a description's mesh files are searched, in order.

    The given folders come first, then, for a description in a file, the file's folder and all folders above
    it: a robot's package usually holds its URDF and its meshes.
    """
    if isinstance(package_dirs, str | bytes | os.PathLike):
        raise InvalidValueError("package_dirs", repr(package_dirs), "a list of folders")
    folders = [as_path(folder, "folder in package_dirs") for folder in package_dirs]
    if isinstance(source, Path) or (isinstance(source, str) and not is_text(source)):
        folders += Path(source).absolute().parents
    return folders


def is_text(source: str) -> bool:
    """Whether a string is the text of a description, not a file's name."""
    return source.lstrip("\ufeff \t\r\n").startswith("<")
