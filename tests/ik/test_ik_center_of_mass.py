"""The center of mass as a task, against a sum over the links and against the tipping margin."""

import math
import re

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.dynamics import WHEEL_CONTACTS, tip_over_margin
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ik.solvers import ALL_SOLVERS
from pepper_kin.twin.base import BalanceMonitor

PEPPER = pk.load_pepper()
FLOATING = pinocchio.buildModelFromXML(PEPPER.urdf, pinocchio.JointModelFreeFlyer())
ARM = """<robot name="arm"><link name="base"/><link name="link"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="9" velocity="1"/></joint></robot>"""
REACH = pk.ik.HandPosition("left", (-0.1, 0.4, 0.5))


def center(q):
    """Center of mass by Pinocchio of the robot put free into space, where no link is left out."""
    full = pinocchio.neutral(FLOATING)
    names = list(FLOATING.names)
    for name, value in zip(PEPPER.joint_names, q, strict=True):
        full[FLOATING.idx_qs[names.index(name)]] = value
    return pinocchio.centerOfMass(FLOATING, FLOATING.createData(), full)[:2]


def inside(q, contacts=WHEEL_CONTACTS, point=None):
    """Distance of the center of mass to the nearest line through two contacts, negative outside."""
    corners, point = np.array(contacts), center(q) if point is None else point
    distances = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        (ux, uy), (wx, wy) = b - a, point - a
        distances.append((ux * wy - uy * wx) / math.hypot(ux, uy))
    return min(distances)


def states(count, seed):
    return np.random.default_rng(seed).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (count, PEPPER.n))


def test_errors_are_those_of_plain_geometry():
    still = np.zeros(PEPPER.n)
    short = 0
    for q in states(30, 1):
        point = np.array([0.03, -0.02])
        assert pk.ik.CenterOfMass(point).error(PEPPER, q) == pytest.approx(math.dist(point, center(q)))
        error = pk.ik.CenterOfMassOverWheels(0.08).error(PEPPER, q)
        assert error == pytest.approx(max(0.0, 0.08 - inside(q)), abs=1e-12)
        assert error == pytest.approx(max(0.0, 0.08 - tip_over_margin(PEPPER, q, still, still)), abs=1e-9)
        short += error > 0
    assert 0 < short < 30


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_over_a_point(solver):
    point = (0.03, 0.02)
    result = pk.ik.solve(PEPPER, pk.ik.CenterOfMass(point), solver=solver, collisions=False)
    assert result.success, result.report()
    assert math.dist(center(result.q), point) <= 1e-3
    assert "center of mass: error " in result.report()
    assert "of the floor" in result.report()


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_a_reach_that_keeps_its_balance(solver):
    """Alone the reach leans out; with the margin asked for as well, both are met."""
    margin = 0.07
    alone = pk.ik.solve(PEPPER, REACH, solver=solver, collisions=False)
    assert alone.success
    assert inside(alone.q) < margin
    result = pk.ik.solve(
        PEPPER, [REACH, pk.ik.CenterOfMassOverWheels(margin)], solver=solver, collisions=False
    )
    assert result.success, result.report()
    assert inside(result.q) >= margin - 1e-3
    assert "margin of center of mass" in result.met
    assert " inside the wheels" in result.report()


def test_inside_it_asks_for_nothing():
    task = pk.ik.CenterOfMassOverWheels(0.02)
    q = PEPPER.neutral()
    assert inside(q) > 0.02
    assert task.error(PEPPER, q) == 0
    assert not task.jacobian(PEPPER, q).any()
    hand = pk.ik.HandPosition("left", (0.4, 0.2, 0.9))
    one, two = (
        pk.ik.solve(PEPPER, hand, collisions=False),
        pk.ik.solve(PEPPER, [hand, task], collisions=False),
    )
    np.testing.assert_allclose(
        two.q[PEPPER.joint_index("LElbowRoll")], one.q[PEPPER.joint_index("LElbowRoll")]
    )


