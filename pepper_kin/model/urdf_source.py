"""The text of a description, wherever it comes from."""

from __future__ import annotations

from pathlib import Path

from pepper_kin.exceptions import FileFormatError
from pepper_kin.model.pepper_model import PepperModel


def read_source(source: PepperModel | str | Path) -> str:
    """Return the URDF text of a loaded robot, of a text (it begins with "<"), or of a file.

    Raises:
        FileFormatError: where a file cannot be read as text.
    """
    if isinstance(source, PepperModel):
        return source.urdf
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        return source.lstrip("\ufeff \t\r\n")
    try:
        return Path(source).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise FileFormatError(source, f"cannot be read as text: {error}") from error
