"""Hard and soft tasks in conflict, poses for an arm of five joints, and tolerances with room."""

import math
import re

import numpy as np
import pinocchio
import pytest
from scipy.optimize import minimize

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKStatus
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.priorities import SolverContext, balanced, solve_with_priorities
from pepper_kin.ik.problem import SearchBudget, make_problem
from pepper_kin.ik.solvers import ALL_SOLVERS
from pepper_kin.model.shapes import rotation_rpy, transform

PEPPER = pk.load_pepper()
PLANAR = pk.load_pepper(base="planar")
LOW, HIGH = PEPPER.lower_limits, PEPPER.upper_limits
LEFT = [PEPPER.joint_index(name) for name in PEPPER.joint_group("left_arm")]
HERE, THERE = (0.35, 0.25, 0.9), (0.35, 0.33, 0.9)

EVERY_KIND = {
    "hand position": lambda hard: pk.ik.HandPosition("left", HERE, hard=hard),
    "frame position": lambda hard: pk.ik.FramePosition("l_wrist", HERE, hard=hard),
    "hand pose": lambda hard: pk.ik.HandPose("left", transform(HERE), hard=hard),
    "frame pose": lambda hard: pk.ik.FramePose("l_wrist", transform(HERE), hard=hard),
    "orientation": lambda hard: pk.ik.FrameOrientation("l_wrist", np.eye(3), hard=hard),
    "alignment": lambda hard: pk.ik.AxisAlignment("l_wrist", (1, 0, 0), hard=hard),
    "point": lambda hard: pk.ik.Point("left", (1, 0, 0), hard=hard),
    "look at": lambda hard: pk.ik.LookAt(HERE, hard=hard),
    "posture": lambda hard: pk.ik.JointPosture((0.1,), ("HeadYaw",), hard=hard),
    "joint value": lambda hard: pk.ik.JointValue("HeadYaw", 0.1, hard=hard),
    "relative pose": lambda hard: pk.ik.RelativePose("l_wrist", "r_wrist", transform(HERE), hard=hard),
    "relative position": lambda hard: pk.ik.RelativePosition("l_wrist", "r_wrist", HERE, hard=hard),
    "relative orientation": lambda hard: pk.ik.RelativeOrientation(
        "l_wrist", "r_wrist", np.eye(3), hard=hard
    ),
    "center of mass": lambda hard: pk.ik.CenterOfMass((0.0, 0.0), hard=hard),
    "over wheels": lambda hard: pk.ik.CenterOfMassOverWheels(hard=hard),
    "torque": lambda hard: pk.ik.HoldingTorque(0.8, hard=hard),
    "base": lambda hard: pk.ik.BasePlacement((0.0, 0.0), 0.0, hard=hard),
}


def place(q, frame="LArm_effector", pepper=PEPPER):
    """Placement of a frame by Pinocchio alone."""
    model = pepper.pinocchio_model
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, pepper.to_full(q))
    return data.oMf[pepper.frame_id(frame)]


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_every_task_can_be_hard(kind):
    for hard in (True, False):
        task = EVERY_KIND[kind](hard)
        parts = task.parts if isinstance(task, pk.ik.TaskGroup) else (task,)
        assert [part.hard for part in parts] == [hard] * len(parts)
    with pytest.raises(InvalidValueError, match=r"hard of .*: got 'very', expected True or False"):
        EVERY_KIND[kind]("very")


@pytest.mark.parametrize("solver", ALL_SOLVERS)
@pytest.mark.parametrize("weight", [1.0, 500.0])
def test_one_hand_cannot_be_at_two_points(solver, weight):
    """The known answer: the hand is at the hard point, and the soft error is the distance between the two."""
    tasks = [
        pk.ik.FramePosition("LArm_effector", THERE, weight=weight),
        pk.ik.HandPosition("left", HERE, hard=True),
    ]
    result = pk.ik.solve(PEPPER, tasks, solver=solver, collisions=False)
    assert math.dist(place(result.q).translation, HERE) <= 1e-3
    assert result.errors[0].value == pytest.approx(0.08, abs=1e-3)
    assert not result.success
    assert result.hard_met
    assert result.met == ("position of left hand",)
    assert result.unmet == ("position of LArm_effector",)
    report = result.report()
    assert report.startswith("every hard task is met, not every soft one: tasks contradict each other")
    assert result.conflict == ("position of LArm_effector", "position of left hand")
    assert "position of LArm_effector and position of left hand contradict each other" in report
    assert "met: position of left hand; not met: position of LArm_effector" in report
    assert "left hand (hard): error " in report
    assert result.advice.startswith("Use q if the soft tasks may fall short.")
    halfway = pk.ik.solve(
        PEPPER,
        [pk.ik.FramePosition("LArm_effector", p) for p in (THERE, HERE)],
        solver=solver,
        collisions=False,
    )
    np.testing.assert_allclose(place(halfway.q).translation, np.mean([HERE, THERE], axis=0), atol=2e-3)


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_one_joint_cannot_have_two_values(solver):
    tasks = [pk.ik.JointValue("HeadYaw", 0.2, hard=True), pk.ik.JointValue("HeadYaw", 0.7, weight=20.0)]
    result = pk.ik.solve(PEPPER, tasks, solver=solver, collisions=False)
    assert result.q[PEPPER.joint_index("HeadYaw")] == pytest.approx(0.2, abs=1e-3)
    assert result.hard_met
    assert not result.success


