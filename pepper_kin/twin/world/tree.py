"""The robot's tree of joints for compiled code."""

from __future__ import annotations

import numpy as np

from pepper_kin.core.simulation.tree_motion import TreeTable
from pepper_kin.model import PepperModel


def tree_table(pepper: PepperModel | None) -> TreeTable:
    """Return the tree of a robot; of None, the world alone."""
    count = 1 if pepper is None else pepper.inner_model.njoints
    tree = TreeTable(
        np.zeros(count, np.int64),
        np.tile(np.eye(3), (count, 1, 1)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros(count, bool),
        np.full(count, -1, np.int64),
        np.zeros(count),
        np.zeros(count),
    )
    if pepper is None:
        return tree
    import pinocchio

    model = pepper.inner_model
    data = model.createData()
    pinocchio.computeJointJacobians(model, data, np.zeros(model.nq))
    for joint in range(1, count):
        column = model.joints[joint].idx_v
        motion = pinocchio.getJointJacobian(model, data, joint, pinocchio.LOCAL)[:, column]
        placement = model.jointPlacements[joint]
        tree.parent[joint] = model.parents[joint]
        tree.rotation[joint], tree.position[joint] = placement.rotation, placement.translation
        tree.slides[joint] = bool(np.abs(motion[3:]).max() < 1e-12)
        tree.axis[joint] = motion[:3] if tree.slides[joint] else motion[3:]
        row = pepper.full_map[column]
        driver = int(np.argmax(np.abs(row)))
        if row[driver] != 0.0:
            tree.driver[joint], tree.ratio[joint] = driver, row[driver]
        tree.offset[joint] = pepper.full_offset[column]
    return tree
