"""Solutions on which the robot stands: the center of mass inside the wheels' triangle."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.dynamics import center_of_mass
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import distances_inside, inward_normals, support_polygon
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.center_of_mass import center_of
from pepper_kin.ik.tasks.center_of_mass_over_wheels import CenterOfMassOverWheels
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel
from pepper_kin.model.requirements import ROOM_TO_MOVE
from pepper_kin.model.wheels import BASE_JOINTS

_ROUNDING = 1e-4  # [m]: a task is met to its tolerance


def over_wheels(balance: float, loads: Loads) -> list[Task]:
    """Return the task that keeps the center of mass, with what is carried, inside the wheels' triangle.

    Args:
        balance: Distance from the edges that motions keep [m]; at rest `ROOM_TO_MOVE` is added.
        loads: What is carried.
    """
    return with_loads([CenterOfMassOverWheels(balance + ROOM_TO_MOVE + _ROUNDING)], loads)


def stands(pepper: PepperModel, q: Array, balance: float, loads: Loads) -> np.ndarray:
    """Return whether motions that keep a balance [m] may end at joint positions, shape (..., n) -> (...)."""
    return distance_inside(pepper, q, loads) >= balance + ROOM_TO_MOVE


def distance_inside(pepper: PepperModel, q: Array, loads: Loads) -> Array:
    """Return how far inside the wheels' triangle the center of mass is at rest [m], negative outside.

    Args:
        pepper: The robot, whose wheels are known.
        q: Joint positions [rad or m], shape (..., n).
        loads: What is carried.

    Returns:
        Distances from the nearest edge, shape (...).
    """
    corners = support_polygon(pepper)
    assert corners is not None
    if loads:
        rows = [center_of(pepper, loads, row) for row in q.reshape(-1, pepper.n)]
        place = np.reshape(rows, (*q.shape[:-1], 3))[..., :2]
    else:
        place = center_of_mass(pepper, q)[..., :2]
    if set(BASE_JOINTS) <= set(pepper.joint_names):
        x, y, yaw = (q[..., pepper.joint_index(joint)] for joint in BASE_JOINTS)
        ahead, aside, cosine, sine = place[..., 0] - x, place[..., 1] - y, np.cos(yaw), np.sin(yaw)
        place = np.stack([cosine * ahead + sine * aside, cosine * aside - sine * ahead], axis=-1)
    return distances_inside(corners, inward_normals(corners), place).min(axis=-1)
