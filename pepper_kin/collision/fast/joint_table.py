"""The joints of a robot as the table that `core.kinematic_tree` reads."""

from __future__ import annotations

from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.kinematic_tree import JOINT
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.symbolic.alignment import joint_axis


@kept_for_robot(most=32)
def joint_table(pepper: PepperModel) -> Array:
    """Return the joints of `pinocchio_model`, the universe first, shape (njoints, JOINT), kept."""
    model = pepper.inner_model
    table = np.zeros((model.njoints, JOINT))
    for joint in range(1, model.njoints):
        axis, slides = joint_axis(model.joints[joint])
        place = pose_of(model.jointPlacements[joint])
        table[joint] = (model.parents[joint], slides, *place, *axis)
    return table


def pose_of(placement: Any) -> Array:
    """Return one of Pinocchio's placements as a pose."""
    return np.concatenate([placement.translation, placement.rotation.ravel("F")])
