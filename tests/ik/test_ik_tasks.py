"""Tasks: residuals by their definition, Jacobians by finite differences, refusals by name."""

import inspect
import math
import re
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ik.tasks.direction import direction_residual, sideways_basis
from pepper_kin.model.shapes import rotation_rpy, transform

ROOT = Path(__file__).parents[2]
MODELS = [("fixed", "locked"), ("planar", "mimic")]

TASKS = {
    "position": pk.ik.FramePosition("l_wrist", (0.3, 0.2, 0.9)),
    "in a plane": pk.ik.FrameInPlane("RArm_effector", (0.3, -0.2, 0.8), (1, 2, -0.5)),
    "hand position": pk.ik.HandPosition("right", (0.3, -0.2, 0.9), weight=2.0),
    "orientation": pk.ik.FrameOrientation("torso", rotation_rpy(0.4, -0.3, 0.2)),
    "alignment": pk.ik.AxisAlignment("l_wrist", (0.3, 0.2, 1.0), axis=(0.1, 0.9, 0.3)),
    "point": pk.ik.Point("left", (1.0, 0.5, 0.2)),
    "look at": pk.ik.LookAt((0.8, 0.3, 0.7)),
    "look at, near": pk.ik.LookAt((0.2, 0.05, 1.0), camera="CameraBottom_frame"),
    "look at, optical": pk.ik.LookAt((0.8, 0.3, 0.7), camera="CameraDepth_optical_frame"),
    "forearm at a point": pk.ik.PointAt("left", (1.5, 0.8, 0.6)),
    "arm at a point": pk.ik.PointAt("right", (0.9, 0.3, 1.4), line="arm"),
    "arm at a point behind": pk.ik.PointAt("right", (-1.0, 0.1, 0.4), line="arm"),
    "hand before the eye": pk.ik.LineThroughPoint("CameraTop_frame", "RArm_effector", (2.0, -0.4, 0.9)),
    "look behind": pk.ik.LookAt((-2.0, 0.3, 1.2)),
    "joints": pk.ik.JointPosture((0.1, -0.3), joints=("HeadYaw", "LElbowRoll")),
    "joint": pk.ik.JointValue("HipRoll", 0.1),
    "relative position": pk.ik.RelativePosition("LArm_effector", "RArm_effector", (0.1, 0.3, -0.1)),
    "relative orientation": pk.ik.RelativeOrientation("LArm_effector", "Head", rotation_rpy(0.2, 0.4, -1.0)),
    "center of mass": pk.ik.CenterOfMass((0.02, -0.01)),
    "over the wheels": pk.ik.CenterOfMassOverWheels(0.08),
    "torque": pk.ik.HoldingTorque(0.2),
    "torque of two joints": pk.ik.HoldingTorque(0.1, joints=("KneePitch", "HipRoll")),
}
EXPRESSIONS = {
    "height": lambda pepper: pk.ik.Expression(pepper, lambda q: height(pepper)(q)[2, 3] - 0.8),
    "two bounds": lambda pepper: pk.ik.Expression(pepper, lambda q: [q[0] * q[1], q[2] ** 2], -0.1, [0.3, 1]),
    "one bound": lambda pepper: pk.ik.Expression(pepper, pk.symbolic.gravity_torque(pepper), upper=1.0),
}


def height(pepper):
    return pk.symbolic.frame_pose(pepper, "LArm_effector")


BASE_TASKS = {
    "base position": pk.ik.BasePlacement((0.4, -1.0)).parts[0],
    "base yaw": pk.ik.BasePlacement(yaw=5.0).parts[0],
}


def random_states(pepper, count, seed):
    low, high = np.maximum(pepper.lower_limits, -3), np.minimum(pepper.upper_limits, 3)
    return np.random.default_rng(seed).uniform(low, high, (count, pepper.n))


def public_tasks(*bases):
    """Yield the names of the public classes of tasks."""
    for name in pk.ik.__all__:
        value = getattr(pk.ik, name)
        if inspect.isclass(value) and issubclass(value, bases) and not inspect.isabstract(value):
            yield name


def test_every_task_is_compared_with_finite_differences():
    tasks = [*(TASKS | BASE_TASKS).values(), *(make(pk.load_pepper()) for make in EXPRESSIONS.values())]
    forgotten = {*public_tasks(pk.ik.Task)} - {type(task).__name__ for task in tasks}
    assert not forgotten, f"add a line to TASKS in tests/ik/test_ik_tasks.py for each of {sorted(forgotten)}"


