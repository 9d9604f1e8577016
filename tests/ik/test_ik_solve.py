"""The call itself: reachable targets are reached, whatever is asked stays within limits."""

import math

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.ik.solvers import SOLVERS

PEPPER = pk.load_pepper()


def reachable(count, seed):
    """Hand and gaze points of random configurations."""
    generator = np.random.default_rng(seed)
    for _ in range(count):
        q = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        hand = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:3, 3]
        camera = pk.kinematics.frame_pose(PEPPER, q, "CameraTop_frame")
        yield hand, camera[:3, 3] + generator.uniform(0.5, 3.0) * camera[:3, 0]


@pytest.mark.thorough
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("gaze", [False, True], ids=["hand", "hand and gaze"])
def test_reachable_targets_are_reached(solver, gaze):
    missed = []
    for hand, point in reachable(60, 11):
        tasks = [pk.ik.HandPosition("left", hand)] + ([pk.ik.LookAt(point)] if gaze else [])
        result = pk.ik.solve(PEPPER, tasks, solver=solver, collisions=False)
        assert np.all(result.q >= PEPPER.lower_limits)
        assert np.all(result.q <= PEPPER.upper_limits)
        reached = pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3]
        good = np.linalg.norm(reached - hand) < 1e-3
        if gaze:
            camera = pk.kinematics.frame_pose(PEPPER, result.q, "CameraTop_frame")
            line = point - camera[:3, 3]
            angle = math.atan2(np.linalg.norm(np.cross(camera[:3, 0], line)), float(camera[:3, 0] @ line))
            good &= angle < math.radians(0.5)
        assert good == result.success
        if not good:
            missed.append(result.report())
    assert not missed, missed


@pytest.mark.parametrize("solver", SOLVERS)
def test_same_seed_same_answer(solver):
    tasks = [pk.ik.HandPosition("left", (-0.3, 0.3, 0.7)), pk.ik.LookAt((-0.3, 0.3, 0.7))]
    first = pk.ik.solve(PEPPER, tasks, solver=solver, seed=5, collisions=False)
    second = pk.ik.solve(PEPPER, tasks, solver=solver, seed=5, collisions=False)
    other = pk.ik.solve(PEPPER, tasks, solver=solver, seed=6, collisions=False)
    assert (first.seed, second.seed) == (5, 5)
    if solver == "proxsuite":
        # Its vector code sums in another order where memory is aligned in another way: equal to rounding.
        np.testing.assert_allclose(first.q, second.q, atol=1e-9)
        return
    np.testing.assert_array_equal(first.q, second.q)
    assert (first.iterations, first.restarts) == (second.iterations, second.restarts)
    assert first.iterations != other.iterations


def test_a_met_start_is_kept():
    q0 = PEPPER.posture("Crouch")
    hand = pk.kinematics.frame_pose(PEPPER, q0, "RArm_effector")[:3, 3]
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("right", hand), q0, collisions=False)
    np.testing.assert_array_equal(result.q, q0)
    assert result.iterations == 0


def test_near_targets_are_reached_by_small_motions():
    q0 = PEPPER.neutral()
    hand = pk.kinematics.frame_pose(PEPPER, q0, "LArm_effector")[:3, 3]
    for shift in np.vstack([0.03 * np.eye(3), -0.03 * np.eye(3)]):
        result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", hand + shift), collisions=False)
        assert result.success
        assert np.abs(result.q - q0).max() < 0.5
    idle = [i for i, name in enumerate(PEPPER.joint_names) if name.startswith(("R", "Head"))]
    np.testing.assert_array_equal(result.q[idle], q0[idle])


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("joints", ["left_arm", ("LShoulderPitch", "LElbowRoll", "KneePitch")])
def test_locked_joints_stay(solver, joints):
    free = PEPPER.joint_group(joints) if isinstance(joints, str) else joints
    locked = [i for i, name in enumerate(PEPPER.joint_names) if name not in free]
    for hand, _ in reachable(5, 3):
        tasks = [pk.ik.HandPosition("left", hand), pk.ik.LookAt(hand)]
        result = pk.ik.solve(PEPPER, tasks, solver=solver, joints=joints, restarts=3, collisions=False)
        np.testing.assert_array_equal(result.q[locked], PEPPER.neutral()[locked])


def test_preference_yields_to_the_task():
    wanted = PEPPER.joint_vector({"KneePitch": 0.3})
    point = (0.4, 0.25, 0.9)
    preference = pk.ik.JointPosture(wanted, weight=0.01, tolerance=math.inf)
    plain = pk.ik.solve(PEPPER, [pk.ik.HandPosition("left", point)], collisions=False)
    led = pk.ik.solve(PEPPER, [pk.ik.HandPosition("left", point), preference], collisions=False)
    assert plain.success
    assert led.success
    assert np.linalg.norm(led.q - wanted) < np.linalg.norm(plain.q - wanted)


@pytest.mark.placo
def test_both_solvers_agree_on_the_closest_point():
    for target in ((1.2, 0.4, 0.9), (0.0, 0.0, 1.8), (0.3, 0.9, 0.2)):
        points = []
        for solver in SOLVERS:
            result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), solver=solver, collisions=False)
            points.append(pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3])
        assert np.linalg.norm(points[0] - points[1]) < 5e-3


TASK = pk.ik.HandPosition("left", (0.4, 0.2, 0.9))


def test_misuse_is_refused_by_name():
    for call, error, words in [
        ({"solver": "magic"}, InvalidValueError, ["solver", "'magic'", "'fast', 'placo', 'proxsuite'"]),
        ({"start": np.zeros(3)}, InvalidValueError, ["start", "(3,)", "15"]),
        ({"start": np.zeros((2, 15))}, InvalidValueError, ["start", "(2, 15)", "(15,)"]),
        ({"start": np.full(15, math.nan)}, InvalidValueError, ["start", "nan", "KneePitch"]),
        ({"start": np.full(15, 0.5)}, LimitError, ["start", "LElbowRoll = 0.5", "outside"]),
        ({"joints": "left_leg"}, UnknownNameError, ["joint or group 'left_leg'", "left_arm"]),
        ({"joints": ["HeadRoll"]}, UnknownNameError, ["joint or group 'HeadRoll'", "HeadYaw"]),
        ({"joints": []}, InvalidValueError, ["joints", "at least one"]),
        ({"joints": "both_hands"}, InvalidValueError, ["joints", "both_hands", "at least one moving"]),
        ({"seed": -1}, InvalidValueError, ["seed", "-1", "at least 0"]),
        ({"seed": 0.5}, InvalidValueError, ["seed", "0.5", "integer"]),
        ({"restarts": -1}, InvalidValueError, ["restarts", "at least 0"]),
        ({"max_iterations": 0}, InvalidValueError, ["max_iterations", "at least 1"]),
        ({"timeout": 0}, InvalidValueError, ["timeout", "above 0 s"]),
        ({"timeout": math.nan}, InvalidValueError, ["timeout", "nan"]),
        ({"scene": "kitchen"}, InvalidValueError, ["scene", "'kitchen'", "Scene"]),
        ({"tasks": []}, InvalidValueError, ["tasks", "at least one task"]),
        ({"tasks": [(0.1, 0.2, 0.3)]}, InvalidValueError, ["tasks", "HandPosition"]),
        ({"tasks": "left"}, InvalidValueError, ["tasks", "'left'"]),
        ({"tasks": 3}, InvalidValueError, ["tasks", "3"]),
    ]:
        with pytest.raises(error) as caught:
            pk.ik.solve(PEPPER, **{"tasks": TASK, **call})
        for word in words:
            assert word in str(caught.value)
