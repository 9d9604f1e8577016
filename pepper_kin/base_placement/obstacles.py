"""Clearance to obstacles, without self-collisions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import clearance, in_collision
from pepper_kin.collision.movers import without_self_pairs
from pepper_kin.model import PepperModel, kept_for_robot

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


def obstacle_clearance(robot: PepperModel, q: Array, scene: Scene) -> Array:
    """Return the exact minimum distance between robot and obstacles [m], infinite without obstacles.

    Args:
        robot: The robot.
        q: Joint positions [rad or m], shape (T, N, n).
        scene: The obstacles.

    Returns:
        Minimum over the T configurations, shape (N,); below zero for overlapping shapes.
    """
    return np.asarray(np.min([clearance(_without_self(robot), states, scene) for states in q], axis=0))


def touches_obstacles(robot: PepperModel, q: Array, scene: Scene) -> np.ndarray:
    """Whether the robot touches an obstacle, shape (N,), at joint positions q, shape (N, n) [rad or m]."""
    return np.asarray(in_collision(_without_self(robot), q, scene))


@kept_for_robot(most=1)
def _without_self(robot: PepperModel) -> PepperModel:
    """Return the robot without self-collision pairs."""
    semantics = replace(robot.semantics, disabled_pairs=without_self_pairs(robot))
    return robot.with_parts(semantics=semantics, sphere_set=None)