def test_soft_tasks_come_as_near_as_the_hard_ones_let_them():
    """Against SciPy's constrained optimum: the right hand's least distance with the left one in its place."""
    joints = [
        "KneePitch",
        "HipPitch",
        "HipRoll",
        *PEPPER.joint_group("left_arm"),
        *PEPPER.joint_group("right_arm"),
    ]
    index = [PEPPER.joint_index(name) for name in joints]
    preferred = np.array([0.5, 0.6, 1.0])

    def state(x):
        q = PEPPER.neutral()
        q[index] = x
        return q

    tasks = [pk.ik.HandPosition("left", HERE, hard=True), pk.ik.HandPosition("right", preferred)]
    result = pk.ik.solve(PEPPER, tasks, collisions=False)
    assert result.hard_met
    generator = np.random.default_rng(0)
    best = math.inf
    for _ in range(6):
        found = minimize(
            lambda x: float(np.sum((place(state(x), "RArm_effector").translation - preferred) ** 2)),
            generator.uniform(LOW[index], HIGH[index]),
            bounds=list(zip(LOW[index], HIGH[index], strict=True)),
            constraints={"type": "eq", "fun": lambda x: place(state(x)).translation - HERE},
            method="SLSQP",
            options={"maxiter": 150},
        )
        if found.success and math.dist(place(state(found.x)).translation, HERE) < 1e-4:
            best = min(best, math.sqrt(found.fun))
    assert math.isfinite(best)
    assert result.errors[1].value <= best + 2e-3


@pytest.mark.thorough
def test_hard_tasks_are_met_wherever_they_can_be():
    generator = np.random.default_rng(1)
    states = generator.uniform(LOW, HIGH, (120, PEPPER.n))
    hands = np.array([place(q).translation for q in states])
    others = np.array([place(q, "RArm_effector").translation for q in generator.permutation(states)])
    tasks = [
        pk.ik.HandPosition("left", hands, hard=True),
        pk.ik.HandPosition("right", others, weight=5.0),
        pk.ik.LookAt(generator.normal(size=(120, 3))),
        pk.ik.Point("right", (0, 1, 0.3)),
    ]
    found = pk.ik.solve_batch(PEPPER, tasks, collisions=False)
    assert found.hard_met.mean() > 0.99
    assert not found.success.all()
    assert f"hard tasks met in {found.hard_met.sum()}" in found.report()
    for row in (0, 17, 63):
        one = pk.ik.solve(PEPPER, [task.at(row) for task in tasks], collisions=False)
        np.testing.assert_array_equal(one.q, found.q[row])
        assert one.hard_met == found.hard_met[row]
        assert one.status is found.status(row)
        np.testing.assert_allclose([error.value for error in one.errors], found.errors[row], atol=1e-7)


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_hard_in_batches_of_every_solver(solver):
    points = np.array([HERE, THERE])
    tasks = [
        pk.ik.HandPosition("left", points, hard=True),
        pk.ik.FramePosition("LArm_effector", points + np.array([0, 0, 0.1])),
    ]
    found = pk.ik.solve_batch(PEPPER, tasks, solver=solver, restarts=2, collisions=False)
    assert found.hard_met.all()
    assert not found.success.any()
    np.testing.assert_allclose(found.errors[:, 1], 0.1, atol=1e-3)
    for q, point in zip(found.q, points, strict=True):
        assert math.dist(place(q).translation, point) <= 1e-3


def test_a_narrow_tolerance_is_met_by_raising_the_weight():
    tasks = [
        pk.ik.HandPosition("left", HERE, tolerance=3e-6, hard=True),
        pk.ik.FramePosition("LArm_effector", THERE),
    ]
    result = pk.ik.solve(PEPPER, tasks, collisions=False)
    assert math.dist(place(result.q).translation, HERE) <= 3e-6
    problem = make_problem(PEPPER, tasks, PEPPER.neutral(), np.ones(PEPPER.n, dtype=bool), keep_idle=True)
    budget = SearchBudget(seed=0, restarts=2, max_iterations=150, deadline=math.inf)
    loose = pk.ik.solve(PEPPER, [pk.ik.HandPosition("left", HERE, hard=True), tasks[1]], collisions=False).q
    assert math.dist(place(loose).translation, HERE) > 3e-6
    firm = solve_with_priorities(problem, SolverContext("fast", Collisions(PEPPER, None), budget), loose)
    assert math.dist(place(firm).translation, HERE) <= 3e-6


