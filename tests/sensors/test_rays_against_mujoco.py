"""Rays at the whole robot against MuJoCo's ray caster on the exported model."""

import mujoco
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin.sensors import RobotRays

DRAWN, FLOOR = mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_PLANE
HIDDEN = 5  # group of the geoms that no ray meets


@pytest.mark.parametrize("posture", ["Stand", "Crouch"])
@pytest.mark.parametrize("geometry_type", ["visual", "collision"])
def test_distances_to_the_body_are_those_of_mujoco(posture, geometry_type):
    pepper = pk.load_pepper()
    model = mujoco.MjModel.from_xml_string(pepper.export("mjcf"))
    data, q = mujoco.MjData(model), pepper.posture(posture)
    for name, value in zip(pepper.joint_names, q, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    unseen = (model.geom_type == DRAWN) == (geometry_type == "collision")
    model.geom_group[unseen | (model.geom_type == FLOOR)] = HIDDEN

    rng = np.random.default_rng(6)
    origins = rng.normal(size=(600, 3))
    origins = [0, 0, 0.7] + 1.5 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    targets = rng.uniform((-0.3, -0.4, 0.0), (0.3, 0.4, 1.2), (600, 3))
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    groups = np.array([1, 1, 1, 1, 1, 0], dtype=np.uint8)
    expected, geom = np.empty(600), np.zeros(1, dtype=np.int32)
    for k in range(600):
        expected[k] = mujoco.mj_ray(model, data, origins[k], directions[k], groups, 1, -1, geom)
    expected[expected < 0] = np.inf

    found = RobotRays(pepper, geometry_type, floor=False).distances(q, None, origins, directions)
    assert np.isfinite(expected).sum() > 150
    # Its meshes have corners of single precision: a ray along an outline may pass on either side.
    with np.errstate(invalid="ignore"):
        same = (found == expected) | (
            np.abs(found - expected) < (1e-5 if geometry_type == "visual" else 1e-9)
        )
    assert same.mean() >= (0.99 if geometry_type == "visual" else 1.0)
