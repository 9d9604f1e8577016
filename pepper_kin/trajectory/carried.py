"""Loads along a path: a payload, and what is attached in a scene or in that of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pepper_kin.collision.loads import loads_of
from pepper_kin.dynamics.load import Loads
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.path import is_plan

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


def carried_along(
    pepper: PepperModel, path: Any, scene: Scene | None, payload: Mapping[str, float] | None
) -> Loads:
    """Return a payload and the attached objects of a scene; without a scene, those of a plan's.

    Args:
        pepper: The robot.
        path: A plan, whose `loads` count where no scene is given, or any other path.
        scene: The scene; None where none is given.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Raises:
        InvalidValueError: for a mass that is not a finite number above 0.
        UnknownNameError: for a frame that the robot lacks.
    """
    if scene is not None or not is_plan(path):
        return loads_of(pepper, scene, payload)
    return loads_of(pepper, None, payload) + tuple(getattr(path, "loads", ()))
