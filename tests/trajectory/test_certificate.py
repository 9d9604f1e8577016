"""The independent examination of trajectories finds what is wrong with them."""

import json

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.trajectory import Trajectory, check
from pepper_kin.trajectory.balance import balance_margin, support_polygon


def changed(trajectory, coefficients):
    return Trajectory(trajectory.joint_names, trajectory.breaks, coefficients, trajectory.joint_units)


def test_retimed_trajectory_passes(pepper, trajectory):
    found = trajectory.check(pepper, collisions=False)
    assert found.success, found.report()
    assert found.failures == ()
    assert "passes every check" in found.report()
    assert "clearance: not examined" in found.report()
    assert max(found.velocity.use.max(), found.acceleration.use.max(), found.torque.use.max()) > 0.999
    assert json.loads(json.dumps(found.as_dict()))["torque"]["joints"]["KneePitch"]["unit"] == "N m"


def test_margins_agree_with_samples(pepper, trajectory):
    found = check(pepper, trajectory, collisions=False)
    at = trajectory.sample(0.001)
    j = pepper.joint_index("LShoulderPitch")
    assert found.velocity.margin[j] == pytest.approx(
        pepper.velocity_limits[j] - np.abs(at.velocity[:, j]).max(), abs=0.03
    )
    torque = pk.dynamics.inverse_dynamics(pepper, *trajectory(found.torque.time[0]))
    assert found.torque.value[0] == pytest.approx(torque[0], abs=0.5)  # either side of a knot
    zmp = pk.dynamics.zero_moment_point(pepper, at.position, at.velocity, at.acceleration)
    assert np.all(zmp[:, 0] < 0.09)
    assert found.balance.value <= (0.09 - zmp[:, 0]).min() + 1e-9


@pytest.mark.parametrize(
    ("factor", "failures"), [(0.7, ("velocity", "acceleration")), (0.97, ("acceleration",)), (1.0, ())]
)
def test_a_faster_one_fails(pepper, factor, failures):
    q = pepper.posture("Stand")
    goal = q - 2.0 * (np.arange(pepper.n) == pepper.joint_index("LShoulderPitch"))
    assert pk.retime(pepper, [q, goal]).scaled(factor).check(pepper, collisions=False).failures == failures


@pytest.mark.parametrize(
    ("quantity", "option"),
    [("velocity", "velocity_scale"), ("acceleration", "acceleration_scale"), ("torque", "torque_scale")],
)
def test_shares_of_limits_are_what_a_motion_is_held_against(pepper, quantity, option):
    q = pepper.posture("Stand")
    goal = pepper.joint_vector({"LShoulderPitch": 0.2, "LElbowRoll": -0.2})
    motion = pk.retime(pepper, [q, goal], torque_scale=1.0 if quantity != "torque" else 0.55)
    whole = getattr(check(pepper, motion, collisions=False), quantity)
    used = np.max(np.abs(whole.value) / whole.upper)
    for share, kept in ((min(1.0, used * 1.001), True), (used * 0.999, False)):
        found = check(pepper, motion, collisions=False, **{option: share})
        assert getattr(found, quantity).success == kept
        np.testing.assert_allclose(getattr(found, quantity).upper, share * whole.upper)
        assert kept or found.failures == (quantity,)


@pytest.mark.thorough
def test_a_motion_timed_at_shares_passes_at_these_shares(pepper):
    shares = {"velocity_scale": 0.5, "acceleration_scale": 0.4, "torque_scale": 0.8}
    q = pepper.posture("Stand")
    motion = pk.retime(pepper, [q, pepper.joint_vector({"LShoulderPitch": 0.0, "HeadYaw": 1.0})], **shares)
    assert motion.check(pepper, **shares).success
    assert motion.check(pepper, velocity_scale=0.3).failures == ("velocity",)
    with pytest.raises(InvalidValueError, match="velocity_scale"):
        motion.check(pepper, velocity_scale=1.5)
    driving = pk.load_pepper(base="planar")
    ends = np.array([driving.posture("Stand")] * 2)
    ends[1, :3] = [1.5, 0.3, 0.5]
    drive = pk.retime(driving, ends, **shares)
    assert drive.check(driving, **shares).success
    assert "base_speed" in drive.check(driving, velocity_scale=0.4).failures


