"""Hands whose position comes before their orientation: what is out of reach is not the position."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pepper_kin as pk

TOLERANCE = 0.00101  # [m]


@pytest.mark.parametrize("collisions", [False, True])
def test_positions_in_reach_are_met_whatever_the_orientation(pepper, collisions):
    """The points are made from postures, the orientations are drawn: most poses are out of reach."""
    rng = np.random.default_rng(3)
    made = rng.uniform(pepper.lower_limits, pepper.upper_limits, (400, pepper.n))
    if collisions:
        made = made[~pk.collision.in_collision(pepper, made)]
    made = made[: 60 if collisions else 400]
    targets = np.tile(np.eye(4), (len(made), 1, 1))
    targets[:, :3, 3] = pk.kinematics.frame_pose(pepper, made, "LArm_effector")[:, :3, 3]
    targets[:, :3, :3] = Rotation.random(len(made), random_state=1).as_matrix()
    found = pk.ik.solve_batch(pepper, pk.ik.HandPose("left", targets), collisions=collisions)
    reached = pk.kinematics.frame_pose(pepper, found.q, "LArm_effector")[:, :3, 3]
    assert not found.success.all()
    assert np.linalg.norm(reached - targets[:, :3, 3], axis=1).max() < TOLERANCE
