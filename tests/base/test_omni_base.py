"""Wheels, ramps and odometry against rigid-body kinematics and published numbers."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, ModelError, UnknownNameError
from pepper_kin.twin.base import (
    BaseController,
    BaseGeometry,
    Odometry,
    OmniBase,
    arc_between,
    arc_moved,
    pepper_base,
    world_velocity,
)

RNG = np.random.default_rng(0)
PUBLISHED = [[12.56673, -6.79404, -2.55931], [-12.56673, -6.79404, -2.55931], [-4.0e-05, 14.28571, -2.42857]]


@pytest.fixture(scope="module")
def base():
    return OmniBase(pk.load_pepper())


def test_the_map_is_the_published_one(base):
    np.testing.assert_allclose(base.wheel_map, PUBLISHED, atol=1e-4)
    assert np.linalg.cond(base.wheel_map[:, :2]) < 2


@pytest.mark.parametrize("twist", [(1, 0, 0), (0, 1, 0), (0, 0, 1), *RNG.normal(size=(6, 3)).tolist()])
def test_rolling_without_slip_in_any_direction(base, twist):
    """The material point of each wheel at the floor moves along the axle only, in three dimensions."""
    vx, vy, turning = twist
    speeds, geometry = base.wheel_speeds(twist), base.geometry
    for contact, axle, speed in zip(geometry.contacts, geometry.axles, speeds, strict=True):
        center = np.array([vx, vy, 0]) + np.cross([0, 0, turning], [*contact, geometry.wheel_radius])
        spin = speed * np.array([*axle, 0])
        slide = center + np.cross(spin, [0, 0, -geometry.wheel_radius])
        rolling = np.cross([*axle, 0], [0, 0, 1])
        assert abs(slide @ rolling) < 1e-12
        assert abs(slide[2]) < 1e-15
    np.testing.assert_allclose(base.wheel_slip(twist, speeds), 0, atol=1e-12)
    np.testing.assert_allclose(base.wheel_slip(twist, speeds + 1.0), -geometry.wheel_radius)
    np.testing.assert_allclose(base.body_twist(speeds), twist, atol=1e-12)


def test_wheels_agree_with_the_moving_robot():
    """The frames of the planar robot's wheels move as the map says, at any place and yaw."""
    pepper = pk.load_pepper(base="planar")
    base = OmniBase(pepper)
    q, v = pepper.joint_vector({"BaseX": 1.0, "BaseY": -2.0, "BaseYaw": 0.8}), np.zeros(pepper.n)
    twist = np.array([0.3, -0.2, 0.9])
    v[:3] = world_velocity(twist, 0.8)
    for row, name in enumerate(base.geometry.wheel_names):
        velocity = pk.kinematics.frame_velocity(pepper, q, v, f"{name}_link")[:3]
        turn = pk.kinematics.frame_pose(pepper, q, "base_footprint")[:3, :3]
        axle = turn @ [*base.geometry.axles[row], 0]
        rolling = np.cross(axle, [0, 0, 1])
        assert base.wheel_speeds(twist)[row] * 0.07 == pytest.approx(velocity @ rolling, abs=1e-5)


def test_four_wheels_are_fitted_by_least_squares():
    angles = np.deg2rad([45, 135, 225, 315])
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    base = OmniBase(BaseGeometry(("a", "b", "c", "d"), 0.2 * ring, ring, 0.05))
    twist = np.array([0.2, -0.1, 0.4])
    speeds = base.wheel_speeds(twist)
    np.testing.assert_allclose(base.body_twist(speeds), twist, atol=1e-12)
    wrong = speeds + np.array([0.1, -0.2, 0.3, 0.05])
    best = np.linalg.lstsq(base.wheel_map, wrong, rcond=None)[0]
    np.testing.assert_allclose(base.body_twist(wrong), best, atol=1e-12)
    assert np.abs(base.wheel_slip(best, wrong)).max() > 0.001


def test_limits_scale_the_whole_twist(base):
    assert base.limited((0.1, 0.0, 0.2)) == pytest.approx((0.1, 0.0, 0.2))
    np.testing.assert_allclose(base.limited((1.0, 0.0, 0.0)), (0.35, 0, 0))
    np.testing.assert_allclose(base.limited((0.1, 0, 5.0)), (0.02, 0, 1.0))
    fast = OmniBase(pepper_base(fastest=True))
    twists = RNG.normal(size=(200, 3)) * 3
    limited = fast.limited(twists)
    assert np.abs(fast.wheel_speeds(limited)).max() <= 6.28319 + 1e-9
    assert np.hypot(limited[:, 0], limited[:, 1]).max() <= 0.55 + 1e-12
    assert np.abs(np.cross(limited, twists)).max() < 1e-9
    # The wheels allow 0.44 m/s in every direction, by the published figures, and no more in the worst one.
    around = np.linspace(0, 2 * np.pi, 721)
    way = np.column_stack([np.cos(around), np.sin(around), 0 * around])
    assert np.linalg.norm(fast.limited(way), axis=1).min() == pytest.approx(0.440, abs=1e-3)


