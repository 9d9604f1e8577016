"""Exports of the robot as files, with their meshes."""

from __future__ import annotations

from pathlib import Path

from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access import atomic_file
from pepper_kin.model import PepperModel, export, mesh_files


def save_export(
    pepper: PepperModel, format: str, path: str | Path, *, mesh_paths: str | None = None
) -> list[Path]:
    """Write a robot as a file for another program.

    Args:
        pepper: The robot.
        format: "urdf", "srdf", "sdf" or "mjcf".
        path: The file; its folder is created if missing.
        mesh_paths: Names of mesh files, see `pepper_kin.model.export`; with "relative" the meshes are copied
            to a folder `meshes` beside the file.

    Returns:
        The file, then the copied meshes.

    Raises:
        PepperKinError: for an unknown format, or a file that cannot be read or written.
    """
    text = export(pepper, format, mesh_paths=mesh_paths)
    target = Path(path)
    atomic_file.make_folder(target.parent)
    written = []
    if mesh_paths == "relative" and format != "srdf":
        for name, source in mesh_files(pepper.document).items():
            copy = target.parent / name
            atomic_file.make_folder(copy.parent)
            try:
                content = source.read_bytes()
            except OSError as error:
                raise FileFormatError(source, f"cannot be read: {error.strerror or error}") from error
            written.append(atomic_file.write_bytes(copy, content))
    return [atomic_file.write_text(target, text), *written]
