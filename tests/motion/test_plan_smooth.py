"""Plans with the motion to execute: certified, on their own curve, and never worse than retimed."""

import pickle

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Wheels
from pepper_kin.motion import Cost, OptimizedStatus, optimize
from pepper_kin.motion.optimization.cost import figures_of
from pepper_kin.motion.plan_request import PlanOptions
from pepper_kin.motion.smoothed_plan import smoothed

TABLE = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))
AMPLE = 300.0  # [s] for the optimizer on a busy machine
PARTS = ("position", "velocity", "acceleration", "torque", "velocity_continuity", "self_clearance")
TWO_JOINTS = """<robot name="two">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="{effort}" velocity="2" acceleration="5"/></joint>
  <link name="hand"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="bend" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="2" acceleration="5"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def pair(pepper):
    """The plan of one problem with and without its motion."""
    goal = pepper.joint_vector(
        {"LShoulderPitch": 0.4, "LElbowRoll": -0.9, "LElbowYaw": -0.8, "HipPitch": -0.3}
    )
    ends = pepper.posture("Stand"), goal
    return pk.plan(pepper, *ends, TABLE), pk.plan(pepper, *ends, TABLE, smooth=True, timeout=AMPLE)


def test_the_motion_is_better_than_the_retimed_plan_and_its_certificate_is_green(pepper, pair):
    plain, made = pair
    assert made.success, made.report()
    assert made.optimized.status is OptimizedStatus.IMPROVED, made.report()
    before, after = (figures_of(pepper, m) for m in (pk.retime(pepper, plain), made.trajectory))
    assert after.cost(Cost()) < before.cost(Cost())
    certificate = made.trajectory.check(pepper, TABLE)
    for part in PARTS:
        assert getattr(certificate, part).success, getattr(certificate, part).sentence()
    assert f"{made.trajectory.duration:.3f} s" in made.report()
    assert "check()" in made.report()


def test_path_and_curve_are_those_of_the_motion(pepper, pair):
    plain, made = pair
    assert plain.trajectory is None
    assert plain.optimized is None
    np.testing.assert_array_equal(made.path[0], plain.path[0])
    np.testing.assert_allclose(made.path[-1], plain.goal, atol=1e-9)
    np.testing.assert_allclose(made.path, made.trajectory(made.trajectory.breaks).position, atol=1e-12)
    times = np.linspace(0.0, made.trajectory.duration, 50)
    again = pk.retime(pepper, made)
    points = again(np.linspace(0.0, again.duration, 4000)).position
    for q in made.trajectory(times).position:
        assert np.abs(points - q).max(axis=1).min() < 2e-3
    assert again.duration <= made.trajectory.duration * (1 + 1e-6)
    dense = made.trajectory(np.linspace(0.0, made.trajectory.duration, 2000)).position
    least = pk.collision.clearance(pepper, dense, TABLE).min()
    assert made.clearance.least == pytest.approx(least, abs=2e-3)
    assert least > 0.0


def test_a_plan_travels_with_its_motion(pair):
    made = pickle.loads(pickle.dumps(pair[1]))
    np.testing.assert_array_equal(made.trajectory.coefficients, pair[1].trajectory.coefficients)
    assert made.clearance == pair[1].clearance


def test_a_batch_returns_the_same_motions(pepper, pair):
    problem = pk.motion.PlanProblem(pepper, pair[1].path[0], pair[0].goal, TABLE, smooth=True, timeout=AMPLE)
    (found,) = pk.plan_batch([problem], processes=1).plans
    np.testing.assert_allclose(found.trajectory.coefficients, pair[1].trajectory.coefficients, atol=1e-9)


def test_where_optimization_gains_nothing_the_retimed_plan_stays():
    """A search without time to make a step offers a slower motion than that along the plan's own path."""
    robot = pk.load_robot(TWO_JOINTS.format(effort=30))
    plain = pk.plan(robot, [0.0, 0.0], [1.0, 0.0])
    made = smoothed(robot, plain, None, PlanOptions(timeout=1e-9))
    retimed = pk.retime(robot, plain)
    assert not made.optimized.success, made.message
    assert made.trajectory.duration == pytest.approx(retimed.duration, rel=1e-9)
    assert made.curve is plain.curve
    assert made.path is plain.path
    assert "Timed along its own path" in made.message
    assert f"{retimed.duration:.3f} s" in made.message


