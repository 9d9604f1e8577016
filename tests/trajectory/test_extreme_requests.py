"""Whatever is asked of timing ends in a motion that is certified, or in an error of the library's."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, PepperKinError
from pepper_kin.trajectory.path import planned_curve


@pytest.fixture(scope="module")
def points(pepper):
    stand = pepper.posture("Stand")
    goal = stand.copy()
    goal[pepper.joint_index("HeadYaw")] += 0.5
    return [stand, goal]


@pytest.mark.parametrize("solver", ["fast", "toppra"])
@pytest.mark.parametrize("mass", [2.5, 1e3, 1e300])
def test_a_load_that_a_resting_joint_cannot_hold_is_named(pepper, points, mass, solver):
    """toppra divided by zero."""
    with pytest.raises(InfeasibleError, match=r"LWristYaw needs .* kg at LArm_effector"):
        pk.retime(pepper, points, payload={"left": mass}, solver=solver)


@pytest.mark.parametrize("solver", ["fast", "toppra"])
@pytest.mark.parametrize("scale", [1e-6, 1e-9, 1e-12])
def test_motions_of_hours_are_refused_with_the_scale_that_asks_for_them(pepper, points, scale, solver):
    """The machine code ran out of memory: a motion of 7e10 s was looked at every millisecond."""
    words = rf"velocity_scale={scale:.4g}.* takes .* s or more, and at most 3600 s"
    with pytest.raises(InfeasibleError, match=words):
        pk.retime(pepper, points, velocity_scale=scale, solver=solver)


def test_without_torque_a_motion_may_take_years(pepper, points):
    slow = pk.retime(pepper, points, velocity_scale=1e-10, torque=False)
    assert slow.duration > 1e8
    found = slow.check(pepper, collisions=False)
    assert found.success, found.report()
    assert found.samples < 1_000_000
    assert found.step > 100


OPTIONS = ("velocity_scale", "acceleration_scale", "torque_scale", "hand_speed", "jerk")


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("value", [1e-300, 1e-12, 1e-4])
def test_small_numbers_give_a_motion_or_an_error_of_the_library(pepper, points, option, value):
    try:
        found = pk.retime(pepper, points, **{option: value})
    except PepperKinError:
        return
    assert np.isfinite(found.duration)
    np.testing.assert_allclose(found.end, points[1], atol=1e-9)


def test_grids_without_end_are_refused(pepper, points):
    for gridpoints in [1, 0, -5, 10**9, 2.5, True]:
        with pytest.raises(InvalidValueError, match=r"gridpoints: got .*, expected an integer"):
            pk.retime(pepper, points, gridpoints=gridpoints)


def test_paths_that_lead_nowhere_are_refused_by_name(pepper, points):
    start, goal = points
    for path, words in (
        ([start], "1 waypoint"),
        ([start, start], "a start that equals the goal"),
        ([start, goal, goal], "rows 1 and 2 are equal"),
        (start, r"expected shape \(k, 15\)"),
    ):
        with pytest.raises(InvalidValueError, match=words):
            pk.retime(pepper, path)


@pytest.mark.parametrize("step", [1e-8, 1e-6, 1e-4])
def test_the_shortest_ways_are_certified(pepper, points, step):
    start = points[0]
    trajectory = pk.retime(pepper, [start, start + step])
    found = trajectory.check(pepper, collisions=False, balance=None)
    assert found.success, found.report()


def test_the_advice_of_a_plan_to_where_it_starts_is_not_to_time_it(pepper, points):
    plan = pk.plan(pepper, points[0], points[0])
    assert plan.success
    assert "retime" not in plan.advice
    with pytest.raises(InvalidValueError, match="a start that equals the goal"):
        pk.retime(pepper, plan)


def test_the_reason_of_any_result_that_failed_is_handed_on(pepper, points):
    box = pk.Scene().add_box("box", size=(2, 2, 2), position=(0, 0, 1))
    plan = pk.plan(pepper, *points, scene=box)
    with pytest.raises(InfeasibleError, match="planning failed: The start is in collision"):
        pk.retime(pepper, plan)
    with pytest.raises(InfeasibleError, match="planning failed"):
        planned_curve(plan)
    line = pk.motion.cartesian_path(pepper, points[0], "left", pk.motion.Line((5, 0, 0), relative=True))
    assert not line.success
    with pytest.raises(InfeasibleError, match="planning failed"):
        pk.retime(pepper, line)


def with_limit_of_zero(pepper, joint, quantity):
    """Return the robot of a description in which a limit of a joint is zero, as of idle joints in many."""
    root = ET.fromstring(pepper.urdf)
    next(j for j in root.iter("joint") if j.get("name") == joint).find("limit").set(quantity, "0")
    return pk.load_robot(ET.tostring(root, encoding="unicode"), pepper.export("srdf"))


@pytest.mark.thorough
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
@pytest.mark.parametrize("options", [{}, {"jerk": "moderate"}, {"solver": "toppra"}])
def test_a_joint_at_rest_may_have_a_limit_of_zero(pepper, points, quantity, options):
    """Timing with jerk ended in an error of SciPy's, what acts was NaN, toppra found no speed."""
    robot = with_limit_of_zero(pepper, "RWristYaw", quantity)
    motion = pk.retime(robot, points, **options)
    expected = pk.retime(pepper, points, **options)
    near = 2e-3 if "jerk" in options else 1e-6  # with limited jerk the search ends near the shortest duration
    assert motion.duration == pytest.approx(expected.duration, rel=near)
    found = motion.check(robot, jerk=options.get("jerk"), collisions=False)
    assert found.success, found.report()
    assert motion.active_limits(robot).share.max() == pytest.approx(
        expected.active_limits(pepper).share.max(), rel=near
    )
    assert np.isfinite(pk.trajectory.phase_plane(robot, motion).velocity_limit).all()
    enforced = pk.trajectory.enforce_limits(robot, motion.scaled(0.5))
    assert enforced.check(robot, collisions=False).success
    assert np.isfinite(pk.motion.optimize(robot, points).figures_before.jerk)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_a_joint_that_moves_against_a_limit_of_zero_is_named(pepper, points, quantity):
    robot, motion = with_limit_of_zero(pepper, "HeadYaw", quantity), pk.retime(pepper, points)
    for refused in (
        lambda: pk.retime(robot, points),
        lambda: pk.retime(robot, points, jerk="gentle"),
        lambda: pk.trajectory.enforce_limits(robot, motion),
    ):
        with pytest.raises(InfeasibleError, match=rf"HeadYaw moves .* its {quantity} limit is 0"):
            refused()


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("solver", ["fast", "toppra"])
@pytest.mark.parametrize("joint", ["RWristYaw", "HeadYaw"])
def test_a_joint_without_effort_is_named(pepper, points, joint, solver):
    """toppra divided by zero where the joint moves."""
    robot = with_limit_of_zero(pepper, joint, "effort")
    with pytest.raises(InfeasibleError, match=rf"{joint} needs .* its limit is 0 N m"):
        pk.retime(robot, points, solver=solver)
    assert pk.retime(robot, points, torque=False).active_limits(robot).share.max() == np.inf
