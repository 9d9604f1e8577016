"""Batches of planning problems: each plan is the one that a single call returns, to the bit."""

import inspect
import itertools

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.motion import PlanProblem, PlanStatus, plan_batch
from pepper_kin.motion.planning_process import UnansweredError, helpers

LEG = """<robot name="leg"><link name="base"/>
  <link name="a"><inertial><mass value="1"/>
      <inertia ixx="1e-2" ixy="0" ixz="0" iyy="1e-2" iyz="0" izz="1e-2"/></inertial>
    <collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="x" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="100" velocity="1"/></joint></robot>"""


@pytest.fixture(scope="module")
def pepper():
    return pk.load_pepper()


@pytest.fixture(scope="module", autouse=True)
def helper():
    """A helper that has started: else the few problems of a test would be solved before."""
    found = helpers(1)[0]
    assert found.ready.wait(120.0)
    return found


def problems_of(pepper, count=24):
    rng = np.random.default_rng(1)
    stand, made = pepper.posture("Stand"), []
    for k in range(count):
        if k % 4 == 0:
            scene = pk.Scene()
            for box in range(4):
                place = rng.uniform([0.35, -0.6, 0.4], [0.7, 0.6, 1.2])
                scene = scene.add_box(f"box {box}", size=rng.uniform(0.05, 0.15, 3), position=place)
        target = pk.ik.HandPosition("left", rng.uniform([0.2, 0.05, 0.6], [0.4, 0.4, 1.1]))
        made.append(PlanProblem(pepper, stand, [target], scene, seed=k))
    return made


def assert_same(ours, theirs):
    assert (ours.status, ours.message, ours.states_checked) == (
        theirs.status,
        theirs.message,
        theirs.states_checked,
    )
    if theirs.path is None:
        assert ours.path is None
        return
    np.testing.assert_array_equal(ours.path, theirs.path)
    np.testing.assert_array_equal(ours.curve.breaks, theirs.curve.breaks)
    np.testing.assert_array_equal(ours.curve.coefficients, theirs.curve.coefficients)


def test_plans_are_those_of_single_calls_to_the_bit(pepper, helper):
    robot = pk.load_robot(LEG)
    ball = pk.Scene().add_box("ball", size=(0.1, 0.1, 0.1), position=(0.6, 0.0, 0.0))
    problems = problems_of(pepper)
    problems += [PlanProblem(robot, [0.0], [0.2]), PlanProblem(robot, [0.0], [0.4], ball)]
    calls = []
    batch = plan_batch(problems, processes=2, progress=lambda done, total: calls.append((done, total)))

    singles = [problem.solve() for problem in problems]
    for ours, theirs in zip(batch.plans, singles, strict=True):
        assert_same(ours, theirs)
    assert batch.errors == (None,) * len(problems)
    assert batch.success.sum() >= len(problems) - 6
    assert batch.plans[-1].status is PlanStatus.GOAL_IN_COLLISION
    assert calls[-1] == (len(problems), len(problems))
    assert all(a < b for (a, _), (b, _) in itertools.pairwise(calls))
    assert "problems have a path" in batch.report()


def test_what_a_helper_returns_is_as_if_it_was_made_here(pepper, helper):
    problem = problems_of(pepper, 1)[0]
    ((ours, error),) = helper.solve(pepper, problem.scene, [problem])
    theirs = problem.solve()
    assert error is None
    assert_same(ours, theirs)
    assert ours.clearance == theirs.clearance
    assert ours.margin == theirs.margin
    assert ours.ik.report().splitlines()[:3] == theirs.ik.report().splitlines()[:3]
    assert ours.ik.evidence.__self__.pepper is pepper  # no robot was sent back
    assert not ours.path.flags.writeable
    bare = PlanProblem(pepper, problem.start, pepper.joint_vector({"HeadYaw": 0.3}))
    ((ours, _),) = helper.solve(pepper, None, [bare])
    assert ours.clearance == bare.solve().clearance


