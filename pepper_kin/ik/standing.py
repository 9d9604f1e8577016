"""Solutions at rest: the center of mass inside the wheels' triangle, and motors that hold the posture."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.core.kernel_batch import evaluate
from pepper_kin.dynamics import center_of_mass
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import distances_inside, inward_normals, support_polygon
from pepper_kin.ik.collisions import holding_torque, torque_ratios
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.center_of_mass import center_of
from pepper_kin.ik.tasks.center_of_mass_over_wheels import CenterOfMassOverWheels
from pepper_kin.ik.tasks.holding_torque import HoldingTorque
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.requirements import ROOM_TO_MOVE, limited_efforts
from pepper_kin.model.wheels import BASE_JOINTS

_ROUNDING = 1e-4  # tolerance of the balance task [m]
_SHARE_ROUNDING = 1e-3  # tolerance of the torque task, relative to the holding fraction
_DRAWN, _HEAVY = 64, 0.7  # number of postures, and fraction of the holding torque of a heavy joint


def tasks_at_rest(pepper: PepperModel, balance: float | None, loads: Loads) -> list[Task]:
    """Return tasks for postures that the robot can hold at rest with its loads.

    Args:
        pepper: The robot.
        balance: Distance from the edges of the wheels' triangle that motions keep [m]; at rest `ROOM_TO_MOVE`
            is added. None for no balance task.
        loads: Carried objects.
    """
    tasks: list[Task] = []
    if balance is not None:
        margin = balance + ROOM_TO_MOVE + _ROUNDING
        tasks.append(CenterOfMassOverWheels(margin, tolerance=_ROUNDING))
    if joints := _heavy_joints(pepper, loads):
        share = pepper.requirements.holding_share
        least, most = (1.0 - _SHARE_ROUNDING) * share, _SHARE_ROUNDING * share
        tasks.append(HoldingTorque(least, tolerance=most, joints=joints))
    return with_loads(tasks, loads)


@kept_for_robot(most=16)
def _heavy_joints(pepper: PepperModel, loads: Loads) -> tuple[str, ...]:
    """Return the joints that may lack torque at rest, from random postures within the limits."""
    low, high = np.maximum(pepper.lower_limits, -np.pi), np.minimum(pepper.upper_limits, np.pi)
    drawn = np.random.default_rng(0).uniform(low, np.maximum(low, high), (_DRAWN, pepper.n))
    most = torque_ratios(pepper, drawn, loads).max(axis=0)
    heavy = most > _HEAVY * pepper.requirements.holding_share
    return tuple(name for name, lacks in zip(pepper.joint_names, heavy, strict=True) if lacks)


def rests(pepper: PepperModel, q: Array, balance: float | None, loads: Loads) -> np.ndarray:
    """Return whether motions may end at joint positions q, shape (..., n) -> (...).

    Args:
        pepper: The robot; with a balance, its wheels have to be known.
        q: Joint positions [rad or m].
        balance: Distance from the edges of the wheels' triangle [m]; None for no balance constraint.
        loads: Carried objects.
    """
    held = holds(pepper, q, loads)
    return held if balance is None else held & stands(pepper, q, balance, loads)


def holds(pepper: PepperModel, q: Array, loads: Loads) -> np.ndarray:
    """Return whether the motors can hold joint positions q, shape (..., n) -> (...), with the reserve."""
    if loads or pepper.solvers != "fast":
        torque = holding_torque(pepper, q, loads)
    else:  # by the kernel of the search, so that a first answer does not wait for Pinocchio to load
        rows = np.ascontiguousarray(q).reshape(-1, pepper.n)
        torque = evaluate(kernel(pepper, "gravity_torque"), rows).reshape(q.shape)
    return np.asarray((np.abs(torque) <= _most_torque(pepper)).all(axis=-1))


@kept_for_robot(most=1)
def _most_torque(pepper: PepperModel) -> Array:
    """Return the maximum torque for holding still of each joint [N m or N], infinite without a limit."""
    most, limited = np.full(pepper.n, np.inf), limited_efforts(pepper)
    most[limited] = pepper.requirements.holding_share * pepper.effort_limits[limited]
    return most


def stands(pepper: PepperModel, q: Array, balance: float, loads: Loads) -> np.ndarray:
    """Return whether a balance [m] and `ROOM_TO_MOVE` are kept at q [rad or m], shape (..., n) -> (...)."""
    return distance_inside(pepper, q, loads) >= balance + ROOM_TO_MOVE


def distance_inside(pepper: PepperModel, q: Array, loads: Loads) -> Array:
    """Return the distance of the center of mass inside the wheels' triangle at rest [m], negative outside.

    Args:
        pepper: The robot, whose wheels are known.
        q: Joint positions [rad or m], shape (..., n).
        loads: Carried objects.

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