def test_every_task_stands_in_the_table_of_its_page():
    """The two parts of `BasePlacement` are for programs that build tasks."""
    rows = re.findall(r"^\| (`[^|]+) \|", (ROOT / "docs" / "ik.md").read_text("utf-8"), re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)\(", row)}
    forgotten = {*public_tasks(pk.ik.Task, pk.ik.TaskGroup)} - named - {"BasePosition", "BaseYaw"}
    assert not forgotten, f"add a row to the table of tasks in docs/ik.md for each of {sorted(forgotten)}"


@pytest.mark.parametrize(
    ("name", "model"),
    [(name, model) for name in TASKS | EXPRESSIONS for model in MODELS]
    + [(name, MODELS[1]) for name in BASE_TASKS],
)
def test_jacobian_is_the_derivative_of_the_residual(name, model):
    pepper, step = pk.load_pepper(*model), 1e-6
    task = EXPRESSIONS[name](pepper) if name in EXPRESSIONS else (TASKS | BASE_TASKS)[name]
    for q in random_states(pepper, 8, 1):
        columns = [
            (task.residual(pepper, q + d) - task.residual(pepper, q - d)) / (2 * step)
            for d in step * np.eye(pepper.n)
        ]
        jacobian = task.jacobian(pepper, q)
        assert jacobian.shape == (task.residual(pepper, q).size, pepper.n)
        np.testing.assert_allclose(jacobian, np.transpose(columns), atol=2e-7)


def test_whole_posture_jacobian():
    pepper = pk.load_pepper()
    task = pk.ik.JointPosture(pepper.posture("Crouch"))
    np.testing.assert_array_equal(task.jacobian(pepper, pepper.neutral()), np.eye(pepper.n))
    deviation = np.abs(pepper.neutral() - pepper.posture("Crouch")).max()
    assert task.error(pepper, pepper.neutral()) == pytest.approx(deviation)


def test_errors_by_plain_geometry():
    pepper = pk.load_pepper()
    for q in random_states(pepper, 10, 2):
        hand = pk.kinematics.frame_pose(pepper, q, "LArm_effector")
        camera = pk.kinematics.frame_pose(pepper, q, "CameraTop_frame")
        point = np.array([0.4, 0.3, 0.8])
        assert pk.ik.HandPosition("left", point).error(pepper, q) == pytest.approx(
            math.dist(point, hand[:3, 3])
        )
        line = point - camera[:3, 3]
        cosine = line @ camera[:3, 0] / np.linalg.norm(line)
        assert pk.ik.LookAt(point).error(pepper, q) == pytest.approx(math.acos(cosine), abs=1e-7)
        cosine = hand[:3, 0] @ (0.6, 0.0, 0.8)
        assert pk.ik.Point("left", (3, 0, 4)).error(pepper, q) == pytest.approx(math.acos(cosine), abs=1e-7)
        target = rotation_rpy(0.2, 0.5, -0.4)
        cosine = (np.trace(hand[:3, :3].T @ target) - 1) / 2
        task = pk.ik.FrameOrientation("LArm_effector", target)
        assert task.error(pepper, q) == pytest.approx(math.acos(cosine), abs=1e-7)


def test_direction_residual_grows_up_to_a_half_turn():
    axis = np.array([1.0, 0.0, 0.0])
    basis = sideways_basis(axis)
    angles = np.concatenate([[0.0, 1e-9, 1e-4, 9.9e-4, 1.1e-3], np.linspace(0.01, math.pi - 1e-5, 50)])
    for angle in angles:
        direction = np.array([math.cos(angle), math.sin(angle) * 0.6, math.sin(angle) * 0.8])
        residual, slope = direction_residual(axis, basis, direction)
        assert np.linalg.norm(residual) == pytest.approx(angle, abs=1e-9)
        assert np.isfinite(slope).all()
    residual, slope = direction_residual(axis, basis, -axis)
    assert np.linalg.norm(residual) == pytest.approx(math.pi, abs=1e-6)
    assert np.isfinite(slope).all()
    assert np.abs(slope.T @ residual).max() > 0.1


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.48, 0.6, -0.64)])
def test_sideways_basis_is_orthonormal(axis):
    frame = np.vstack([axis, sideways_basis(np.array(axis, dtype=float))])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)


def test_hand_tasks_act_on_the_effectors():
    assert pk.ik.HandPosition("left", (0, 0, 0)).frame == "LArm_effector"
    assert pk.ik.Point("right", (1, 0, 0)).frame == "RArm_effector"
    pose = pk.ik.HandPose("right", transform((0.1, 0.2, 0.3), (0.1, 0.2, 0.3)))
    assert pose.frame == "RArm_effector"
    assert [part.unit for part in pose.parts] == ["m", "rad"]


