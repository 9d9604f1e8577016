"""What pages are told of where bodies are: the kinematics, whatever the robot and however far it turns."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.viewer.server.body_poses import BodyPoses
from pepper_kin.viewer.server.targets import SharedTargets


@pytest.mark.parametrize("kind", [{}, {"base": "planar", "hands": "mimic"}])
def test_every_link_is_where_kinematics_puts_it(kind):
    pepper = pk.load_pepper(**kind)
    targets, rest = SharedTargets(pepper), np.zeros(pepper.n)
    packer = BodyPoses(pepper, pepper.link_names, targets)
    for q in np.random.default_rng(0).uniform(-4.0, 4.0, (20, pepper.n)):
        targets.keep_with(q)
        values = np.frombuffer(packer.packed(q, rest, rest, {}, 0), dtype="<f4", offset=8).reshape(-1, 7)
        poses, count = pk.kinematics.link_poses(pepper, q), len(pepper.link_names)
        np.testing.assert_allclose(values[:count, :3], poses[:, :3, 3], atol=1e-6)
        turns = Rotation.from_quat(values[:count, 3:]).as_matrix()
        np.testing.assert_allclose(turns, poses[:, :3, :3], atol=1e-6)
        np.testing.assert_allclose(values[count + 2 :, :3], targets.positions(), atol=1e-6)
        np.testing.assert_allclose(
            targets["right hand"].position, pk.kinematics.frame_pose(pepper, q, "RArm_effector")[:3, 3]
        )
