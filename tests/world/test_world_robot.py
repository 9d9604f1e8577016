"""Contacts of the robot with a world: leaning, pushing, blocking, and lifting an object in its grip."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision import Scene
from pepper_kin.twin import Twin
from pepper_kin.twin.world import World

H = 0.002


def joint_loads(pepper, q, contacts):
    """J^T of the forces on the robot, by `pepper_kin.kinematics`; shape (n,)."""
    total = np.zeros(pepper.n)
    for contact in contacts:
        for name, sign in zip(contact.names, (1.0, -1.0), strict=True):
            if name in pepper.frame_names:
                jacobian = pk.kinematics.frame_jacobian(pepper, q, name)
                arm = contact.point - pk.kinematics.frame_pose(pepper, q, name)[:3, 3]
                force = sign * contact.force
                total += jacobian[:3].T @ force + jacobian[3:].T @ np.cross(arm, force)
    return total


def off_balance(pepper, state, contacts):
    """Torque that servos, gravity and contacts leave over at rest, shape (n,)."""
    rest = np.zeros(pepper.n)
    held = pk.dynamics.inverse_dynamics(pepper, state.position, rest, rest)
    return state.torque + joint_loads(pepper, state.position, contacts) - held


@pytest.mark.parametrize("hands", ["locked", "mimic"])
def test_links_are_where_pinocchio_has_them_and_as_fast(hands):
    pepper = pk.load_pepper(base="planar", hands=hands)
    world = World(pepper)
    rng = np.random.default_rng(5)
    q, v = pepper.neutral() + 0.1 * rng.normal(size=pepper.n), rng.normal(size=pepper.n)
    world.advance(q, v, np.eye(pepper.n), np.zeros(pepper.n), H)
    model, state = pepper.pinocchio_model, world.begin(H).at
    data = model.createData()
    pinocchio.forwardKinematics(model, data, pepper.to_full(q), pepper.rate_to_full(v))
    for joint in range(model.njoints):
        center, *axes = state.pose[joint].reshape(4, 3)
        assert np.abs(data.oMi[joint].rotation.T - axes).max() < 1e-14
        assert np.abs(data.oMi[joint].translation - center).max() < 1e-14
        velocity = pinocchio.getVelocity(model, data, joint, pinocchio.LOCAL_WORLD_ALIGNED)
        assert np.abs(velocity.linear - state.linear[joint]).max() < 1e-13
        assert np.abs(velocity.angular - state.angular[joint]).max() < 1e-13


def test_leaning_on_a_wall_the_wall_carries_what_the_torques_say():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand").copy()
    for side, sign in (("L", 1), ("R", -1)):
        q[pepper.joint_index(f"{side}ShoulderPitch")] = 0.3
        q[pepper.joint_index(f"{side}ShoulderRoll")] = 0.12 * sign
        q[pepper.joint_index(f"{side}ElbowRoll")] = -0.4 * sign
    hand = pk.kinematics.frame_pose(pepper, q, "l_wrist")[0, 3]
    scene = Scene().add_box("wall", (0.1, 2, 2), (hand + 0.145 + 0.05, 0, 1))
    assert 0 < pk.collision.clearance(pepper, q, scene) < 0.01
    twin = Twin(pepper, H, world=World(pepper, scene))
    twin.reset(q)
    lean = q.copy()
    lean[pepper.joint_index("HipPitch")] -= 0.03
    for k in range(600):
        state = twin.step(q + min(1.0, k / 200) * (lean - q))
    contacts = [c for c in twin.world.contacts if np.linalg.norm(c.force) > 1e-9]
    assert {contact.names for contact in contacts} == {("l_wrist", "wall")}
    assert np.abs(state.velocity).max() < 1e-4
    pushed = sum(contact.force for contact in contacts)
    assert -60.0 < pushed[0] < -5.0  # the wall pushes back
    for contact in contacts:
        assert contact.normal == pytest.approx([-1, 0, 0])
        assert contact.gap > -1e-5
    assert np.abs(off_balance(pepper, state, contacts)).max() < 1e-4
    without = np.abs(off_balance(pepper, state, []))
    assert without[pepper.joint_index("HipPitch")] > 5.0


def test_a_hand_pushes_a_box_along_a_table_against_its_friction():
    pepper = pk.load_pepper(base="planar")
    mass, mu, top, speed = 0.5, 0.4, 0.70, 0.1
    q = pepper.neutral().copy()
    goal = [pk.ik.HandPosition("left", (0.28, 0.18, top + 0.05))]
    q = pk.ik.solve(pepper, goal, start=q, scene=Scene(), joints="left_arm").q.copy()
    scene = Scene().add_box("table", (0.6, 1.2, 0.04), (0.65, 0, top - 0.02))
    world = World(pepper, scene, friction=mu)
    world.add_box("parcel", (0.12, 0.16, 0.14), mass, (0.46, 0.18, top + 0.07))
    twin = Twin(pepper, H, world=world)
    twin.reset(q)
    forward = np.zeros(pepper.n)
    forward[pepper.joint_index("BaseX")] = speed
    ratios, moved = [], []
    for k in range(600):
        twin.step(q + forward * H * (k + 1), forward)
        parcel = world.bodies["parcel"]
        below = [c for c in world.contacts if c.names == ("parcel", "table")]
        table = sum(c.force for c in below)
        hand = sum((c.force for c in world.contacts if "table" not in c.names), np.zeros(3))
        weight = np.array([0, 0, -mass * 9.81])
        if k > 400:
            assert np.linalg.norm(hand) > 0.5
            ratios.append(sum(np.hypot(*c.force[:2]) for c in below) / table[2])
            touch = next(c.point for c in world.contacts if "table" not in c.names and c.force.any())
            there = parcel.velocity[:3] + np.cross(parcel.velocity[3:], touch - parcel.position)
            moved.append((there[0], np.linalg.norm(table + hand + weight)))
    moved = np.array(moved)
    assert np.median(ratios) == pytest.approx(mu, rel=2e-3)  # the law of friction, measured
    assert max(ratios) < mu * (1 + 1e-6)
    assert np.mean(moved[:, 0]) == pytest.approx(speed, rel=0.01)  # where the hand touches
    assert np.median(moved[:, 1]) < 0.05 * mass * 9.81  # hand, table and weight are in balance
    assert parcel.position[2] == pytest.approx(top + 0.07, abs=1e-3)


def test_an_arm_on_its_way_down_is_caught_on_an_edge():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand").copy()
    shoulder = pepper.joint_index("LShoulderPitch")
    q[shoulder], q[pepper.joint_index("LElbowRoll")] = 0.2, -0.1
    elbow = pk.kinematics.frame_pose(pepper, q, "LForeArm")[:3, 3]
    edge = elbow + np.array([0.08, 0, -0.10])  # the far one: the forearm slopes down beyond it
    scene = Scene().add_box("block", (0.06, 0.2, 0.4), edge - [0.03, 0, 0.2])
    free = Twin(pepper, H)
    caught = Twin(pepper, H, world=World(pepper, scene))
    lower = q.copy()
    lower[shoulder] += 0.35
    for twin in (free, caught):
        twin.reset(q)
        for k in range(300):
            state = twin.step(q + min(1.0, k / 150) * (lower - q))
    assert abs(free.state.position[shoulder] - lower[shoulder]) < 0.01
    contacts = [c for c in caught.world.contacts if np.linalg.norm(c.force) > 1e-6]
    assert contacts
    assert state.position[shoulder] < lower[shoulder] - 0.02
    on_edge = [c for c in contacts if 0.1 < abs(c.normal[0]) < 0.99]
    assert on_edge  # a normal that no face of the block has
    for contact in on_edge:
        assert contact.point[[0, 2]] == pytest.approx(edge[[0, 2]], abs=1e-3)
    assert np.abs(state.velocity).max() < 1e-3
    assert np.abs(off_balance(pepper, state, contacts)).max() < 0.02


def grip(mass, friction):
    """Close the left hand on an upright bar, lift it by 5 cm; return both rises and the world."""
    pepper = pk.load_pepper(hands="mimic")
    hand = pepper.joint_index("LHand")
    up, q, way = np.array([0.0, 0.0, 1.0]), pepper.posture("Stand").copy(), []
    for height in (0.80, 0.85):
        level = pk.ik.AxisAlignment("LArm_effector", up, axis=(0, 1, 0), tolerance=0.03)
        tasks = [pk.ik.HandPosition("left", (0.30, 0.20, height)), level]
        solution = pk.ik.solve(pepper, tasks, start=q, scene=Scene())
        assert solution.success
        q = solution.q.copy()
        q[hand] = 0.9
        way.append(q)
    pose = pk.kinematics.frame_pose(pepper, way[0], "LArm_effector")
    bar = pose[:3, :3] @ [0.016, 0, -0.002] + pose[:3, 3]
    scene = Scene().add_box("stand", (0.06, 0.06, 0.1), bar - [0, 0, 0.12])
    world = World(pepper, scene, friction=friction)
    world.add_box("bar", (0.02, 0.02, 0.14), mass, bar, (0, 0, np.arctan2(pose[1, 0], pose[0, 0])))
    twin = Twin(pepper, H, world=world)
    twin.reset(way[0])
    for k in range(400):
        share = np.clip((k - 120) / 200, 0.0, 1.0)
        target = (1 - share) * way[0] + share * way[1]
        target[hand] = 0.9 - 0.85 * min(1.0, k / 80)
        state = twin.step(target)
    rise = pk.kinematics.frame_pose(pepper, state.position, "LArm_effector")[2, 3] - 0.80
    return world.bodies["bar"].position[2] - bar[2], rise, world


@pytest.mark.thorough
def test_a_hand_closes_on_a_bar_and_lifts_it_by_friction():
    lifted, rise, world = grip(0.05, 0.6)
    assert rise == pytest.approx(0.05, abs=2e-3)
    assert lifted == pytest.approx(rise, abs=3e-3)
    holding = [c for c in world.contacts if np.linalg.norm(c.force) > 1e-6]
    assert any("Finger" in c.names[1] for c in holding)
    assert "stand" not in {name for c in holding for name in c.names}
    carried = sum(c.force for c in holding)
    assert carried == pytest.approx([0, 0, 0.05 * 9.81], abs=0.02)
    sideways = [c.force - (c.force @ c.normal) * c.normal for c in holding]
    assert sum(f[2] for f in sideways) > 0.9 * 0.05 * 9.81  # it is friction that carries


def test_without_friction_the_bar_slips():
    lifted, _, _ = grip(0.05, 0.02)
    assert lifted < 0.01
