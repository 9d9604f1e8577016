"""Sparsity, operation counts, memory and messages."""

import gc
import threading
import weakref
from collections import Counter

import casadi
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.symbolic.functions import make_function
from pepper_kin.symbolic.scalars import ScalarGraph, cosine, sine

NAMES = {code: name for name, code in vars(casadi).items() if name.startswith("OP_")}


def operations(function):
    return Counter(NAMES[function.instruction_id(k)] for k in range(function.n_instructions()))


def test_zeros_of_the_mass_matrix_are_those_of_the_tree(robot):
    """M_ij is structurally zero exactly where neither joint carries the other (mimic joints by E)."""
    model, gains = robot.pinocchio_model, robot.full_map != 0
    carried = np.zeros((model.njoints - 1, model.njoints - 1), dtype=bool)
    for i, support in enumerate(list(model.supports)[1:]):
        carried[i, np.array(list(support)[1:]) - 1] = True
    expected = gains.T @ (carried | carried.T) @ gains
    found = np.array(casadi.DM(symbolic.mass_matrix(robot).sparsity_out(0), 1)) != 0
    assert not np.any(found & ~expected)
    sampled = np.zeros_like(found)
    rng = np.random.default_rng(0)
    for _ in range(4):
        sampled |= np.abs(pk.dynamics.mass_matrix(robot, rng.uniform(-2, 2, robot.n))) > 1e-12
    assert not np.any(sampled & ~found)


def test_joints_off_the_path_are_zeros_of_the_jacobian():
    pepper = pk.load_pepper()
    sparsity = symbolic.frame_jacobian(pepper, "LArm_effector").sparsity_out(0)
    columns = {pepper.joint_names[j] for j in sparsity.get_triplet()[1]}
    assert columns == {*pepper.joint_names[:3], *pepper.joint_group("left_arm")}
    knee = [i for i, j in zip(*sparsity.get_triplet(), strict=True) if j == pepper.joint_index("KneePitch")]
    assert 1 not in knee, "the knee does not move the hand sideways"
    assert symbolic.frame_jacobian(pepper, "base_footprint").nnz_out() == 0


@pytest.mark.thorough
def test_one_sine_and_one_cosine_for_each_angle(small_robot):
    n_angles = sum(not b for b in _slides(small_robot))
    for name, build in symbolic.QUANTITIES.items():
        if name.startswith("frame_"):
            continue
        count = operations(build(small_robot))
        assert count["OP_SIN"] <= n_angles, name
        assert count["OP_COS"] <= n_angles, name


def _slides(robot):
    from pepper_kin.symbolic.tree import read_tree

    return [body.slides for body in read_tree(robot, compact=True).bodies]


def test_expressions_stay_short():
    """Operations of the default Pepper; compiled code takes time in proportion."""
    for quantity, most in [
        ("inverse_dynamics", 1500),
        ("forward_dynamics", 3300),
        ("mass_matrix", 1200),
        ("gravity_torque", 300),
        ("inverse_dynamics_derivatives", 8700),
        ("coriolis_matrix", 4900),
        ("center_of_mass", 170),
    ]:
        count = operations(symbolic.function(pk.load_pepper(), quantity))
        for free in ("OP_INPUT", "OP_OUTPUT", "OP_CONST", "OP_NEG"):
            del count[free]
        assert sum(count.values()) <= most


def test_functions_are_remembered_by_robot_and_arguments():
    pepper, other = pk.load_pepper(), pk.load_pepper("planar")
    first = symbolic.frame_pose(pepper, "Head")
    assert symbolic.frame_pose(pepper, frame="Head") is first
    assert symbolic.function(pepper, "frame_pose", "Head") is first
    assert symbolic.frame_pose(pepper, "torso") is not first
    assert symbolic.frame_pose(other, "Head").size1_in(0) == 18
    assert symbolic.inverse_dynamics(pepper, None) is symbolic.inverse_dynamics(pepper)


def test_a_robot_that_is_gone_is_forgotten():
    urdf = """<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">
        <parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""
    robot = pk.load_robot(urdf)
    symbolic.frame_pose(robot, "b")
    gone = weakref.ref(robot)
    del robot
    gc.collect()
    assert gone() is None


def test_threads_get_one_function():
    robot = pk.load_robot(pk.load_pepper().urdf)
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(symbolic.inverse_dynamics(robot))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8
    assert all(function is found[0] for function in found)


def test_names_of_inputs_and_outputs():
    pepper = pk.load_pepper()
    function = symbolic.forward_dynamics(pepper, contact_frame="Head")
    assert function.name_in() == ["q", "v", "tau", "wrench"]
    assert function.name_out() == ["a"]
    for name, build in symbolic.QUANTITIES.items():
        frames = {"frame_poses": [("Head", "torso")]}.get(name, ["Head"] if name.startswith("frame_") else [])
        assert build(pepper, *frames).name() == name
        assert name in symbolic.__all__
    assert symbolic.frame_poses(pepper, ["Head", "torso"]).size_out(0) == (8, 4)


def test_misuse_is_named():
    pepper = pk.load_pepper()
    with pytest.raises(UnknownNameError, match=r"unknown quantity 'rnea'; available: .*inverse_dynamics"):
        symbolic.function(pepper, "rnea")
    for build in (symbolic.frame_pose, symbolic.frame_jacobian, symbolic.inverse_dynamics):
        with pytest.raises(
            UnknownNameError,
            match=r"unknown frame 'Hand' \(did you mean 'r_hand'\?\); available: .*LArm_effector",
        ):
            build(pepper, "Hand")
    with pytest.raises(InvalidValueError, match=r"frames: got .* expected at least one name"):
        symbolic.frame_poses(pepper, [])
    with pytest.raises(InvalidValueError, match="pepper: got 'pepper', expected a PepperModel"):
        symbolic.mass_matrix("pepper")
    with pytest.raises(InvalidValueError, match="expected names, which can be hashed"):
        symbolic.frame_pose(pepper, ["Head"])


def test_scalars_fold_share_and_sign():
    graph = ScalarGraph()
    x, y = graph.inputs(2)
    assert x * 0.0 == 0.0
    assert x - x == 0.0
    assert (1.0 * x).place == x.place
    assert (x * y).place == (-(y * -x)).place
    assert (x - y).place == (y - x).place
    assert (x - y).negative != (y - x).negative
    assert cosine(-x).place == cosine(x).place
    assert sine(-x).negative
    assert len(graph.nodes) == 2 + 1 + 1 + 2
    outputs = {"r": [[x - y, -(x * y), 2.0], [0.0, x / y, 3.0 - x], [x + -2.5, x * x, 1.0 / (-y)]]}
    function = make_function("f", graph, {"p": [x, y]}, outputs)
    a, b = 0.7, -1.3
    expected = [[a - b, -a * b, 2.0], [0.0, a / b, 3.0 - a], [a - 2.5, a * a, -1.0 / b]]
    np.testing.assert_allclose(np.array(function([a, b])), expected, rtol=1e-15)
    assert function.nnz_out() == 8
