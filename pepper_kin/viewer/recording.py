"""Motions as one self-contained page: no server, no network, opened from disk."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.file_access import atomic_file
from pepper_kin.viewer.camera import CameraView, Viewpoint, view_options
from pepper_kin.viewer.drawable import Color, Drawable, seen_through
from pepper_kin.viewer.drawing import draw_commands, link_path
from pepper_kin.viewer.ghost import GHOST_COLOR
from pepper_kin.viewer.joint_motion import Ghost, Note
from pepper_kin.viewer.motion_frames import MotionFrames, limited_series, motion_frames
from pepper_kin.viewer.page_template import filled_page
from pepper_kin.viewer.touching import TouchSpan

_SCRIPTS = ("stage.js", "motion.js", "axes.js", "plots.js", "panel.js")

# Codes of JavaScript's typed arrays in the MessagePack extensions of meshcat's Python side.
_ARRAY_TYPES = {0x12: "Uint8Array", 0x15: "Int32Array", 0x16: "Uint32Array", 0x17: "Float32Array"}


def save_motion_page(
    drawables: Sequence[Drawable],
    link_names: Sequence[str],
    times: ArrayLike,
    link_poses: ArrayLike,
    path: str | Path,
    *,
    title: str,
    series: Mapping[str, ArrayLike] | None = None,
    limits: Mapping[str, float] | None = None,
    markers: Sequence[Drawable] = (),
    fps: float = 40.0,
) -> Path:
    """Write a motion as one HTML file that plays it in 3D, with a time slider.

    The file contains meshcat's drawing code, the scene and the poses; a browser opens it from disk.  Between
    two frames the page interpolates positions linearly and orientations spherically.

    Args:
        drawables: Shapes of the robot and the scene.
        link_names: Names of the L links whose poses are given.
        times: Sample times, shape (T,), strictly increasing [s]; one sample gives a static scene.
        link_poses: Transforms from link to world, shape (T, L, 4, 4) [m].
        path: File to write; it appears when it is complete, and replaces an older one.
        title: Title of the page.
        series: Name of a curve to plot (with unit) -> values of shape (T,).
        limits: Largest allowed magnitude of a curve, by its name, in its unit; the axis of a limited curve
            shows fractions of the limit, with lines at the limits.
        markers: Targets, created by `marker`; they are listed by name on the page.
        fps: Maximum frames per second to keep.

    Returns:
        The path of the file.

    Raises:
        InvalidValueError: Wrong shapes, times that do not increase, NaN or infinite values, transforms that
            are not rigid, or a limit that is not above 0.
        UnknownNameError: A drawable sits on a link that is not in `link_names`, or a limit is of no curve.
        FileFormatError: A mesh file cannot be read, or the path cannot be written.
    """
    names = tuple(link_names)
    curves = limited_series(series or {}, limits or {})
    frames = motion_frames(times, link_poses, len(names), curves, fps)
    return write_frames_page(path, drawables, names, frames, title=title, markers=markers)


def write_frames_page(
    path: str | Path,
    drawables: Sequence[Drawable],
    link_names: Sequence[str],
    frames: MotionFrames,
    *,
    title: str,
    markers: Sequence[Drawable] = (),
    touches: Sequence[TouchSpan] = (),
    notes: Sequence[Note] = (),
    ghost: Ghost | None = None,
    view: CameraView | Viewpoint = "three-quarter",
) -> Path:
    """Write given frames as one HTML file; see `save_motion_page`.

    Links and objects of `touches` are drawn in red in their intervals, and named in a sentence; `notes` are
    shown in theirs.  `ghost` is the second robot, whose parts and frames are among the others.  The page
    opens with `view` unless its address has another view.
    """
    names = tuple(link_names)
    if len(set(names)) != len(names):
        raise InvalidValueError("link_names", "a name twice", "each link once")
    title = title.encode("utf-8", "replace").decode()  # names of files may contain invalid characters
    everything = (*drawables, *markers, *map(seen_through, markers))
    drawn = {drawable.link for drawable in everything}
    for link in drawn - {None, *names}:
        raise UnknownNameError("link", link, names)
    buffers = _Buffers()
    content = {
        "title": title,
        "commands": [buffers.embed(command) for command in draw_commands(everything)],
        "markers": [_legend_entry(ball) for ball in markers],
        "ghost": ghost and {"name": ghost.name, "beside": ghost.beside, "color": _css(GHOST_COLOR)},
        "motion": _motion_data(frames, names, drawn, buffers),
        "touches": [asdict(span) for span in touches],
        "notes": [asdict(note) for note in notes],
        "view": view_options(view),
        "buffers": buffers.contents,
    }
    # "<" occurs only inside JSON strings, where its escape means the same: no tag can start here.
    text = json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return atomic_file.write_text(path, filled_page("page", _SCRIPTS, title=html.escape(title), content=text))


class _Buffers:
    """Arrays of the page in base64, each distinct content once."""

    def __init__(self) -> None:
        self.contents: list[str] = []
        self._numbers: dict[bytes, int] = {}

    def add(self, data: bytes, array_type: str) -> dict[str, Any]:
        """Add data; return the placeholder that the page replaces by a typed array."""
        if data not in self._numbers:
            self._numbers[data] = len(self.contents)
            self.contents.append(base64.b64encode(data).decode("ascii"))
        return {"$buffer": self._numbers[data], "$type": array_type}

    def floats(self, values: NDArray[np.float64]) -> dict[str, Any]:
        """Add numbers of any shape in single precision, little-endian, row by row."""
        return self.add(np.asarray(values, dtype="<f4").tobytes(), "Float32Array")

    def _array(self, data: bytes, array_type: str) -> dict[str, Any]:
        """Add an array; small integers (vertex indices) are stored in half the space."""
        if array_type == "Uint32Array":
            indices = np.frombuffer(data, dtype="<u4")
            if indices.size and indices.max() < 2**16:
                return self.add(indices.astype("<u2").tobytes(), "Uint16Array")
        return self.add(data, array_type)

    def embed(self, value: Any) -> Any:
        """Return a command with placeholders for binary parts and with Python's numbers."""
        import umsgpack

        if isinstance(value, umsgpack.Ext):
            return self._array(value.data, _ARRAY_TYPES[value.type])
        if isinstance(value, dict):
            return {key: self.embed(item) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.embed(item) for item in value]
        return value.item() if isinstance(value, np.generic) else value


