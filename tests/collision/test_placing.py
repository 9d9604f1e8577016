"""Machine code that places all bodies of a robot, beside Pinocchio."""

import ctypes

import numpy as np
import pinocchio
import pytest
from robots import loaded

from pepper_kin.collision.fast.placing import NUMBERS, placing_kernel
from pepper_kin.kernels.lanes import LANES
from pepper_kin.symbolic.tree import read_frames

ROBOTS = ("pepper-fixed-locked", "pepper-planar-mimic", "panda", "talos", "odd")


@pytest.mark.parametrize("name", ROBOTS)
def test_all_bodies_are_placed_as_pinocchio_does(name):
    robot = loaded(name)
    kernel, rng = placing_kernel(robot), np.random.default_rng(0)
    low, high = np.clip(robot.lower_limits, -3, 3), np.clip(robot.upper_limits, -3, 3)
    q = rng.uniform(low, high, (LANES, robot.n)).astype(np.float32)
    given = np.ascontiguousarray(q.T)
    model, count = robot.inner_model, robot.inner_model.njoints - 1
    poses, work = np.empty((count, NUMBERS, LANES), np.float32), np.empty(kernel.work_size, np.float32)
    address = kernel.address_of("block", inputs=robot.n, outputs=NUMBERS * count, work=kernel.work_size)
    block = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(address)
    block(given.ctypes.data, poses.ctypes.data, work.ctypes.data)
    data, alignments = model.createData(), read_frames(robot, compact=True).alignments
    for lane, state in enumerate(q.astype(float)):
        pinocchio.forwardKinematics(model, data, robot.to_full(state))
        for body in range(count):
            expected = data.oMi[body + 1] * pinocchio.SE3(alignments[body].rotation, alignments[body].origin)
            turn, origin = poses[body, :9, lane].reshape(3, 3), poses[body, 9:, lane]
            np.testing.assert_allclose(turn, expected.rotation, atol=3e-6)
            np.testing.assert_allclose(origin, expected.translation, atol=3e-6)
