"""Joints of a robot as the table that `core.kinematic_tree` reads."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.kinematic_tree import JOINT
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.moving_tree import moving_tree


@kept_for_robot(most=32)
def joint_table(pepper: PepperModel) -> Array:
    """Return the joints of `pinocchio_model`, the universe first, shape (njoints, JOINT), cached."""
    tree = moving_tree(pepper)
    table = np.zeros((tree.count, JOINT))
    for joint in range(1, tree.count):
        place = (*tree.positions[joint], *tree.rotations[joint].ravel("F"))
        table[joint] = (tree.parents[joint], tree.slides[joint], *place, *tree.axes[joint])
    return table
