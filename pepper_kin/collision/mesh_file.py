"""Triangles of a mesh file: STL (binary or text) and OBJ by separate readers, other formats by trimesh."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision.mesh_process import mesh_of_other_format
from pepper_kin.exceptions import FileFormatError, InvalidValueError, shortened
from pepper_kin.file_access.reading import plain_whole, read_bytes
from pepper_kin.model.joint_vectors import as_finite, as_numbers
from pepper_kin.model.plain_number import plain_number

_HEADER = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(
    path: str | os.PathLike[str], scale: ArrayLike = (1.0, 1.0, 1.0)
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the vertices and triangles of a mesh.

    Args:
        path: The file; its suffix determines the format.
        scale: Factors along x, y and z, shape (3,), or one for all, from the file's unit to meters.

    Returns:
        Vertices, shape (k, 3) [m], and faces, shape (f, 3), indices of vertices.  Faces with two equal
        corners are left out.

    Raises:
        FileFormatError: naming the file, the line if it is a text, and the fault.
        InvalidValueError: for a scale that is not finite.
    """
    vertices, faces, _ = read_colored_mesh(path, scale)
    return vertices, faces


def read_colored_mesh(
    path: str | os.PathLike[str], scale: ArrayLike = (1.0, 1.0, 1.0)
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """Read the vertices, triangles and colors of a mesh; see `read_mesh`.

    Returns:
        Vertices and faces as of `read_mesh`, and the colors of the faces, shape (f, 4): red, green, blue and
        opacity from 0 to 255; shape (0, 4) if the file has none, or is STL or OBJ.
    """
    file = Path(path)
    factors = scale_factors(scale, "scale")
    suffix = file.suffix.lower()
    check_is_file(file)
    colors = np.empty((0, 4), np.uint8)
    if suffix in (".stl", ".obj"):
        content = read_bytes(file)
        vertices, faces = (_obj if suffix == ".obj" else _stl)(file, content)
    else:
        vertices, faces, colors = mesh_of_other_format(file)
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise FileFormatError(file, f"a face of the mesh names none of its {len(vertices)} vertices")
    corners = vertices[faces]
    whole = (corners != np.roll(corners, 1, axis=1)).any(axis=2).all(axis=1)
    faces, colors = faces[whole], colors[whole] if len(colors) else colors
    if not len(faces):
        raise FileFormatError(file, "the mesh holds no triangle")
    if not np.isfinite(vertices).all():
        raise FileFormatError(file, "a vertex of the mesh is NaN or infinite")
    with np.errstate(over="ignore"):
        vertices = vertices * factors
    if not np.isfinite(vertices).all():
        raise FileFormatError(file, f"a vertex of the mesh is infinite when scaled by {factors}")
    return vertices, faces, colors


def check_is_file(file: Path) -> None:
    """Refuse a missing file.

    Raises:
        FileFormatError: naming the file and, if its folder is unknown, the option that sets it.
    """
    if not os.path.isfile(file):  # Path.is_file raises for names that are too long
        hint = (
            "" if file.is_absolute() else "; load_robot(package_dirs=...) takes the folder that it starts in"
        )
        raise FileFormatError(file, f"cannot be read as a mesh: there is no such file{hint}")


def file_state(path: Path) -> tuple[str | int, ...]:
    """Return values that change when a mesh file does: absolute path, times, size and inode.

    Raises:
        FileFormatError: if there is no such file.
    """
    check_is_file(path)
    state = path.stat()
    return (str(path.resolve()), state.st_mtime_ns, state.st_ctime_ns, state.st_size, state.st_ino)


def scale_factors(scale: ArrayLike, quantity: str) -> NDArray[np.float64]:
    """Return factors along x, y and z, shape (3,), from three numbers, shape (3,), or one for all.

    Raises:
        InvalidValueError: for another shape, NaN or infinity.
    """
    factors = as_numbers(scale, quantity)
    return np.broadcast_to(as_finite(factors, quantity, factors.shape and (3,)), 3)


def points_of(
    name: str, vertices: ArrayLike | str | os.PathLike[str], scale: ArrayLike
) -> NDArray[np.float64]:
    """Return points, shape (k, 3) [m], given as an array or as a mesh file; see `read_mesh`.

    Raises:
        InvalidValueError: for a wrong shape, NaN or infinity.
        FileFormatError: naming the file.
    """
    if isinstance(vertices, str | os.PathLike):
        return read_mesh(vertices, scale)[0]
    factors = scale_factors(scale, f"scale of {name!r}")
    return as_finite(vertices, f"vertices of {name!r}", (None, 3)) * factors


def triangles_of(
    name: str, vertices: ArrayLike | str | os.PathLike[str], faces: ArrayLike | None, scale: ArrayLike
) -> tuple[NDArray[np.float64], Any]:
    """Return points, shape (k, 3) [m], and faces, shape (f, 3), given as arrays or as a mesh file.

    Given faces are checked when a mesh is made of them.

    Raises:
        InvalidValueError: for missing faces, faces in addition to a file, a wrong shape, NaN or infinity.
        FileFormatError: naming the file.
    """
    from_file = isinstance(vertices, str | os.PathLike)
    if from_file != (faces is None):
        wanted = "None where a file is given" if from_file else "indices of vertices, shape (f, 3)"
        raise InvalidValueError(f"faces of {name!r}", type(faces).__name__, wanted)
    if isinstance(vertices, str | os.PathLike):
        return read_mesh(vertices, scale)
    return points_of(name, vertices, scale), faces


def _stl(file: Path, content: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices [m], shape (k, 3), and faces, shape (f, 3), of an STL file, binary or text."""
    count = int.from_bytes(content[80:_HEADER], "little")
    if len(content) >= _HEADER and len(content) == _HEADER + count * _TRIANGLE.itemsize:
        corners = np.frombuffer(content, _TRIANGLE, count, _HEADER)["corners"].astype(float).reshape(-1, 3)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _text_stl(file, content)
    else:
        raise FileFormatError(
            file, f"not an STL file: {len(content)} bytes do not hold the {count} triangles announced"
        )
    if not len(corners):
        return corners, np.empty((0, 3), dtype=np.int64)
    vertices, indices = unique_rows(corners)
    return vertices, indices.reshape(-1, 3)


def unique_rows(points: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the unique rows of an array, shape (k, d), sorted, and the index of every row among them.

    The rows have shape (u, d), the indices shape (k,).

    The result equals `np.unique(points, axis=0, return_inverse=True)`, five times as fast for points in
    space: columns are sorted one by one, instead of rows as byte strings.
    """
    order = np.lexsort(points.T[::-1])
    ordered = points[order]
    first = np.ones(len(points), dtype=bool)
    np.any(ordered[1:] != ordered[:-1], axis=1, out=first[1:])
    places = np.empty(len(points), dtype=np.int64)
    places[order] = np.cumsum(first) - 1
    return ordered[first], places


def _text_stl(file: Path, content: bytes) -> NDArray[np.float64]:
    """Return the corners of a text STL file's triangles, shape (3 f, 3)."""
    corners = []
    for number, line in enumerate(_lines(file, content), 1):
        words = line.split()
        if words and words[0].lower() == "vertex":
            corners.append(_numbers(file, words[1:], number))
    if len(corners) % 3:
        raise FileFormatError(file, f"{len(corners)} vertices do not make whole triangles")
    return np.array(corners).reshape(-1, 3)


def _obj(file: Path, content: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices, shape (k, 3), and faces, shape (f, 3), of an OBJ file; polygons become fans."""
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    for number, line in enumerate(_lines(file, content), 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append(_numbers(file, words[1:4], number))
        elif words[0] == "f":
            corners = [_obj_index(file, word, len(vertices), number) for word in words[1:]]
            faces += [[corners[0], *corners[k : k + 2]] for k in range(1, len(corners) - 1)]
    return np.array(vertices, dtype=float).reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 3)


def _obj_index(file: Path, word: str, count: int, line: int) -> int:
    """Return the index of a face's vertex; OBJ counts from 1, or backwards from -1."""
    index = plain_whole(word.split("/", 1)[0])
    if index is None:
        raise FileFormatError(file, f"face corner {shortened(repr(word))} is not a whole number", line)
    place = index - 1 if index > 0 else count + index
    if index == 0 or not 0 <= place < count:
        raise FileFormatError(file, f"face corner {index} names none of the {count} vertices so far", line)
    return place


def _lines(file: Path, content: bytes) -> list[str]:
    try:
        return content.decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise FileFormatError(file, f"is not text: {error.reason} at byte {error.start}") from None


def _numbers(file: Path, words: list[str], line: int) -> list[float]:
    """Return the three finite numbers of a vertex on a line."""
    numbers = [plain_number(word) for word in words]
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        found = shortened(repr(" ".join(words)))
        raise FileFormatError(file, f"a vertex is {found}, not three finite numbers", line)
    return numbers