def _motion_data(
    frames: MotionFrames, names: tuple[str, ...], drawn: set[str | None], buffers: _Buffers
) -> dict[str, Any]:
    """Return the frames for the page; links without drawables are left out."""
    columns = [index for index, name in enumerate(names) if name in drawn]
    return {
        "times": buffers.add(np.asarray(frames.times, dtype="<f8").tobytes(), "Float64Array"),
        "links": [{"name": names[k], "path": list(link_path(names[k]))} for k in columns],
        "positions": buffers.floats(frames.positions[:, columns]),
        "quaternions": buffers.floats(frames.quaternions_xyzw[:, columns]),
        "series": [
            {
                "name": curve.name,
                "limit": curve.limit,
                "value": buffers.floats(curve.value),
                "low": buffers.floats(curve.low),
                "high": buffers.floats(curve.high),
                "ghost": None if curve.ghost is None else buffers.floats(curve.ghost),
                "command": None if curve.command is None else buffers.floats(curve.command),
            }
            for curve in frames.series
        ],
    }


def _legend_entry(ball: Drawable) -> dict[str, Any]:
    place = ball.transform_shape_to_link[:3, 3].tolist()
    return {"name": ball.name, "color": _css(ball.color), "position": place}


def _css(color: Color) -> str:
    """Convert a color to CSS, without its opacity."""
    red, green, blue = (round(255 * channel) for channel in color[:3])
    return f"rgb({red}, {green}, {blue})"
