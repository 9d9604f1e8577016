"""Every step balances: independent dynamics against the actuator model as it is defined, for every kind of
joint."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin import RunStatus, Twin, actuator_parameters

CREEP = 1e-8


def wave(robot, steps, h, size=0.1, seed=0):
    """References that sweep part of every joint's range, and some that saturate."""
    rng = np.random.default_rng(seed)
    low, high = (np.clip(x, -1.0, 1.0) for x in (robot.lower_limits, robot.upper_limits))
    middle, amplitude = (low + high) / 2, size * (high - low) * rng.uniform(-1, 1, robot.n)
    t = h * np.arange(1, steps + 1)[:, np.newaxis]
    position = middle + amplitude * np.sin(9.0 * t)
    return middle, position, 9.0 * amplitude * np.cos(9.0 * t)


def followed(robot, steps=150, size=0.1, h=1e-3, load=None, **settings):
    middle, position, velocity = wave(robot, steps, h, size)
    twin = Twin(robot, h, **settings)
    twin.reset(middle)
    return twin, twin.follow(position, velocity, load=load)


def balance(twin, run, load=0.0):
    """Compare torques with the definition of the actuators, and their sum with Newton and Euler, in every
    step."""
    robot, p, h = twin.pepper, twin.actuators, twin.timestep
    q, v, w, after = run.position[:-1], run.velocity[:-1], run.velocity[1:], run.position[1:]
    np.testing.assert_allclose(after, q + h * w, atol=1e-12)
    with np.errstate(invalid="ignore", divide="ignore"):
        shown = np.where(
            p.encoder_resolution > 0,
            p.encoder_resolution * np.floor(q / p.encoder_resolution + 0.5),
            q,
        )
        line = np.where(np.isfinite(p.no_load_speed), p.stall_torque * w / p.no_load_speed, 0.0)
    modes = {mode: np.array([m == mode for m in p.mode]) for mode in ("position", "velocity", "torque")}
    forward = np.zeros_like(q)
    if twin.feedforward == "gravity":
        forward = np.array([pk.dynamics.gravity_torque(robot, row) for row in q])
    stiffness = np.where(modes["position"], p.stiffness, 0.0)
    damping = np.where(modes["torque"], 0.0, p.damping)
    wanted = stiffness * (run.reference_position[1:] - shown - h * w)
    wanted += damping * (run.reference_velocity[1:] - w) + np.where(modes["torque"], 0.0, forward)
    most = np.clip(p.stall_torque - line, -p.torque_limit, p.torque_limit)
    least = np.clip(-p.stall_torque - line, -p.torque_limit, p.torque_limit)
    torque = p.strength * np.clip(wanted, least, most)
    scale = 1.0 + np.abs(torque).max()
    np.testing.assert_allclose(run.torque[1:], torque, atol=1e-6 * scale)
    friction = p.viscous_friction * w + p.coulomb_friction * np.clip(w / CREEP, -1, 1)
    upper, lower = robot.upper_limits, robot.lower_limits
    with np.errstate(invalid="ignore"):
        push = np.maximum(p.stop_stiffness * (after - upper) + p.stop_damping * w * (q > upper), 0)
        push += np.minimum(p.stop_stiffness * (after - lower) + p.stop_damping * w * (q < lower), 0)
    total = torque - friction - push + load - p.rotor_inertia * (w - v) / h
    for k in range(len(q)):
        needed = pk.dynamics.newton_euler(robot, q[k], v[k], (w[k] - v[k]) / h)
        np.testing.assert_allclose(needed, total[k], atol=1e-6 * (scale + np.abs(total[k]).max()))
    assert run.status is not RunStatus.STOPPED
    assert np.ptp(run.position, axis=0).max() > 1e-4


ROBOTS = {
    "pepper": {},
    "mimic": {"hands": "mimic"},
    "independent": {"hands": "independent"},
    "planar": {"base": "planar"},
}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ROBOTS)
@pytest.mark.parametrize("detail", ["servo", "motor"])
def test_all_robots(kind, detail):
    robot = pk.load_pepper(**ROBOTS[kind])
    steps = 100 if kind == "pepper" else 30
    balance(*followed(robot, steps, actuators=actuator_parameters(robot, detail).changed(latency=0.0)))


@pytest.mark.parametrize("h", [1e-4, 5e-3, 0.02])
def test_saturated_servos_and_stops(h):
    """Far and fast references: every servo clips, joints run into their stops."""
    robot = pk.load_pepper()
    twin, run = followed(robot, 100, size=1.5, h=h)
    balance(twin, run)
    assert (run.peak_torque >= 0.999 * robot.effort_limits).sum() >= 5
    at_stop = (run.position >= robot.upper_limits) | (run.position <= robot.lower_limits)
    assert h < 1e-3 or at_stop.any(axis=0).sum() >= 3


@pytest.mark.parametrize("mode", ["velocity", "torque"])
def test_modes_with_friction_and_loads(mode):
    robot = pk.load_pepper()
    load = 0.3 * np.random.default_rng(3).normal(size=(80, 15))
    weak = actuator_parameters(robot, "motor").changed(
        mode={"LElbowYaw": mode, "HeadYaw": mode}, strength=0.7, latency=0.0
    )
    balance(*followed(robot, 80, load=load, actuators=weak), load)


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


def test_another_robot():
    balance(*followed(pk.load_robot(OTHER), 200, size=0.2))


@pytest.mark.parametrize("feedforward", ["none", "inverse_dynamics"])
def test_substeps_are_steps_on_references_in_between(feedforward):
    """Three substeps of 1 ms are three steps whose references move with their velocity."""
    robot, h = pk.load_pepper(), 1e-3
    middle, position, velocity = wave(robot, 20, 3 * h, size=0.001)
    coarse, fine = Twin(robot, 3 * h, substeps=3, feedforward=feedforward), Twin(robot, h, feedforward="none")
    for twin in (coarse, fine):
        twin.reset(middle)
    run = coarse.follow(position, velocity)
    forward = np.zeros_like(position)
    if feedforward == "inverse_dynamics":
        forward = pk.dynamics.inverse_dynamics(robot, position, velocity, 0 * position)
    for k in range(20):
        for i in (2, 1, 0):
            state = fine.step(position[k] - i * h * velocity[k], velocity[k], load=forward[k])
        # Feed-forward acts as a load as long as no servo is at its limit.
        np.testing.assert_allclose(state.position, run.position[k + 1], atol=1e-10)
