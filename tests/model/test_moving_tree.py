"""Joints and frames that the library reads by itself, against Pinocchio's numbers."""

import importlib.metadata

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.dynamics.mass import joint_masses
from pepper_kin.model.moving_tree import moving_tree

URDFS = (
    "anymal_b_simple_description/robots/anymal-kinova.urdf",
    "icub_description/robots/icub.urdf",
    "panda_description/urdf/panda.urdf",
    "talos_data/robots/talos_full_v2.urdf",
    "tiago_description/robots/tiago.urdf",
)


def robots():
    for base in ("fixed", "planar"):
        for hands in ("locked", "mimic", "independent"):
            yield pytest.param(lambda b=base, h=hands: pk.load_pepper(base=b, hands=h), id=f"{base} {hands}")
    for urdf in URDFS:
        yield pytest.param(lambda urdf=urdf: other(urdf), id=urdf.split("/")[-1])


def other(urdf):
    package = importlib.metadata.distribution("example-robot-data")
    found = [file for file in package.files or () if str(file).endswith(f"robots/{urdf}")]
    return pk.load_robot(package.locate_file(found[0]))


def check(tree, pepper, model):
    masses = [inertia.mass for inertia in model.inertias]
    np.testing.assert_allclose(joint_masses(pepper), masses, rtol=1e-15, atol=0)
    joints = range(model.njoints)
    assert list(tree.parents) == list(model.parents)
    assert tree.count == model.njoints
    for joint in joints[1:]:
        place = model.jointPlacements[joint]
        np.testing.assert_allclose(tree.rotations[joint], place.rotation, rtol=0, atol=1e-15)
        np.testing.assert_allclose(tree.positions[joint], place.translation, rtol=0, atol=1e-15)
        assert tree.path(joint) == [j for j in model.supports[joint].tolist() if j > 0]
        assert tree.below(joint) == list(model.subtrees[joint])
        assert tree.carried()[joint].sum() == len(tree.path(joint))
    # What a joint does, by its motion: its frame at some position as Pinocchio places it.
    q = np.linspace(0.1, 0.4, model.nq)
    data = model.createData()
    pinocchio.forwardKinematics(model, data, q)
    for joint in joints[1:]:
        moved = model.jointPlacements[joint].actInv(data.oMi[model.parents[joint]].actInv(data.oMi[joint]))
        axis, value = tree.axes[joint], q[joint - 1]
        turn = np.eye(3) if tree.slides[joint] else pinocchio.exp3(axis * value)
        np.testing.assert_allclose(moved.rotation, turn, rtol=0, atol=1e-12)
        shift = axis * value if tree.slides[joint] else np.zeros(3)
        np.testing.assert_allclose(moved.translation, shift, rtol=0, atol=1e-12)
    assert set(tree.frame_joints) == set(pepper.frame_names)
    for name in pepper.frame_names:
        frame = model.frames[pepper.frame_id(name)]
        assert (frame.name, frame.parentJoint) == (name, tree.frame_joints[name])
        np.testing.assert_allclose(tree.frame_poses[name], frame.placement.homogeneous, rtol=0, atol=1e-15)


@pytest.mark.parametrize("load", robots())
def test_joints_and_frames_are_pinocchios(load):
    pepper = load()
    check(moving_tree(pepper), pepper, pepper.inner_model)


def test_what_is_changed_in_pinocchios_model_counts():
    pepper = pk.load_robot(pk.load_pepper().urdf)
    before = moving_tree(pepper)
    model = pepper.pinocchio_model
    model.jointPlacements[3] = pinocchio.SE3(pinocchio.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.1, 0, 0]))
    model.inertias[3].mass += 1.0
    pepper = pepper.with_pinocchio_model(model)
    check(moving_tree(pepper), pepper, model)
    assert not np.array_equal(moving_tree(pepper).rotations, before.rotations)