def test_many_margins_and_points():
    margins = np.array([-0.01, 0.03, 0.05, 0.08])
    found = pk.ik.solve_batch(PEPPER, [REACH, pk.ik.CenterOfMassOverWheels(margins)], collisions=False)
    assert found.success.all()
    assert all(inside(q) >= m - 1e-3 for q, m in zip(found.q, margins, strict=True))
    points = np.array([(0.03, 0.0), (0.0, 0.02), (-0.03, 0.0)])
    found = pk.ik.solve_batch(PEPPER, pk.ik.CenterOfMass(points), solver="proxsuite", collisions=False)
    assert found.success.all()
    assert all(math.dist(center(q), p) <= 1e-3 for q, p in zip(found.q, points, strict=True))


def test_the_wheels_move_with_the_base():
    planar = pk.load_pepper(base="planar")
    task = pk.ik.CenterOfMassOverWheels(0.08)
    for q in states(5, 4):
        moved = np.concatenate([[2.0, -1.0, 2.5], q])
        assert task.error(planar, moved) == pytest.approx(task.error(PEPPER, q), abs=1e-12)
    far = pk.ik.HandPosition("left", (3.0, 1.0, 0.6))
    result = pk.ik.solve(planar, [far, pk.ik.CenterOfMassOverWheels(0.08)], collisions=False)
    assert result.success, result.report()
    assert tip_over_margin(planar, result.q, np.zeros(planar.n), np.zeros(planar.n)) >= 0.079


def test_what_is_lacking_is_said():
    result = pk.ik.solve(PEPPER, pk.ik.CenterOfMass((0.5, 0.0)), collisions=False)
    assert not result.success
    gap = math.dist(center(result.q), (0.5, 0.0))
    assert f"center of mass stops {100 * gap:.1f} cm short of (0.500, 0.000)" in result.report()
    leaning = pk.ik.solve(
        PEPPER,
        [pk.ik.HandPosition("left", (0.75, 0.1, 0.5), hard=True), pk.ik.CenterOfMassOverWheels(0.08)],
        collisions=False,
    )
    lack = 0.08 - inside(leaning.q)
    assert lack > 1e-3
    assert leaning.errors[1].value == pytest.approx(lack)
    assert "of a margin of 8.0 cm" in leaning.report()


def test_contacts_are_those_of_the_robots_own_wheels():
    """Wheels that stand twice as far out: all margins are those of lines through these places."""
    wheels = r'(<origin rpy="[^"]*" xyz=")(0.09|-0.17) (0.155|-0.155|0.0|0)( -0.264"/>)'
    text, count = re.subn(wheels, lambda m: f"{m[1]}{2 * float(m[2])} {2 * float(m[3])}{m[4]}", PEPPER.urdf)
    assert count == 3
    wide, corners = pk.load_robot(text), 2 * np.array(WHEEL_CONTACTS)
    q, still = PEPPER.posture("Stand"), np.zeros(PEPPER.n)
    expected = inside(q, corners, pk.dynamics.center_of_mass(wide, q)[:2])
    assert expected > inside(q) + 0.05
    assert tip_over_margin(wide, q, still, still) == pytest.approx(expected, abs=1e-9)
    task = pk.ik.CenterOfMassOverWheels(0.175)
    assert 0 < task.error(wide, q) == pytest.approx(0.175 - expected, abs=1e-9)
    assert task.on(wide).structure().corners == tuple(corners.ravel())
    report = BalanceMonitor(wide).assess([0.0, 0.1], [q, q], [still, still], [still, still])
    np.testing.assert_allclose(report.margin, expected, atol=1e-9)


def test_a_robot_without_wheels_is_refused_by_their_names():
    arm = pk.load_robot(ARM)
    words = "robot 'arm', which has no links WheelFL_link"
    with pytest.raises(InvalidValueError, match=f"contacts: got None, .*{words}"):
        tip_over_margin(arm, [0.0], [0.0], [0.0])
    with pytest.raises(InvalidValueError, match=f"contacts of center of mass: .*{words}"):
        pk.ik.solve(arm, pk.ik.CenterOfMassOverWheels(base_frame="base"))
    with pytest.raises(InvalidValueError, match=f"geometry: .*{words}"):
        BalanceMonitor(arm, base_frame="base")


def test_an_unknown_base_is_refused():
    with pytest.raises(UnknownNameError, match="unknown frame 'feet'"):
        pk.ik.solve(PEPPER, pk.ik.CenterOfMassOverWheels(base_frame="feet"), collisions=False)
