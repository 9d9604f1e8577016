"""Key points of a person over time, as pose estimators and motion capture provide them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError, shortened
from pepper_kin.file_access.atomic_file import PathName, as_path
from pepper_kin.file_access.numpy_archive import read_arrays
from pepper_kin.file_access.reading import read_text
from pepper_kin.model.joint_vectors import check_positive

_SIDES = ("left", "right")
SKELETONS: dict[str, tuple[str, ...]] = {
    "coco": (
        "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder",
        "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee",
        "right_knee", "left_ankle", "right_ankle",
    ),
    "human36m": (
        "pelvis", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "spine",
        "thorax", "nose", "head", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder",
        "right_elbow", "right_wrist",
    ),
    "mediapipe": (
        "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye",
        "right_eye_outer", "left_ear", "right_ear", "mouth_left", "mouth_right", "left_shoulder",
        "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_pinky",
        "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb", "left_hip", "right_hip",
        "left_knee", "right_knee", "left_ankle", "right_ankle", "left_heel", "right_heel",
        "left_foot_index", "right_foot_index",
    ),
}  # fmt: skip
"""Names of the key points of common skeletons, in their order."""

_SPELLINGS = {
    spelling: name
    for name in {"neck", *(name for names in SKELETONS.values() for name in names)}
    for side, _, part in [name.partition("_") if name.startswith(_SIDES) else ("", "", name)]
    for spelling in (side + part, side[:1] + part, part + side, part + side[:1])
    for spelling in [spelling.replace("_", "")]
}
"""Alternative spelling, in lower-case letters and digits only -> name of the key point."""

_ARRAYS, _RATE = {"points", "names", "times"}, 30.0


@dataclass(frozen=True, eq=False)
class KeyPoints(FrozenArrays):
    """Key points of a person over time.

    Attributes:
        times: Increasing times [s], shape (T,), T > 1.
        points: Positions in any fixed frame and unit of length, shape (T, K, 3); NaN if not observed.
        names: Names of the points, such as "left_wrist", shape (K,).
    """

    times: Array
    points: Array
    names: tuple[str, ...]

    def __init__(self, times: ArrayLike, points: ArrayLike, names: str | Sequence[str]) -> None:
        """Copy and check the data.

        Args:
            times: Increasing times [s], shape (T,), or a rate [1/s].
            points: Positions, shape (T, K, 3), NaN if not observed.
            names: Names of the points in any common spelling ("LShoulder", "left shoulder"), or "coco",
                "human36m" or "mediapipe" for the points of that skeleton in its order.

        Raises:
            InvalidValueError: for other shapes, infinity, or times that do not increase.
            UnknownNameError: for an unknown skeleton.
        """
        place = np.array(points, dtype=float)
        if place.ndim != 3 or place.shape[2] != 3 or len(place) < 2:
            raise InvalidValueError("points", f"shape {place.shape}", "shape (T, K, 3), T > 1")
        if np.isinf(place).any() or np.nanmax(np.abs(place), initial=0.0) > 1e100:
            raise InvalidValueError(
                "points", "infinity", "finite numbers, or NaN for a point that was not seen"
            )
        time = np.array(times, dtype=float)
        if time.ndim == 0:
            time = np.arange(len(place)) / check_positive("times", float(time), "1/s")
        if time.shape != (len(place),):
            raise InvalidValueError(
                "times", f"shape {time.shape}", f"shape ({len(place)},), one for each frame"
            )
        if not np.isfinite(time).all() or np.any(np.diff(time) <= 0):
            raise InvalidValueError("times", "times that do not rise", "finite times that rise")
        if isinstance(names, str):
            if names not in SKELETONS:
                raise UnknownNameError("skeleton", names, SKELETONS)
            names = SKELETONS[names]
        known = tuple(plain_name(name) for name in names)
        if len(known) != place.shape[1] or len(set(known)) != len(known):
            found = f"{len(known)} ({shortened(', '.join(known))})"
            raise InvalidValueError("names", found, f"{place.shape[1]} different names, one for each point")
        self.__dict__.update(times=read_only(time), points=read_only(place), names=known)

    def __len__(self) -> int:
        """Return the number of times T."""
        return len(self.times)

    def has(self, *names: str) -> bool:
        """Whether all named points are present."""
        return all(name in self.names for name in names)

    def of(self, name: str) -> Array:
        """Return one point over time, shape (T, 3).

        Raises:
            UnknownNameError: for a point that is not present.
        """
        if name not in self.names:
            raise UnknownNameError("key point", name, self.names)
        return np.asarray(self.points[:, self.names.index(name)])


def plain_name(name: str) -> str:
    """Return the name of a key point in this module's spelling: "left_shoulder" for "LShoulder"."""
    plain = re.sub(r"[^a-z0-9]", "", str(name).lower())
    return _SPELLINGS.get(plain, plain)


