"""A frame in a plane: by all solvers, in batches, and beside other tasks."""

import numpy as np
import pytest

import pepper_kin as pk

PEPPER = pk.load_pepper()
NORMAL = np.array([1.0, 1.0, 0.5]) / 1.5


@pytest.mark.parametrize("solver", ["fast", "placo", "proxsuite"])
@pytest.mark.parametrize("normal", [(0.0, 0.0, 2.0), NORMAL])
def test_every_solver_brings_the_frame_into_the_plane(solver, normal):
    point = np.array([0.3, 0.1, 0.9])
    task = pk.ik.FrameInPlane("LArm_effector", point, normal)
    result = pk.ik.solve(PEPPER, [task], solver=solver, collisions=False)
    assert result.success, result.report()
    hand = pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3]
    assert abs((hand - point) @ np.array(normal)) / np.linalg.norm(normal) <= task.tolerance


def test_a_batch_of_heights_agrees_with_one_by_one():
    heights = np.linspace(0.5, 1.0, 7)
    points = np.column_stack([np.zeros(7), np.zeros(7), heights])
    tasks = [pk.ik.FrameInPlane("LArm_effector", points), pk.ik.LookAt((1.0, 0.2, 0.9))]
    found = pk.ik.solve_batch(PEPPER, tasks, collisions=False)
    assert found.success.all()
    hands = pk.kinematics.frame_pose(PEPPER, found.q, "LArm_effector")[:, 2, 3]
    np.testing.assert_allclose(hands, heights, atol=1e-3)
    one = pk.ik.solve(PEPPER, [task.at(3) for task in tasks], collisions=False)
    np.testing.assert_allclose(found.q[3], one.q, atol=1e-12)


def test_out_of_reach_it_comes_as_near_as_can_be():
    result = pk.ik.solve(PEPPER, [pk.ik.FrameInPlane("LArm_effector", (0.0, 0.0, 3.0))], collisions=False)
    assert not result.success
    assert "off the plane through (0.000, 0.000, 3.000)" in result.report()
