"""Machine code and interpreter make the same steps, for every robot and every kind of joint."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin import Twin, actuator_parameters


def wave(robot, steps, h, size=0.1, seed=0):
    """References that sweep part of every joint's range, and some that saturate."""
    rng = np.random.default_rng(seed)
    low, high = (np.clip(x, -1.0, 1.0) for x in (robot.lower_limits, robot.upper_limits))
    middle, amplitude = (low + high) / 2, size * (high - low) * rng.uniform(-1, 1, robot.n)
    t = h * np.arange(1, steps + 1)[:, np.newaxis]
    position = middle + amplitude * np.sin(9.0 * t)
    return middle, position, 9.0 * amplitude * np.cos(9.0 * t)


def both(robot, steps=150, size=0.1, h=1e-3, load=None, **settings):
    middle, position, velocity = wave(robot, steps, h, size)
    runs = []
    for compiled in (True, False):
        twin = Twin(robot, h, compiled=compiled, **settings)
        twin.reset(middle)
        runs.append(twin.follow(position, velocity, load=load))
    return runs


def agree(fast, slow):
    assert fast.success
    assert len(fast) == len(slow)
    np.testing.assert_allclose(fast.position, slow.position, atol=1e-9)
    np.testing.assert_allclose(fast.velocity, slow.velocity, atol=1e-8)
    np.testing.assert_allclose(fast.torque, slow.torque, atol=1e-6)
    assert np.ptp(fast.position, axis=0).max() > 1e-4


ROBOTS = {
    "pepper": {},
    "mimic": {"hands": "mimic"},
    "independent": {"hands": "independent"},
    "planar": {"base": "planar"},
}


@pytest.mark.parametrize("kind", ROBOTS)
@pytest.mark.parametrize("detail", ["servo", "motor"])
def test_robots_step_alike(kind, detail):
    robot = pk.load_pepper(**ROBOTS[kind])
    steps = 150 if kind == "pepper" else 50
    agree(*both(robot, steps, actuators=actuator_parameters(robot, detail)))


@pytest.mark.parametrize("feedforward", ["none", "gravity", "inverse_dynamics"])
@pytest.mark.parametrize("substeps", [1, 3])
def test_feedforwards_and_substeps_are_alike(feedforward, substeps):
    agree(*both(pk.load_pepper(), 60, feedforward=feedforward, substeps=substeps))


@pytest.mark.parametrize("h", [1e-4, 5e-3, 0.02])
def test_saturated_servos_and_stops_are_alike(h):
    """Far and fast references: every servo clips, joints run into their stops."""
    robot = pk.load_pepper()
    fast, slow = both(robot, 100, size=1.5, h=h)
    agree(fast, slow)
    assert (fast.peak_torque >= 0.999 * robot.effort_limits).sum() >= 5
    at_stop = (fast.position >= robot.upper_limits) | (fast.position <= robot.lower_limits)
    assert h < 1e-3 or at_stop.any(axis=0).sum() >= 3


@pytest.mark.parametrize("mode", ["velocity", "torque"])
def test_modes_with_friction_and_loads_are_alike(mode):
    robot = pk.load_pepper()
    load = 0.3 * np.random.default_rng(3).normal(size=(80, 15))
    weak = actuator_parameters(robot, "motor").changed(
        mode={"LElbowYaw": mode, "HeadYaw": mode}, strength=0.7
    )
    fast, slow = both(robot, 80, load=load, actuators=weak, feedforward="gravity")
    agree(fast, slow)


@pytest.mark.parametrize("seed", range(20))
def test_strong_friction_with_rough_loads_is_alike(seed):
    """Joints that stick, slip and turn round all the time, against torques of all sizes."""
    robot = pk.load_pepper()
    rng = np.random.default_rng(seed)
    params = actuator_parameters(robot, "motor").changed(coulomb_friction=10 ** rng.uniform(-2, 1, 15))
    load = 10 ** rng.uniform(-1, 1.5) * rng.normal(size=(25, 15))
    runs = []
    for compiled in (True, False):
        twin = Twin(robot, 2e-3, actuators=params, compiled=compiled)
        runs.append(twin.follow(np.tile(robot.posture("Stand"), (25, 1)), load=load))
    agree(*runs)


OTHER = """
<robot name="crane"><link name="world"/>
  <link name="a"><inertial><origin xyz="0 0 0.1"/><mass value="3"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
  <link name="b"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="Slide" type="prismatic"><parent link="world"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="100"/></joint>
  <joint name="Turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
</robot>"""


def test_another_robot_steps_alike():
    agree(*both(pk.load_robot(OTHER), 200, size=0.2))


def test_the_loop_is_fast_on_disk_and_silent_when_it_is_there(caplog):
    """A second twin of the same robot compiles nothing."""
    pepper = pk.load_pepper()
    Twin(pepper).step(pepper.posture("Stand"))
    from pepper_kin.twin.fast.loop import roll

    known = len(roll.signatures)
    caplog.clear()
    Twin(pepper, 0.002).step(pepper.posture("Stand"))
    assert len(roll.signatures) == known
    assert not caplog.records