@pytest.mark.thorough
def test_payloads_are_optimized_too_and_their_certificate_is_green(pepper):
    goal = pepper.joint_vector(
        {
            "LShoulderPitch": 1.2,
            "LShoulderRoll": 0.6,
            "LElbowRoll": -0.1,
            "LElbowYaw": -0.6,
            "HipPitch": -0.15,
        }
    )
    carried = {"payload": {"left": 0.4}}
    made = pk.plan(pepper, pepper.posture("Stand"), goal, TABLE, smooth=True, timeout=AMPLE, **carried)
    assert made.optimized.status is OptimizedStatus.IMPROVED, made.message
    certificate = made.trajectory.check(pepper, TABLE, **carried)
    assert all(certificate.checks[part].success for part in PARTS), certificate.report()
    # The same motion without regard to the load asks too much of the joints, by another Newton-Euler.
    loaded, alone = (optimize(pepper, made.path, TABLE, **held) for held in (carried, {}))
    assert loaded.success
    assert alone.success
    assert loaded.trajectory.check(pepper, TABLE, **carried).torque.success
    assert not alone.trajectory.check(pepper, TABLE, **carried).torque.success
    assert loaded.figures.effort != figures_of(pepper, loaded.trajectory).effort


def test_bases_that_drive_are_timed_along_their_path():
    cart = pk.load_robot(
        TWO_JOINTS.format(effort=30), base="differential",
        wheels=Wheels(speed=0.6, acceleration=0.8, track=0.4, turning_radius=0.4),
    )  # fmt: skip
    driven = pk.plan(cart, cart.neutral(), cart.joint_vector({"BaseX": 2.0}), smooth=True, timeout=AMPLE)
    assert driven.success
    assert driven.trajectory is not None
    assert driven.optimized is None
    assert "goes where it points" in driven.message


def test_balance_is_kept_by_the_motion(pepper, pair):
    made = smoothed(pepper, pair[0], TABLE, PlanOptions(timeout=AMPLE, balance=0.005))
    assert made.trajectory.check(pepper, TABLE).balance.value > 0.004, made.message


def test_balance_over_a_base_that_moves_is_timed_along_the_path():
    pepper = pk.load_pepper(base="planar")
    plain = pk.plan(pepper, pepper.neutral(), pepper.joint_vector({"BaseX": 0.3, "HeadYaw": 0.4}))
    made = smoothed(pepper, plain, None, PlanOptions(timeout=AMPLE, balance=0.005))
    assert "balance over a base that moves is not optimized" in made.message
    assert made.trajectory.duration == pk.retime(pepper, plain, balance=0.005).duration


def test_tasks_stay_met(pepper):
    level = pk.ik.AxisAlignment("LArm_effector", (0, 0, 1), axis=(0, 0, 1), tolerance=np.radians(5))
    start = pk.ik.solve(
        pepper, [pk.ik.HandPosition("left", (0.28, 0.32, 0.85)), level], joints="left_arm"
    ).q  # fmt: skip
    goal = [pk.ik.HandPosition("left", (0.30, 0.15, 0.85))]
    made = pk.plan(pepper, start, goal, joints="left_arm", constraints=[level], smooth=True, timeout=AMPLE)
    assert made.success, made.message
    assert made.trajectory is not None, made.message
    times = np.linspace(0.0, made.trajectory.duration, 400)
    errors = [level.error(pepper, q) for q in made.trajectory(times).position]
    assert max(errors) <= level.tolerance * (1 + 1e-4)
    assert max(made.constraint_errors) <= level.tolerance * (1 + 1e-4)


def test_a_plan_that_cannot_be_timed_says_why():
    """An arm that lies down needs more than its joint has, which the search does not know."""
    robot = pk.load_robot(TWO_JOINTS.format(effort=30))
    plain = pk.plan(robot, [0.0, 0.0], [1.0, 0.5])
    weak = pk.load_robot(TWO_JOINTS.replace('effort="30"', 'effort="0.3"').format(effort=30))
    made = smoothed(weak, plain, None, PlanOptions(timeout=AMPLE))
    assert made.success
    assert made.trajectory is None
    assert "cannot be timed" in made.message
    assert "bend" in made.message


def test_plans_without_a_motion_are_returned_as_they_are(pepper):
    stand = pepper.posture("Stand")
    assert pk.plan(pepper, stand, stand, smooth=True).trajectory is None
    inside = pk.Scene().add_box("block", size=(0.4, 0.4, 2.0), position=(0.0, 0.0, 1.0))
    refused = pk.plan(pepper, stand, pepper.joint_vector({"HeadYaw": 0.5}), inside, smooth=True)
    assert not refused.success
    assert refused.trajectory is None


def test_soft_costs_are_refused(pepper):
    ends = pepper.neutral(), pepper.posture("Stand")
    with pytest.raises(InvalidValueError, match=r"smooth.*soft costs"):
        pk.plan(pepper, *ends, costs=[pk.ik.LookAt((1.0, 0.0, 1.0))], smooth=True)