def test_a_violation_is_named_with_joint_and_time(pepper, trajectory):
    coefficients = np.array(trajectory.coefficients)
    coefficients[:, 0, pepper.joint_index("HeadPitch")] += 1.0
    found = changed(trajectory, coefficients).check(pepper, collisions=False)
    assert found.failures == ("position",)
    assert found.position.joint_names[found.position.worst] == "HeadPitch"
    assert "position: HeadPitch reaches" in found.report()
    assert " rad OUTSIDE [-0.7069, 0.637]" in found.report()
    assert found.report().startswith("Trajectory of")
    assert "fails: position." in found.report()


def test_jumps_are_found(pepper, trajectory):
    half = trajectory.breaks.size // 2
    coefficients = np.array(trajectory.coefficients)
    coefficients[half:, 0, 3] += 0.01
    found = changed(trajectory, coefficients).check(pepper, collisions=False)
    assert found.failures == ("position_continuity",)
    assert found.position_continuity.value == pytest.approx(0.01)
    assert found.position_continuity.time == trajectory.breaks[half]
    assert "(HeadYaw)" in found.position_continuity.sentence()
    coefficients = np.array(trajectory.coefficients)
    coefficients[-1, 1, 4] += 0.02
    assert "velocity_continuity" in changed(trajectory, coefficients).check(pepper, collisions=False).failures


def test_torque_is_examined_where_retiming_left_it_out(pepper):
    q = pepper.posture("Stand")
    bent = pepper.joint_vector({"KneePitch": -0.5, "HipPitch": -1.03})
    found = pk.retime(pepper, [q, bent], torque=False).check(pepper, collisions=False)
    assert "torque" in found.failures
    assert found.torque.joint_names[found.torque.worst] == "KneePitch"


def test_support_polygon_is_the_published_triangle(pepper):
    np.testing.assert_allclose(
        support_polygon(pepper), [[0.09, 0.155], [-0.17, 0], [0.09, -0.155]], atol=1e-9
    )
    robot = pk.load_pepper(base="planar")
    np.testing.assert_allclose(support_polygon(robot), support_polygon(pepper), atol=1e-9)


def test_balance_follows_a_moved_base(pepper):
    robot = pk.load_pepper(base="planar")
    q = pepper.posture("Stand")
    still = np.zeros((1, pepper.n))
    here = balance_margin(pepper, support_polygon(pepper), q[None], still, still)
    moved = np.concatenate([[3.0, -2.0, 1.1], q])[None]
    there = balance_margin(robot, support_polygon(robot), moved, 0 * moved, 0 * moved)
    np.testing.assert_allclose(there, here, atol=1e-9)
    com = pk.dynamics.center_of_mass(pepper, q)[:2]
    edges = [0.09 - com[0]]
    direction = np.array([0.26, 0.155]) / np.hypot(0.26, 0.155)
    for side in (1, -1):
        offset = com - [-0.17, 0.0]
        edges.append(abs(offset[0] * direction[1] * side - offset[1] * direction[0]))
    np.testing.assert_allclose(here, min(edges), atol=1e-9)


def test_tipping_is_found(pepper):
    lean = pepper.joint_vector({"KneePitch": 0.5, "HipPitch": 0.2})  # far backward
    found = pk.retime(pepper, [lean, lean + 0.01], torque=False).check(pepper, collisions=False)
    assert "balance" in found.failures
    assert "VIOLATED" in found.balance.sentence()


def test_clearance_in_a_scene(pepper, trajectory):
    free = trajectory.check(pepper, pk.Scene())
    assert free.self_clearance.value > 0
    assert free.obstacle_clearance is None
    assert "obstacle clearance: not examined" in free.report()
    hand = pk.kinematics.frame_pose(pepper, trajectory(0.5 * trajectory.duration).position, "l_wrist")[:3, 3]
    blocked = trajectory.check(pepper, pk.Scene().add_sphere("ball", radius=0.01, position=hand))
    assert blocked.failures == ("obstacle_clearance",)
    assert "ball" in blocked.obstacle_clearance.sentence()
    assert blocked.self_clearance.value == free.self_clearance.value
    assert free.clearance is free.self_clearance
    assert blocked.clearance is blocked.obstacle_clearance