def read_key_points(
    path: PathName, names: str | Sequence[str] | None = None, rate: float | None = None
) -> KeyPoints:
    """Read key points over time from a NumPy archive (`.npz`) or a table (`.csv`).

    An archive holds `points`, shape (T, K, 3), and optionally `names`, K strings, and `times` [s], shape
    (T,).  A table begins with a line of names: `time` [s], then three columns for each point, such as
    `left_wrist.x`, `left_wrist.y` and `left_wrist.z`; an empty cell or `nan` is a point that was not
    observed.

    Args:
        path: Path of the file.
        names: Names of the points, as `KeyPoints` takes them, if the archive has none.
        rate: Frame rate [1/s], if the archive has no times; 30 if omitted.

    Raises:
        FileFormatError: for an invalid file, naming it and the fault.
        UnknownNameError: for an unknown skeleton.
    """
    ending = as_path(path).suffix.lower()
    if ending not in (".npz", ".csv"):
        raise FileFormatError(path, f"ends in {shortened(repr(ending))}, expected .npz or .csv")
    if rate is not None:
        check_positive("rate", rate, "1/s")
    try:
        return _of_archive(path, names, rate) if ending == ".npz" else _of_table(path)
    except InvalidValueError as error:
        raise FileFormatError(path, str(error)) from error


def _of_archive(path: PathName, names: str | Sequence[str] | None, rate: float | None) -> KeyPoints:
    arrays = read_arrays(path)
    if "points" not in arrays or set(arrays) - _ARRAYS:
        listed = shortened(", ".join(sorted(arrays)))
        raise FileFormatError(path, f"holds {listed}, expected points, and perhaps names and times")
    for name in ("points", "times"):
        if name in arrays and arrays[name].dtype.kind not in "fiu":
            raise FileFormatError(path, f"{name} is {arrays[name].dtype}, expected numbers")
    if "names" in arrays:
        texts = arrays["names"]
        if texts.dtype.kind != "U" or texts.ndim != 1:
            raise FileFormatError(path, f"names is {texts.dtype} of shape {texts.shape}, expected texts")
        names = tuple(texts.tolist())
    if names is None:
        raise FileFormatError(path, f"has no names: give `names`, or one of {', '.join(SKELETONS)}")
    return KeyPoints(arrays.get("times", np.array(rate or _RATE)), arrays["points"], names)


def _of_table(path: PathName) -> KeyPoints:
    try:
        lines = list(csv.reader(io.StringIO(read_text(path)), strict=True))
    except csv.Error as error:
        raise FileFormatError(path, f"is not a table: {error}") from error
    if len(lines) < 3:
        raise FileFormatError(path, f"has {len(lines)} lines, expected names and two rows")
    header = [name.strip() for name in lines[0]]
    names = [name[:-2] for name in header[1::3]]
    columns = [f"{name}.{axis}" for name in names for axis in "xyz"]
    if header != ["time", *columns] or not names:
        expected = "time, then x, y and z of each point, such as left_wrist.x"
        raise FileFormatError(path, f"begins with {shortened(', '.join(header))}, expected {expected}", 1)
    rows = np.empty((len(lines) - 1, len(header)))
    for number, line in enumerate(lines[1:]):
        if len(line) != len(header):
            raise FileFormatError(path, f"has {len(line)} cells, expected {len(header)}", number + 2)
        try:
            rows[number] = [float(cell) if cell.strip() else np.nan for cell in line]
        except ValueError as error:
            raise FileFormatError(path, str(error), number + 2) from error
    return KeyPoints(rows[:, 0], rows[:, 1:].reshape(len(rows), -1, 3), names)
