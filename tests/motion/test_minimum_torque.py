import dataclasses

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.motion import MinimumTorqueStatus, minimum_torque_trajectory
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.motion.optimization.wheel_term import WheelTerm
from pepper_kin.trajectory.balance import wheel_limits


@pytest.fixture(scope="module")
def ends():
    pepper = pk.load_pepper().with_requirements("limits")
    goal = pepper.joint_vector(
        {"LShoulderPitch": 0.2, "RShoulderPitch": 0.6, "HipPitch": -0.4, "KneePitch": 0.15, "HeadYaw": 0.7}
    )
    return pepper, pepper.posture("Stand"), goal


def test_swing_keeps_all_limits_and_joins_its_ends(ends):
    pepper, start, goal = ends
    found = minimum_torque_trajectory(pepper, start, goal, 1.5)
    assert found.status is MinimumTorqueStatus.SOLVED, found.message
    np.testing.assert_allclose(found.trajectory.start, start, atol=1e-9)
    np.testing.assert_allclose(found.trajectory.end, goal, atol=1e-9)
    certificate = found.trajectory.check(pepper)
    for part in ("position", "velocity", "acceleration", "torque"):
        assert getattr(certificate, part).success, getattr(certificate, part).sentence()
    assert "obstacles were not looked at" in found.report()


def test_swing_takes_less_effort_than_the_smoothest_motion(ends):
    pepper, start, goal = ends
    found = minimum_torque_trajectory(pepper, start, goal, 1.5)
    still = np.zeros((2, pepper.n))
    samples = pk.trajectory.Samples(pepper.joint_names, [0.0, 1.5], [start, goal], still, still)
    t = np.linspace(0, 1.5, 1501)

    def effort(motion):
        share = pk.dynamics.newton_euler(pepper, *motion(t)) / pepper.effort_limits
        return np.trapezoid((share**2).sum(axis=1), t)

    assert found.figures.effort == pytest.approx(effort(found.trajectory), rel=0.01)
    assert effort(found.trajectory) < 0.95 * effort(samples.to_trajectory())


def test_joints_whose_ends_are_alike_may_move(ends):
    """Bending the arms between takes load off the shoulders."""
    pepper, start, goal = ends
    found = minimum_torque_trajectory(pepper, start, goal, 1.5)
    alike = np.abs(goal - start) < 1e-12
    assert alike.any()
    between = found.trajectory(np.linspace(0, 1.5, 50)).position
    assert np.ptp(between[:, alike], axis=0).max() > 0.05


@pytest.fixture(scope="module")
def coarse_and_fine(ends):
    return [minimum_torque_trajectory(*ends, 1.5, intervals=n) for n in (10, 40)]


@pytest.mark.thorough
@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_finer_splines_approach_the_reference(ends, coarse_and_fine, solver):
    """With free accelerations at both ends the reference does better, by less and less for finer splines."""
    pepper, start, goal = ends
    coarse, fine = coarse_and_fine
    found = minimum_torque_trajectory(pepper, start, goal, 1.5, intervals=10, solver=solver)
    assert found.success, found.message
    assert found.figures.effort < fine.figures.effort < coarse.figures.effort
    assert fine.figures.effort < 1.25 * found.figures.effort


def test_too_short_is_infeasible(ends):
    found = minimum_torque_trajectory(*ends, 0.1)
    assert found.status is MinimumTorqueStatus.INFEASIBLE
    assert found.trajectory is None
    assert "No motion of 0.1 s within the limits" in found.report()


def test_misuse_is_named(ends):
    pepper, start, goal = ends
    with pytest.raises(InvalidValueError, match="solver: got 'snopt'"):
        minimum_torque_trajectory(pepper, start, goal, 1.0, solver="snopt")
    with pytest.raises(InvalidValueError, match="goal: got the start"):
        minimum_torque_trajectory(pepper, start, start, 1.0)
    with pytest.raises(LimitError, match="goal: HeadYaw"):
        minimum_torque_trajectory(pepper, start, start + 3 * (np.arange(15) == 3), 1.0)
    with pytest.raises(InvalidValueError, match=r"start: got shape \(2, 15\)"):
        minimum_torque_trajectory(pepper, np.stack([start, goal]), goal, 1.0)


