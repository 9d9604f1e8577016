"""Size of what is kept for a scene, by which memories of scenes are bounded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pepper_kin.collision.scene import Scene

MOST_BYTES = 256e6
"""Size of all checkers of one kind that are kept for a robot [bytes]."""

_ROBOT, _OBJECT, _PER_BYTE = 400_000, 4_000, 20
"""Bytes kept for a robot, for an object, and for each byte of an object's arrays (estimated)."""


def scene_size(scene: Scene | None) -> int:
    """Return about how many bytes a checker of a robot in a scene keeps."""
    if scene is None:
        return _ROBOT
    size = _ROBOT
    shapes = [item.geometry for item in scene.objects.values()]
    shapes += [item.geometry for item in scene.attached.values()]
    for shape in shapes:
        arrays = (getattr(shape, name, None) for name in ("vertices", "faces", "points"))
        size += _OBJECT + _PER_BYTE * sum(array.nbytes for array in arrays if array is not None)
    return size


def checker_size(checker: Any) -> int:
    """Return about how many bytes something with a `scene` keeps."""
    return scene_size(checker.scene)