def test_errors_stay_with_their_problem(pepper):
    stand = pepper.posture("Stand")
    good = PlanProblem(pepper, stand, pepper.joint_vector({"HeadYaw": 0.3}))
    batch = plan_batch(
        [
            PlanProblem(pepper, stand + 9.0, stand),
            good,
            PlanProblem(pepper, stand, stand[:3]),
            PlanProblem(pepper, stand, stand, joints="third_arm"),
            *[good] * 8,
            PlanProblem(pepper, stand, stand, margin=-1.0),
        ],
        processes=2,
    )
    kinds = [type(error) for error in batch.errors]
    assert kinds[:4] == [LimitError, type(None), InvalidValueError, UnknownNameError]
    assert kinds[-1] is InvalidValueError
    assert "is outside" in str(batch.errors[0])
    assert [plan is None for plan in batch.plans[:4]] == [True, False, True, True]
    assert "Problem 0 was refused: start:" in batch.report()


def test_what_hangs_on_the_robot_counts_in_each_problem(pepper):
    """The mass travels to the processes with its scene: held or refused as Pinocchio says."""
    stand, place = pepper.posture("Stand"), pinocchio.SE3(np.eye(3), np.array([0.08, 0.0, 0.0]))
    raised = pepper.joint_vector({"LShoulderPitch": 0.3, "LShoulderRoll": 0.3, "LElbowRoll": -0.3})
    cup, masses = pk.Scene().add_box("cup", (0.06, 0.04, 0.05), (2.0, 2.0, 0.5)), np.linspace(0.05, 1.0, 16)
    problems, held = [], []
    for mass in masses:
        scene = cup.attach("cup", "l_gripper", place.homogeneous, mass=float(mass))
        problems.append(PlanProblem(pepper, stand, raised, scene))
        model = pepper.inner_model.copy()
        frame = model.frames[pepper.frame_id("l_gripper")]
        inertia = pinocchio.Inertia.FromBox(float(mass), 0.06, 0.04, 0.05)
        model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement * place)
        torques = [pinocchio.rnea(model, model.createData(), q, 0 * q, 0 * q) for q in (stand, raised)]
        held.append(np.abs(torques / pepper.effort_limits).max() <= 0.95 * 0.9)
    batch = plan_batch(problems, processes=2)
    assert 2 < sum(held) < 14
    np.testing.assert_array_equal(batch.success, held)
    for problem, made, mass, fits in zip(problems, batch.plans, masses, held, strict=True):
        assert_same(made, problem.solve())
        assert [load.mass for load in made.loads] == ([pytest.approx(mass)] if fits else [])
        assert fits or "TORQUE_LIMIT" in made.status.name


def test_tasks_that_cannot_travel_are_solved_here(pepper, helper):
    class Here(pk.ik.FramePosition):
        """A class that no other process can import."""

    problem = PlanProblem(pepper, pepper.posture("Stand"), [Here("LArm_effector", (0.3, 0.2, 0.9))])
    with pytest.raises(UnansweredError):
        helper.solve(pepper, None, [problem])
    batch = plan_batch([problem] * 4, processes=2)
    assert batch.errors == (None,) * 4
    for plan in batch.plans:
        assert_same(plan, batch.plans[0])


def test_a_helper_that_dies_is_not_missed(pepper):
    helpers(1)[0].end()
    helpers(1)[0].ready.wait(120.0)
    problems = problems_of(pepper, 16)
    ended = []

    def kill(done, total):
        if not ended:
            ended.append(helpers(1)[0])
            ended[0].end()

    batch = plan_batch(problems, processes=2, progress=kill)
    assert all(plan is not None for plan in batch.plans)
    assert_same(batch.plans[-1], problems[-1].solve())


def test_a_problem_takes_what_plan_takes():
    asked = inspect.signature(PlanProblem).parameters
    taken = inspect.signature(pk.plan).parameters
    assert list(asked) == list(taken)
    assert [one.default for one in asked.values()] == [one.default for one in taken.values()]
    assert [one.kind for one in asked.values()] == [one.kind for one in taken.values()]


def test_problems_hold_copies_and_misuse_is_named(pepper):
    start = pepper.posture("Stand").copy()
    problem = PlanProblem(pepper, start, start)
    start += 5.0
    assert problem.solve().status is PlanStatus.SOLVED
    assert plan_batch([]).report().startswith("0 of 0 problems have a path")
    with pytest.raises(InvalidValueError, match=r"problems\[1\]: got 'no', expected a PlanProblem"):
        plan_batch([problem, "no"])
    with pytest.raises(InvalidValueError, match="processes: got 0"):
        plan_batch([problem], processes=0)