def test_arcs_are_the_integral_of_their_twist():
    start, arc = np.array([1.0, -0.5, 0.7]), np.array([0.8, -0.3, 2.1])
    pose, steps = start.copy(), 20000
    for k in range(steps):  # midpoint rule
        yaw = start[2] + arc[2] * (k + 0.5) / steps
        pose += (
            np.array(
                [
                    np.cos(yaw) * arc[0] - np.sin(yaw) * arc[1],
                    np.sin(yaw) * arc[0] + np.cos(yaw) * arc[1],
                    arc[2],
                ]
            )
            / steps
        )
    np.testing.assert_allclose(arc_moved(start, arc), pose, atol=1e-8)
    circle = arc_moved([0, 0, 0], [np.pi, 0, 2 * np.pi])  # radius 1/2
    np.testing.assert_allclose(circle, [0, 0, 2 * np.pi], atol=1e-12)
    np.testing.assert_allclose(arc_moved([0, 0, 0], [np.pi / 4, 0, np.pi / 2])[:2], [0.5, 0.5], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 0.99e-4, 1.01e-4, 0.3, 3.0, 6.0])
def test_an_arc_is_found_again(angle):
    arcs = np.column_stack([RNG.normal(size=(20, 2)), np.repeat([angle, -angle], 10)])
    starts = RNG.normal(size=(20, 3))
    np.testing.assert_allclose(arc_between(starts, arc_moved(starts, arcs)), arcs, atol=1e-10)
    with pytest.raises(InvalidValueError, match="full turn"):
        arc_between([0, 0, 0], [0, 0, 6.4])


def test_ramps_keep_both_accelerations_and_arrive(base):
    controller, limits = BaseController(base, command_timeout=10.0), base.geometry
    controller.command((0.3, -0.1, 0.8))
    twists = [controller.twist]
    for _ in range(300):
        twists.append(controller.step(0.01))
    change = np.diff(twists, axis=0) / 0.01
    assert np.hypot(change[:, 0], change[:, 1]).max() <= limits.linear_acceleration + 1e-9
    assert np.abs(change[:, 2]).max() <= limits.angular_acceleration + 1e-9
    wanted = base.limited((0.3, -0.1, 0.8))
    np.testing.assert_allclose(twists[-1], wanted, atol=1e-12)
    # As fast as the tighter limit allows, in a straight line of twists.
    needed = max(np.hypot(*wanted[:2]) / limits.linear_acceleration, wanted[2] / limits.angular_acceleration)
    arrived = np.argmax(np.linalg.norm(twists - wanted, axis=1) < 1e-12) * 0.01
    assert needed <= arrived + 1e-9 <= needed + 0.02
    assert np.abs(np.cross(twists, wanted)).max() < 1e-12


def test_every_twist_on_the_way_is_within_the_limits():
    base = OmniBase(pepper_base(fastest=True))
    controller, rng = BaseController(base, command_timeout=1.0), np.random.default_rng(3)
    for _ in range(60):
        controller.command(rng.normal(size=3) * (1, 1, 3))
        for _ in range(rng.integers(1, 40)):
            twist = controller.step(0.02)
            np.testing.assert_allclose(base.limited(twist), twist, atol=1e-12)
            assert np.abs(controller.wheel_speeds).max() <= 6.28319 + 1e-9


def test_it_stops_when_commands_cease_after_the_braking_distance(base):
    controller = BaseController(base, command_timeout=0.5)
    controller.command((0.3, 0.0, 0.0))
    twists = [controller.step(0.001) for _ in range(1600)]
    assert np.argmax(twists, axis=0)[0] * 0.001 == pytest.approx(0.5, abs=0.002)
    np.testing.assert_array_equal(twists[-1], 0)
    # From rest: v^2 / (2 a) up and down again.
    top = twists[499][0]
    assert top == pytest.approx(0.15)
    assert controller.pose[0] == pytest.approx(top**2 / 0.3, rel=1e-3)

    controller.reset()
    controller.command((0.2, 0.1, 0.4))
    for _ in range(490):
        controller.step(0.001)
    distance, before = controller.braking_distance(), controller.pose
    controller.command((0, 0, 0))
    way = 0.0
    for _ in range(3000):
        step = controller.pose
        controller.step(0.001)
        way += np.hypot(*(controller.pose - step)[:2])
    assert way == pytest.approx(distance, rel=1e-3)
    assert not np.array_equal(before, controller.pose)


