"""The one meaning of `scene` and `collisions`, wherever a function takes them."""

from __future__ import annotations

from pepper_kin.collision.scene import Scene
from pepper_kin.exceptions import InvalidValueError

ROBOT_ALONE = Scene()
"""What `scene=None` stands for: nothing around the robot, which is checked against itself all the same."""

LEFT_EMPTY = "The scene is empty: `add_box` and the like return a new one."


def is_left_empty(scene: Scene | None) -> bool:
    """Whether a scene was given and holds nothing, as where results of `add_box` are dropped."""
    return not (scene is None or scene is ROBOT_ALONE or scene.objects or scene.attached or scene.movers)


def checked_world(scene: Scene | None, collisions: bool = True) -> Scene | None:
    """Return the scene in which collisions are checked; None where they are left out.

    Args:
        scene: The world around the robot; None for none, the robot then being checked against itself alone.
        collisions: Whether anything is checked.

    Raises:
        InvalidValueError: for a scene that is none, a `collisions` that is not a truth value, and for a scene
            that would go unexamined.
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
