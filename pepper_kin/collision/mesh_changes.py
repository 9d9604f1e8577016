"""Scenes whose mesh files have changed on disk, for which cached checkers are built again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from weakref import WeakKeyDictionary

from pepper_kin.collision.mesh_file import file_state
from pepper_kin.collision.scene import Scene
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.model import Mesh

State = tuple[tuple[str | int, ...] | None, ...]

_files: WeakKeyDictionary[Scene, tuple[Path, ...]] = WeakKeyDictionary()
_current: WeakKeyDictionary[Scene, tuple[State, Scene | None]] = WeakKeyDictionary()
"""State of each scene's files, and the scene that replaces it; None for itself."""


def as_on_disk(scene: Scene | None) -> Scene | None:
    """Return a scene with its mesh files as they are now: the same value as long as they do not change.

    Data of a scene is cached by its value, and a changed file makes it another value.

    Raises:
        InvalidValueError: for anything but a scene.
    """
    if scene is None:
        return None
    if not isinstance(scene, Scene):
        raise InvalidValueError("scene", repr(scene), "a Scene, or None for the robot alone")
    files = _files.get(scene)
    if files is None:
        shapes = [item.geometry for item in scene.objects.values()]
        shapes += [item.geometry for item in scene.attached.values()]
        files = tuple(shape.path for shape in shapes if isinstance(shape, Mesh))
        _files[scene] = files
    if not files:
        return scene
    state = tuple(map(_state, files))
    known = _current.get(scene)
    if known is None:
        _current[scene] = state, None
        return scene
    if known[0] != state:
        objects = {name: replace(item) for name, item in scene.objects.items()}
        attached = {name: replace(item) for name, item in scene.attached.items()}
        known = _current[scene] = state, Scene(objects, attached, scene.allowed)
    return known[1] or scene


def _state(file: Path) -> tuple[str | int, ...] | None:
    """Return the state of a file; None if it is missing."""
    try:
        return file_state(file)
    except FileFormatError:
        return None