def test_odometry_from_true_turns_is_exact_and_from_wrong_ones_as_wrong_as_asked(base):
    rng = np.random.default_rng(5)
    arcs = rng.normal(size=(100, 3)) * (0.05, 0.05, 0.2)
    pose, exact, wide = (
        np.array([0.2, 0.1, -1.0]),
        Odometry(base, (0.2, 0.1, -1.0)),
        Odometry(base, (0.2, 0.1, -1.0), radius_error=0.01),
    )
    for arc in arcs:
        pose = arc_moved(pose, arc)
        exact.add(base.wheel_speeds(arc))
        wide.add(base.wheel_speeds(arc))
    np.testing.assert_allclose(exact.pose, pose, atol=1e-12)
    assert wide.pose[2] + 1.0 == pytest.approx(1.01 * (pose[2] + 1.0))

    ends = []
    for seed in range(300):
        slipping = Odometry(base, wheel_slip=0.02, seed=seed)
        for _ in range(20):
            slipping.add(base.wheel_speeds((0.05, 0, 0)))
        ends.append(slipping.pose)
    turn = np.abs(base.wheel_speeds((1.0, 0, 0)))  # in all one meter
    spread = np.linalg.inv(base.wheel_map) @ np.diag(0.02**2 * turn) @ np.linalg.inv(base.wheel_map).T
    assert np.std(ends, axis=0)[0] == pytest.approx(np.sqrt(spread[0, 0]), rel=0.15)
    assert np.std(ends, axis=0)[2] == pytest.approx(np.sqrt(spread[2, 2]), rel=0.15)
    again = Odometry(base, wheel_slip=0.02, seed=299)
    for _ in range(20):
        again.add(base.wheel_speeds((0.05, 0, 0)))
    np.testing.assert_array_equal(again.pose, ends[-1])


def test_rows_of_many_bases_are_those_of_single_ones(base):
    rng, count = np.random.default_rng(3), 6
    many, single = BaseController(base, count=count), [BaseController(base) for _ in range(count)]
    errors = rng.normal(0.0, 0.01, (count, 3))
    odometry = Odometry(base, np.zeros((count, 3)), radius_error=errors)
    believed = [Odometry(base, radius_error=error) for error in errors]
    for step in range(200):
        if step % 20 == 0:
            twists = rng.uniform(-1.0, 1.0, (count, 3))
            many.command(twists)
            for each, twist in zip(single, twists, strict=True):
                each.command(twist)
        if step == 100:
            many.reset((1.0, 2.0, 0.5), rows=[2, 4])
            for row in (2, 4):
                single[row].reset((1.0, 2.0, 0.5))
        many.step(0.02)
        odometry.add(0.02 * many.wheel_speeds)
        for each, own in zip(single, believed, strict=True):
            each.step(0.02)
            own.add(0.02 * each.wheel_speeds)
        np.testing.assert_allclose(many.pose, [each.pose for each in single], atol=1e-12)
        np.testing.assert_allclose(many.twist, [each.twist for each in single], atol=1e-12)
        np.testing.assert_allclose(odometry.pose, [each.pose for each in believed], atol=1e-12)
    np.testing.assert_allclose(
        many.braking_distance(), [each.braking_distance() for each in single], atol=1e-12
    )
    assert not many.stands
    assert np.abs(many.pose).max() > 0.3
    for rows in ([count], [0, 0], np.ones(count - 1, bool)):
        with pytest.raises(InvalidValueError, match="rows"):
            many.reset(rows=rows)
    with pytest.raises(InvalidValueError, match="pose"):
        many.reset(np.zeros((3, 3)), rows=[0, 1])


def test_misuse_is_named(base):
    with pytest.raises(InvalidValueError, match="twist"):
        base.wheel_speeds((1, np.nan, 0))
    with pytest.raises(InvalidValueError, match="wheel_speeds"):
        base.body_twist((1, 2))
    with pytest.raises(InvalidValueError, match="timestep"):
        BaseController(base).step(0.0)
    with pytest.raises(InvalidValueError, match="timeout"):
        BaseController(base, command_timeout=-1.0)
    with pytest.raises(InvalidValueError, match="wheel_slip"):
        Odometry(base, wheel_slip=np.nan)
    with pytest.raises(InvalidValueError, match="wheels"):
        BaseGeometry(("a", "b"), np.zeros((2, 2)), np.ones((2, 2)), 0.1)
    with pytest.raises(InvalidValueError, match="linear_velocity"):
        BaseGeometry(("a", "b", "c"), np.zeros((3, 2)), np.ones((3, 2)), 0.1, linear_velocity=0.0)
    parallel = BaseGeometry(("a", "b", "c"), [[0, 0], [1, 0], [2, 0]], [[1, 0]] * 3, 0.1)
    with pytest.raises(ModelError, match="undetermined"):
        OmniBase(parallel)
    with pytest.raises(InvalidValueError, match="base"):
        OmniBase("pepper")
    urdf = """<robot name="arm"><link name="a"/><link name="b"/><joint name="j" type="continuous">
        <parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""
    with pytest.raises(UnknownNameError, match="WheelFL_link"):
        OmniBase(pk.load_robot(urdf))
    with pytest.raises(InvalidValueError, match="yaw"):
        world_velocity((0, 0, 0), np.nan)
