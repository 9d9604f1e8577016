import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.trajectory.balance import edge_moments, support_polygon

TRIANGLE = np.array([(0.09, 0.155), (-0.17, 0.0), (0.09, -0.155)])


def inside_by(points):
    """Distance from points to the nearest edge of the triangle, by the lines' own equations."""
    distances = []
    for a, b in zip(TRIANGLE, np.roll(TRIANGLE, -1, axis=0), strict=True):
        normal = np.array([-(b - a)[1], (b - a)[0]]) / np.linalg.norm(b - a)
        distances.append((points - a) @ normal)
    return np.min(distances, axis=0)


def bows():
    """Paths that throw the trunk about: without the limit they tip the robot."""
    pepper = pk.load_pepper()
    stand = pepper.posture("Stand")
    yield np.array([stand, pepper.joint_vector({"HipPitch": -0.5})]), 0.02
    yield np.array([stand, pepper.joint_vector({"HipPitch": 0.3, "KneePitch": 0.2})]), 0.02
    yield np.array([pepper.joint_vector({"HipRoll": roll}) for roll in (-0.25, 0.25)]), 0.055


def test_polygon_is_where_the_wheels_stand():
    np.testing.assert_allclose(support_polygon(pk.load_pepper()), TRIANGLE, atol=1e-12)


@pytest.mark.parametrize(("path", "margin"), list(bows()), ids=["forward", "backward", "sideways"])
def test_zero_moment_point_stays_inside_at_every_millisecond(path, margin):
    pepper = pk.load_pepper()
    free = pk.retime(pepper, path)
    kept = pk.retime(pepper, path, balance=margin)
    margins = []
    for trajectory in (free, kept):
        samples = trajectory.sample(0.001)
        state = samples.position, samples.velocity, samples.acceleration
        margins.append(inside_by(pk.dynamics.zero_moment_point(pepper, *state)).min())
    assert margins[0] < margin
    assert margins[1] >= margin - 1e-6
    assert margins[1] < margin + 0.0015  # it binds: no time is given away
    assert kept.duration > free.duration


def test_moving_base_carries_its_triangle_along():
    pepper = pk.load_pepper("planar")
    start = pepper.posture("Stand")
    goal = start.copy()
    goal[:3] = 1.0, -0.5, 1.2
    trajectory = pk.retime(pepper, np.array([start, goal]), balance=0.03)
    samples = trajectory.sample(0.01)
    point = pk.dynamics.zero_moment_point(pepper, samples.position, samples.velocity, samples.acceleration)
    x, y, yaw = samples.position[:, :3].T
    offset = point - np.stack([x, y], axis=1)
    local = np.stack(
        [np.cos(yaw) * offset[:, 0] + np.sin(yaw) * offset[:, 1],
         -np.sin(yaw) * offset[:, 0] + np.cos(yaw) * offset[:, 1]], axis=1,
    )  # fmt: skip
    assert inside_by(local).min() >= 0.03 - 1e-6


def test_edge_moments_are_margin_times_vertical_force():
    pepper = pk.load_pepper()
    rng = np.random.default_rng(0)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (20, 15))
    v, a = rng.normal(size=(2, 20, 15))
    h = edge_moments(pepper, TRIANGLE, q, v, a).min(axis=1)
    force = pk.dynamics.base_wrench(pepper, q, v, a)[:, 2]
    expected = inside_by(pk.dynamics.zero_moment_point(pepper, q, v, a)) * force
    np.testing.assert_allclose(h, expected, atol=1e-9)


def test_a_posture_that_cannot_stand_is_named():
    pepper = pk.load_pepper()
    lean = pepper.joint_vector({"KneePitch": 0.5, "HipPitch": 0.5})
    assert inside_by(pk.dynamics.center_of_mass(pepper, lean)[:2]) < 0.05
    with pytest.raises(InfeasibleError, match="100% along the path the robot would tip over even at rest"):
        pk.retime(pepper, np.array([pepper.posture("Stand"), lean]), balance=0.06, torque=False)
    with pytest.raises(InvalidValueError, match="balance: got -1"):
        pk.retime(pepper, np.array([pepper.posture("Stand"), lean]), balance=-1)


def test_a_robot_without_wheels_has_no_balance():
    arm = pk.load_robot(
        """<robot name="a"><link name="w"/><link name="l"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="w"/><child link="l"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="9" velocity="1"/></joint></robot>"""
    )
    with pytest.raises(
        InvalidValueError, match=r"balance: got 0.01, expected None for a robot without Wheel"
    ):
        pk.retime(arm, np.array([[0.0], [1.0]]), balance=0.01)