def test_other_robots_have_no_wheels_to_stand_on(pepper, trajectory):
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="J" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
    </robot>"""
    robot = pk.load_robot(text)
    found = Trajectory(("J",), [0, 1], [[[0.0], [1.0]]]).check(robot, collisions=False)
    assert found.success
    assert found.balance is None
    assert "velocity: no joint has a limit" in found.report()
    with pytest.raises(InvalidValueError, match=r"joints of the trajectory: got KneePitch, .* expected J"):
        trajectory.check(robot, collisions=False)


@pytest.mark.parametrize("seed", range(3))
def test_clearance_is_that_of_every_millisecond(pepper, seed):
    """Measured one millisecond after the other, with the verdicts of `in_collision`."""
    rng = np.random.default_rng(seed)
    q = pepper.posture("Stand")
    goal = np.clip(q + 0.3 * rng.normal(size=pepper.n), pepper.lower_limits, pepper.upper_limits)
    motion = pk.retime(pepper, [q, goal], torque=False)
    scene = pk.Scene().add_sphere("ball", radius=0.05, position=(0.35, 0.2, 0.8))
    certificate = motion.check(pepper, scene)
    checks = {"self": certificate.self_clearance, "obstacles": certificate.obstacle_clearance}
    at = motion.sample(0.001)
    touching = pk.collision.in_collision(pepper, at.position, scene)
    for to, found in checks.items():
        distance = pk.collision.clearance(pepper, at.position, scene, to=to)
        here = int(np.argmin(np.abs(at.time - found.time)))
        assert distance[here] == pytest.approx(distance.min(), abs=2e-6)
        assert found.value == pytest.approx(distance.min(), abs=2e-6)
    assert all(found.success for found in checks.values()) == (not touching.any())


def test_neighbors_that_touch_fail_without_a_distance(pepper):
    names = ("HipPitch", "HipRoll", "HeadYaw", "HeadPitch")
    rng = np.random.default_rng(0)
    q = np.repeat(pepper.posture("Stand")[None], 400, axis=0)
    for name in names:
        j = pepper.joint_index(name)
        q[:, j] = rng.uniform(pepper.lower_limits[j], pepper.upper_limits[j], len(q))
    hit = pk.collision.in_collision(pepper, q) & (pk.collision.clearance(pepper, q) > 0)
    assert hit.any()
    motion = pk.retime(pepper, [pepper.posture("Stand"), q[np.argmax(hit)]], torque=False)
    found = motion.check(pepper, pk.Scene()).self_clearance
    assert not found.success
    assert found.value == -1e-9
    assert "two neighboring links touch, by their joint ranges" in found.sentence()
    at = motion.sample(0.001)
    assert found.time == at.time[np.argmax(pk.collision.in_collision(pepper, at.position))]


def test_the_check_shares_no_code_with_the_core(pepper, monkeypatch):
    """It evaluates and judges a trajectory alike while nothing but its own machine code can be called."""
    from pepper_kin.kernels.compiled_function import CompiledFunction

    q = pepper.posture("Stand")
    trajectory = pk.retime(pepper, [q, 0.8 * q], jerk="brisk")
    before = trajectory.check(pepper, jerk="brisk", hand_speed={"left": 1.0}, collisions=False)

    call = CompiledFunction.__call__

    def refuse(self, *arguments):
        own = self.__module__.startswith("pepper_kin.core.certificates")
        assert own or not self.__module__.startswith("pepper_kin.core"), self
        return call(self, *arguments) if own else None

    monkeypatch.setattr(CompiledFunction, "__call__", refuse)
    after = trajectory.check(pepper, jerk="brisk", hand_speed={"left": 1.0}, collisions=False)
    assert after.report() == before.report()


def test_a_robot_changed_by_hand_is_certified_as_it_is_now():
    """Torques were those of the description: a hand of 1.5 kg more passed that LWristYaw cannot hold."""
    robot = pk.load_robot(pk.load_pepper().urdf)
    out = robot.joint_vector({"LShoulderPitch": 0.3, "LElbowRoll": -0.5, "HipPitch": -0.1})
    plain = pk.retime(robot, [robot.neutral(), out])
    assert check(robot, plain, collisions=False).success
    model = robot.pinocchio_model
    model.inertias[model.getJointId("LWristYaw")].mass += 1.5
    robot = robot.with_pinocchio_model(model)
    found = check(robot, plain, collisions=False)
    assert "torque" in found.failures
    time = np.linspace(0.0, plain.duration, 2001)
    torque = np.abs(pk.dynamics.inverse_dynamics(robot, *plain(time))) - robot.effort_limits
    np.testing.assert_allclose(found.torque.margin.min(), -torque.max(), atol=2e-2)
