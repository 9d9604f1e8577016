"""Meaning of the arguments `scene` and `collisions`, common to all functions."""

from __future__ import annotations

from pepper_kin.collision.scene import Scene
from pepper_kin.exceptions import InvalidValueError

ROBOT_ALONE = Scene()
"""Scene used for `scene=None`: no obstacles; the robot is still checked against itself."""

LEFT_EMPTY = "The scene is empty: `add_box` and the like return a new one."


def is_left_empty(scene: Scene | None) -> bool:
    """Return whether a scene was given and is empty, as when results of `add_box` are dropped."""
    return not (scene is None or scene is ROBOT_ALONE or scene.objects or scene.attached or scene.movers)


def checked_world(scene: Scene | None, collisions: bool = True) -> Scene | None:
    """Return the scene in which collisions are checked; None if collisions are ignored.

    Args:
        scene: The world around the robot; None for none, the robot then being checked against itself alone.
        collisions: Whether collisions are checked.

    Raises:
        InvalidValueError: for an invalid scene, a `collisions` that is not a truth value, and for a scene
            that would not be checked.
    """
    if scene is not None and not isinstance(scene, Scene):
        raise InvalidValueError("scene", repr(scene)[:80], "a Scene, or None for the robot alone")
    if collisions is True:
        return ROBOT_ALONE if scene is None else scene
    if collisions is not False:
        raise InvalidValueError("collisions", repr(collisions)[:80], "True or False")
    if scene is not None:
        raise InvalidValueError("collisions", False, "True (the default) where a scene is given")
    return None