def test_a_hard_task_out_of_reach_is_said_to_be():
    tasks = [pk.ik.HandPosition("left", (2.0, 0.0, 1.0), hard=True), pk.ik.LookAt((1.0, 0.2, 1.0))]
    result = pk.ik.solve(PEPPER, tasks, collisions=False)
    assert not result.hard_met
    assert result.status is IKStatus.CLOSEST_UNREACHABLE
    assert result.report().startswith("not reached, not even every hard task: beyond reach")
    assert not result.advice.startswith("Use q")
    assert pk.ik.solve(PEPPER, pk.ik.LookAt((1.0, 0.2, 1.0)), collisions=False).hard_met


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_hard_and_soft_with_a_scene(solver):
    scene = pk.Scene().add_box("table", size=(0.3, 1.0, 0.04), position=(0.55, 0.0, 0.7))
    tasks = [
        pk.ik.HandPosition("left", HERE, hard=True),
        pk.ik.FramePosition("LArm_effector", (0.5, 0.25, 0.7)),
    ]
    result = pk.ik.solve(PEPPER, tasks, scene=scene, solver=solver, restarts=3)
    assert not result.in_collision
    assert math.dist(place(result.q).translation, HERE) <= 1e-3
    assert result.hard_met


def test_large_soft_weights_are_scaled_below_the_hard_ones():
    tasks = [
        pk.ik.LookAt(HERE, weight=50.0),
        pk.ik.HandPosition("left", HERE, weight=2.0, hard=True),
        pk.ik.Point("left", (1, 0, 0), weight=10.0),
    ]
    np.testing.assert_allclose([task.weight for task in balanced(tasks)], [1.0, 1.0, 0.2])
    assert [task.weight for task in tasks] == [50.0, 2.0, 10.0]
    np.testing.assert_allclose([task.weight for task in balanced(tasks[::2])], [1.0, 0.2])
    plain = (pk.ik.LookAt(HERE), pk.ik.HandPosition("left", HERE, hard=True))
    assert all(a is b for a, b in zip(balanced(plain), plain, strict=True))


def turned_poses(count, seed):
    """Poses whose position the left arm reaches alone, with an orientation that it cannot have there."""
    generator = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        q = PEPPER.neutral()
        q[LEFT] = generator.uniform(LOW[LEFT], HIGH[LEFT])
        pose = place(q).homogeneous
        pose[:3, :3] = pose[:3, :3] @ rotation_rpy(*generator.uniform(-0.4, 0.4, 3))
        poses.append(pose)
    return np.array(poses)


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_five_joints_meet_the_position_and_say_how_far_the_orientation_is_off(solver):
    pose = turned_poses(4, 8)[3]
    result = pk.ik.solve(
        PEPPER, pk.ik.HandPose("left", pose), joints="left_arm", solver=solver, restarts=8, collisions=False
    )
    moved = np.flatnonzero(result.q != PEPPER.neutral())
    assert set(moved) <= set(LEFT)
    found = place(result.q)
    assert math.dist(found.translation, pose[:3, 3]) <= 1e-3
    angle = np.linalg.norm(pinocchio.log3(found.rotation @ pose[:3, :3].T))
    assert angle > math.radians(0.5)
    assert not result.success
    assert result.met == ("position of left hand",)
    assert result.unmet == ("orientation of left hand",)
    assert result.errors[1].value == pytest.approx(angle)
    report = result.report()
    assert "met: position of left hand; not met: orientation of left hand" in report
    stated = re.search(r"left hand is turned ([\d.]+) deg away from its orientation", report)
    assert stated is not None, report
    assert float(stated[1]) == pytest.approx(math.degrees(angle), abs=0.06)


def test_five_joints_in_a_batch():
    poses = turned_poses(100, 3)
    found = pk.ik.solve_batch(PEPPER, pk.ik.HandPose("left", poses), joints="left_arm", collisions=False)
    assert np.mean(found.errors[:, 0] <= 1e-3) >= 0.95
    shared = pk.ik.solve_batch(
        PEPPER, pk.ik.HandPose("left", poses, position_first=False), joints="left_arm", collisions=False
    )
    assert np.mean(shared.errors[:, 0] <= 1e-3) < 0.2
    one = pk.ik.solve(PEPPER, pk.ik.HandPose("left", poses[5]), joints="left_arm", collisions=False)
    np.testing.assert_array_equal(one.q, found.q[5])


def test_a_pose_may_be_hard_in_its_position_alone():
    pose = turned_poses(1, 4)[0]
    task = pk.ik.HandPose("left", pose, hard=True, orientation_hard=False)
    assert [part.hard for part in task.parts] == [True, False]
    result = pk.ik.solve(PEPPER, task, joints="left_arm", collisions=False)
    assert result.hard_met
    assert math.dist(place(result.q).translation, pose[:3, 3]) <= 1e-3


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_a_preference_gives_way_to_a_tolerance(solver):
    """With infinite tolerance even a heavy wish for a posture does not keep a hand from its point."""
    hand = pk.ik.HandPosition("left", (0.75, 0.1, 0.5))
    preferred = pk.ik.JointPosture(PEPPER.neutral(), tolerance=math.inf)
    result = pk.ik.solve(PEPPER, [hand, preferred], solver=solver, restarts=4, collisions=False)
    assert result.success, result.report()
    assert math.dist(place(result.q).translation, hand.target) <= 1e-3