def test_targets_are_copies_and_read_only():
    point, pose, matrix = np.array([0.3, 0.2, 0.9]), transform((0.3, 0.2, 0.9)), np.eye(3)
    tasks = [
        pk.ik.HandPosition("left", point),
        pk.ik.LookAt(point),
        pk.ik.HandPose("left", pose),
        pk.ik.FrameOrientation("torso", matrix),
    ]
    before = [task.target.copy() for task in tasks]
    point[:], pose[:], matrix[:] = 7, 7, 7
    for task, target in zip(tasks, before, strict=True):
        np.testing.assert_array_equal(task.target, target)
        with pytest.raises(ValueError, match="read-only"):
            task.target[0] = 1.0
        with pytest.raises(AttributeError):
            task.target = target


def test_bad_numbers_are_refused_by_name():
    pepper, wheels = pk.load_pepper(), pk.ik.CenterOfMassOverWheels
    hands, apart = ("LArm_effector", "RArm_effector"), transform((0.0, 0.25, 0.0), (0.1, -0.2, 0.3))
    for make, words in [
        (lambda: pk.ik.Point("left", (0, 0, 0)), ["direction of left hand", "not zero"]),
        (lambda: pk.ik.FrameOrientation("torso", np.ones((3, 3))), ["orientation of torso", "orthonormal"]),
        (lambda: pk.ik.FrameOrientation("torso", np.diag([1, 1, -1])), ["right-handed"]),
        (lambda: pk.ik.FramePose("torso", np.ones((4, 4))), ["target of torso", "last row"]),
        (lambda: pk.ik.LookAt((1, 0, 1), weight=math.inf), ["weight of gaze", "finite"]),
        (lambda: pk.ik.LookAt((1, 0, 1), tolerance=-1), ["tolerance of gaze", "above 0 [rad]"]),
        (lambda: pk.ik.JointPosture((1, 1), joints=("HeadYaw", "HeadYaw")), ["joints of posture", "once"]),
        (lambda: pk.ik.RelativePose(*hands[:1] * 2, apart), ["frame and reference", "two different frames"]),
        (lambda: pk.ik.RelativePose(*hands, np.ones((4, 4))), ["target of LArm", "last row"]),
        (lambda: pk.ik.RelativePose(*hands, apart, without="both"), ["without", "'both'", "'position'"]),
        (lambda: pk.ik.RelativePose(*hands, apart, hard="yes"), ["hard of LArm", "'yes'", "True or False"]),
        (lambda: pk.ik.CenterOfMass((0, 0), hard=1), ["hard of center of mass", "True or False"]),
        (
            lambda: wheels(0.2).error(pepper, pepper.neutral()),
            ["margin of center of mass", "0.2000 m", "at most"],
        ),
        (lambda: wheels(contacts=((0, 0), (0, 1), (1, 0))), ["contacts", "counter-clock"]),
        (lambda: wheels(contacts=((0, 0), (1, 0))), ["contacts", "k >= 3"]),
        (lambda: pk.ik.BasePlacement(), ["placement of base", "neither"]),
        (lambda: pk.ik.BasePlacement((0, 0), hard=None), ["hard of position of base", "None"]),
        (lambda: pk.ik.BasePlacement((0, 0), tolerance=0), ["tolerance of position of base", "[m]"]),
        (lambda: pk.ik.JointValue(["HeadYaw"], 0.1), ["joint", "['HeadYaw']", "name of one joint"]),
        (lambda: pk.ik.JointValue("HeadYaw", 0.1, hard="no"), ["hard of HeadYaw", "'no'"]),
    ]:
        with pytest.raises(InvalidValueError) as caught:
            make()
        for word in words:
            assert word in str(caught.value)


def test_unknown_names_are_refused_with_what_there_is():
    pepper = pk.load_pepper()
    with pytest.raises(UnknownNameError, match=r"unknown joint or group 'Hand' .*; available: KneePitch"):
        pk.ik.solve(pepper, [pk.ik.JointPosture((0.5,), joints=("Hand",))], collisions=False)
    with pytest.raises(
        InvalidValueError, match=r"joints: got \('LHand',\), expected .*at least one moving joint"
    ):
        pk.ik.solve(pepper, [pk.ik.JointPosture((0.5,), joints=("LHand",))], collisions=False)
    with pytest.raises(
        InvalidValueError, match=r"posture: got shape \(2,\), expected shape \(1,\), for HeadYaw"
    ):
        pk.ik.solve(pepper, [pk.ik.JointPosture((0.1, 0.2), joints=("HeadYaw",))], collisions=False)
    with pytest.raises(InvalidValueError, match=r"posture: got shape \(3,\), expected shape \(..., 15\)"):
        pk.ik.solve(pepper, [pk.ik.JointPosture((0.5, 0.1, 0.2))], collisions=False)
