"""The joints of a robot as the table that `core.kinematic_tree` reads."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.kinematic_tree import JOINT
from pepper_kin.model import PepperModel, kept_for_robot
<<<<<<< HEAD
from pepper_kin.model.moving_tree import moving_tree
=======
from pepper_kin.symbolic.alignment import joint_axis
>>>>>>> homes


@kept_for_robot(most=32)
def joint_table(pepper: PepperModel) -> Array:
    """Return the joints of `pinocchio_model`, the universe first, shape (njoints, JOINT), kept."""
<<<<<<< HEAD
    tree = moving_tree(pepper)
    table = np.zeros((tree.count, JOINT))
    for joint in range(1, tree.count):
        place = (*tree.positions[joint], *tree.rotations[joint].ravel("F"))
        table[joint] = (tree.parents[joint], tree.slides[joint], *place, *tree.axes[joint])
=======
    model = pepper.inner_model
    table = np.zeros((model.njoints, JOINT))
    for joint in range(1, model.njoints):
        axis, slides = joint_axis(model.joints[joint])
        place = pose_of(model.jointPlacements[joint])
        table[joint] = (model.parents[joint], slides, *place, *axis)
>>>>>>> homes
    return table
