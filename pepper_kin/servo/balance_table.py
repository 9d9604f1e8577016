"""Balance table of a robot on wheels, for machine code."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.fast.near_table import joint_tree
from pepper_kin.core.balance_rows import BODY_MASS, BalanceTable
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import inward_normals, wheel_contacts
from pepper_kin.model import PepperModel
from pepper_kin.model.moving_tree import moving_tree

BASE = "base_footprint"


def balance_table(pepper: PepperModel, margin: float, loads: Loads = ()) -> BalanceTable:
    """Return the balance table of a robot.

    Args:
        pepper: The robot, with the frame `base_footprint`.
        margin: Distance kept from the edges of the wheels' triangle [m].
        loads: Loads of the robot.

    Raises:
        UnknownNameError: for a robot without that frame.
        InvalidValueError: for a robot whose wheels are not known.
    """
    pepper.frame_id(BASE)
    corners, tree, model = wheel_contacts(pepper, "balance"), moving_tree(pepper), pepper.inner_model
    joints, above = joint_tree(pepper)
    masses = np.zeros((len(joints), BODY_MASS))
    for joint, inertia in enumerate(model.inertias):
        _add(masses[joint], inertia.mass, inertia.lever, inertia.inertia)
    for load in loads:
        pose, joint = tree.frame_poses[load.frame], tree.frame_joints[load.frame]
        turn, place = pose[:3, :3], pose[:3, :3] @ load.center + pose[:3, 3]
        _add(masses[joint], load.mass, place, turn @ load.tensor @ turn.T)
    pose = tree.frame_poses[BASE]
    base = np.array([tree.frame_joints[BASE], *pose[:3, 3], *pose[:3, :3].ravel("F")], dtype=float)
    return BalanceTable(
        joints, above, pepper.full_map, pepper.full_offset, masses, base, np.array(corners),
        inward_normals(corners), np.array(model.gravity.linear), margin,
    )  # fmt: skip


def no_balance() -> BalanceTable:
    """Return the table that disables balance."""
    rows, numbers = np.empty((0, 0)), np.empty(0)
    return BalanceTable(rows, rows, rows, numbers, rows, numbers, rows, rows, numbers, 0.0)


def _add(row: np.ndarray, mass: float, center: np.ndarray, tensor: np.ndarray) -> None:
    """Add a rigid body to a row of inertial numbers.

    Args:
        row: Inertial numbers, changed, shape (BODY_MASS,).
        mass: Mass [kg].
        center: Center of mass in the frame of the row [m], shape (3,).
        tensor: Inertia about the center of mass, in the same axes [kg m^2], shape (3, 3).
    """
    second = np.trace(tensor) / 2 * np.eye(3) - tensor + mass * np.outer(center, center)
    row[0] += mass
    row[1:4] += mass * np.asarray(center)
    row[4:] += second[np.triu_indices(3)]