@pytest.fixture(scope="module")
def on_wheels():
    """A robot on a planar base, and a drive with a turn."""
    pepper = pk.load_pepper(base="planar").with_requirements("limits")
    start = pepper.posture("Stand")
    goal = start.copy()
    goal[:3] = 0.6, 0.3, 1.0
    return pepper, start, goal


@pytest.mark.thorough
@pytest.mark.parametrize("duration", [2.5, 3.0, 5.0])
def test_wheels_keep_their_limits(on_wheels, duration):
    """Such a motion was called solved at wheel speeds of 9.6 rad/s, where 6.28 rad/s are allowed."""
    found = minimum_torque_trajectory(*on_wheels, duration)
    if found.success:
        certificate = found.trajectory.check(on_wheels[0], collisions=False, balance=None)
        assert certificate.success, certificate.report()
    assert found.success == (duration > 2.5), found.message


def test_an_optimized_drive_takes_the_time_that_was_asked_for(on_wheels):
    """It was searched without the wheels, and then slowed down for them."""
    pepper, start, goal = on_wheels
    duration = 1.1 * pk.retime(pepper, [start, goal]).duration
    found = pk.motion.optimize(pepper, [start, goal], duration=duration)
    assert found.success
    assert found.trajectory.duration == pytest.approx(duration, rel=1e-6)
    certificate = found.trajectory.check(pepper, collisions=False, balance=None)
    assert certificate.success, certificate.report()


@pytest.mark.thorough
def test_a_reference_that_overruns_the_wheels_is_not_solved(on_wheels):
    found = minimum_torque_trajectory(*on_wheels, 1.8, intervals=6, solver="ipopt")
    assert found.status is not MinimumTorqueStatus.SOLVED
    assert found.trajectory is None or "of wheel" in found.message


@pytest.mark.parametrize("lever", [0.0, 0.2])
def test_derivatives_of_wheels_are_those_of_finite_differences(on_wheels, lever):
    pepper = on_wheels[0]
    wheels = dataclasses.replace(wheel_limits(pepper), lever=lever)
    moving = Moving(pepper, np.array([0, 2, 5]), pepper.neutral())  # y stands still
    term = WheelTerm(moving, wheels, 0.99, 4)
    rng, h = np.random.default_rng(0), 1e-6
    states = rng.normal(size=(3, 4, 3))
    rows = term.rows(*states)
    for part, slopes in enumerate((rows.by_position, rows.by_velocity, rows.by_acceleration)):
        for j in range(3):
            step = np.zeros((3, 4, 3))
            step[part, :, j] = h
            expected = (term.values(*(states + step)) - term.values(*(states - step))) / (2 * h)
            np.testing.assert_allclose(slopes[:, :, j], expected, atol=1e-7)


TWO_LINKS = """<robot name="two"><link name="base"/>{links}
  <joint name="J" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" acceleration="10" effort="20"/></joint>
  <joint name="K" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 1 0"/><limit lower="{lower}" upper="2" velocity="{velocity}" acceleration="{acceleration}"
    effort="{effort}"/>
  </joint></robot>"""
LINK = """<link name="{}"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def two_links(**limits):
    """A robot of two joints, some limits of the second replaced."""
    all_limits = {"lower": -2, "velocity": 2, "acceleration": 10, "effort": 20} | limits
    return pk.load_robot(TWO_LINKS.format(links=LINK.format("a") + LINK.format("b"), **all_limits))


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("solver", ["newton", "ipopt", "fatrop"])
@pytest.mark.parametrize("limits", [{"velocity": 0}, {"acceleration": 0}, {"lower": 2}])
def test_a_joint_whose_limits_are_zero_may_rest(limits, solver):
    """No motion was found, in no steps and with warnings of NumPy's."""
    robot, rest = two_links(**limits), limits.get("lower", 0.5)
    found = minimum_torque_trajectory(robot, [0.0, rest], [1.0, rest], 2.0, solver=solver)
    assert found.success, found.message
    assert np.ptp(found.trajectory(np.linspace(0, 2, 50)).position[:, 1]) == 0.0


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "effort"])
def test_a_joint_that_cannot_move_is_named(quantity):
    found = minimum_torque_trajectory(two_links(**{quantity: 0}), [0.0, 0.0], [1.0, 0.5], 2.0)
    assert found.status is MinimumTorqueStatus.INFEASIBLE
    assert f"The {quantity} limit of K is 0" in found.report()
