"""Near obstacles and near tipping: the servo keeps away from both, and says so."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.core.brake_check import FARTHEST, NOTHING, obstacle
from pepper_kin.core.braking import brake_path
from pepper_kin.core.near_state import near_at
from pepper_kin.servo.clearance_guard import ClearanceGuard, frame_motion_bounds
from pepper_kin.servo.range_curves import range_curves

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
READY = PEPPER.joint_vector(
    {"LShoulderPitch": 0.9, "LElbowRoll": -1.2, "LShoulderRoll": 0.3, "RShoulderRoll": -0.5}
)
WALL = pk.Scene().add_box("wall", size=(0.04, 1.0, 1.0), position=(0.42, 0.2, 0.9))


@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_hand_stops_before_a_wall(speed):
    servo = pk.servo.Servo(PEPPER, READY, scene=WALL, margin=0.02)
    states = []
    for _ in range(200):
        servo.set_twist("left", (speed, 0.0, 0.0))
        states.append(servo.step())
    assert float(pk.collision.clearance(PEPPER, READY, WALL)) > 0.03
    path = np.array([state.q for state in states])
    for name, to in (("obstacles", "obstacles"), ("itself", "self")):
        exact = pk.collision.clearance(PEPPER, path[:-1], WALL, to=to)
        told = np.array([getattr(state.clearance, name) for state in states[1:]])
        near = np.isfinite(told)
        assert near.any() or name == "itself"
        assert np.allclose(told[near], exact[near], atol=3e-6)
    clearances = pk.collision.clearance(PEPPER, path, WALL)
    assert clearances.min() > 0.7 * 0.02
    assert clearances[-1] < 0.03  # it went there
    limits = {words for state in states for words in state.limited_by}
    assert any(words.startswith("clearance of") and "wall" in words for words in limits)
    assert not pk.collision.in_collision(PEPPER, path, WALL).any()


def test_target_inside_an_obstacle_is_approached_and_not_reached():
    scene = pk.Scene().add_sphere("ball", 0.08, (0.38, 0.20, 0.95))
    servo = pk.servo.Servo(PEPPER, READY, scene=scene, command_timeout=20.0)
    servo.set_target(pk.ik.HandPosition("left", (0.38, 0.20, 0.95)))
    states = [servo.step() for _ in range(500)]
    path = np.array([state.q for state in states])
    assert not pk.collision.in_collision(PEPPER, path, scene).any()
    assert states[-1].errors[0] < 0.17
    assert np.abs(states[-1].v).max() < 0.02  # and rests there without trembling


def test_random_targets_in_a_scene_never_touch():
    scene = pk.Scene().add_box("table", size=(0.4, 0.9, 0.03), position=(0.47, 0.05, 0.72))
    scene = scene.add_sphere("ball", 0.08, (0.35, 0.2, 1.0))
    generator = np.random.default_rng(0)
    servo = pk.servo.Servo(PEPPER, STAND, scene=scene)
    path = []
    for tick in range(400):
        if tick % 25 == 0:
            left, right = generator.uniform((0.0, -0.2, 0.5), (0.6, 0.5, 1.3), (2, 3)) * [
                [1, 1, 1],
                [1, -1, 1],
            ]
        servo.set_target([pk.ik.HandPosition("left", left), pk.ik.HandPosition("right", right)])
        path.append(servo.step().q)
    assert not pk.collision.in_collision(PEPPER, np.array(path), scene).any()
    assert pk.collision.clearance(PEPPER, np.array(path), scene).min() > 0.0005


def test_scene_may_move():
    """An obstacle that comes up is noticed at once; a robot that it touches may still go away."""
    servo = pk.servo.Servo(PEPPER, READY, scene=pk.Scene())
    hand = pk.kinematics.frame_pose(PEPPER, READY, "LArm_effector")[:3, 3]
    for _ in range(20):
        servo.set_twist("left", (0.2, 0.0, 0.0))
        servo.step()
    servo.set_scene(pk.Scene().add_box("wall", (0.02, 0.5, 0.5), hand + np.array([0.16, 0.0, 0.0])))
    for _ in range(100):
        servo.set_twist("left", (0.2, 0.0, 0.0))
        state = servo.step()
    reached = pk.kinematics.frame_pose(PEPPER, state.q, "LArm_effector")[0, 3]
    assert reached < hand[0] + 0.15
    for _ in range(50):
        servo.set_twist("left", (-0.2, 0.0, 0.0))
        state = servo.step()
    assert pk.kinematics.frame_pose(PEPPER, state.q, "LArm_effector")[0, 3] < reached - 0.05


def test_what_is_shown_to_stop_clear_does():
    """The proof against a fine sampling of the very brake path that it speaks of."""
    generator = np.random.default_rng(1)
    guard, ranges = ClearanceGuard(PEPPER, WALL, 0.01, 4.0), range_curves(PEPPER).table
    shown, refused, joints = 0, 0, np.empty(15, dtype=bool)
    a, dt = PEPPER.acceleration_limits, 0.01
    for _ in range(300):
        q = READY + generator.normal(size=15) * 0.15
        q = np.clip(q, PEPPER.lower_limits, PEPPER.upper_limits)
        v = generator.normal(size=15) * generator.choice([0.3, 1.0, 2.0])
        if pk.collision.in_collision(PEPPER, q, WALL):
            continue
        near = near_at(guard.world, q, FARTHEST)
        if near.distances.size and near.distances[0] < 0.006:
            continue
        shifts = brake_path(v, a, dt)
        path = q + shifts
        if obstacle(guard.world, ranges, q, shifts, near, 0.005, joints) == NOTHING:
            shown += 1
            assert pk.collision.clearance(PEPPER, path, WALL).min() >= 0.005 - 1e-6
            assert not pk.collision.in_collision(PEPPER, path, WALL).any()
        else:
            refused += 1
    assert shown > 30
    assert refused > 30


def test_lever_arms_bound_all_motion():
    generator, motion_bounds = np.random.default_rng(2), frame_motion_bounds(PEPPER)
    for _ in range(20):
        q, change = generator.uniform(-0.5, 0.5, 15), generator.normal(size=15) * 0.05
        before, after = (_shape_points(x) for x in (q, q + change))
        assert np.linalg.norm(after - before, axis=1).max() <= motion_bounds @ np.abs(change) + 1e-12


def _shape_points(q):
    poses = {s.link: pk.kinematics.frame_pose(PEPPER, q, s.link) for s in PEPPER.collision_shapes}
    return np.array([(poses[s.link] @ s.transform_shape_to_link)[:3, 3] for s in PEPPER.collision_shapes])


def test_balance_is_kept_where_it_would_be_lost():
    """Hard swings of the trunk: with balance the zero-moment point stays on the wheels."""
    margins = []
    for balance in (None, 0.02):
        servo = pk.servo.Servo(PEPPER, STAND, balance=balance)
        path = [STAND, STAND]
        for tick in range(300):
            sign = 1 if (tick // 30) % 2 else -1
            pose = {"HipPitch": 0.7 * sign, "HipRoll": 0.4 * sign, "KneePitch": -0.3 * sign}
            servo.set_target(pk.ik.JointPosture(list(pose.values()), joints=list(pose)))
            path.append(servo.step().q)
        path = np.array(path)
        v, a = np.diff(path, axis=0) * 100, np.diff(path, 2, axis=0) * 1e4
        margins.append(pk.dynamics.tip_over_margin(PEPPER, path[1:-1], v[:-1], a).min())
        assert pk.collision.clearance(PEPPER, path).min() > 0.0
    assert margins[0] < -0.05
    assert margins[1] > 0.019


def test_hard_random_swings_never_touch_and_name_each_tick_without_balance():
    """Near the body only the hardest brake may keep clear: then balance gives way, seldom and by name."""
    generator, lost, ticks = np.random.default_rng(2), 0, 0
    for _ in range(2):
        servo, path, states = pk.servo.Servo(PEPPER, STAND, balance=0.02), [STAND, STAND], []
        for tick in range(240):
            if tick % 30 == 0:
                swing = generator.uniform(-0.9, 0.9, 3)
                first = PEPPER.joint_vector(
                    dict(zip(("KneePitch", "HipPitch", "HipRoll"), swing, strict=True))
                )
                first = np.clip(first, PEPPER.lower_limits, PEPPER.upper_limits)
            servo.set_target(pk.ik.JointPosture(first[:3], joints=["KneePitch", "HipPitch", "HipRoll"]))
            states.append(servo.step())
            path.append(states[-1].q)
        path = np.array(path)
        assert not pk.collision.in_collision(PEPPER, path).any()
        v, a = np.diff(path, axis=0) * 100, np.diff(path, 2, axis=0) * 1e4
        margin = pk.dynamics.tip_over_margin(PEPPER, path[1:-1], v[:-1], a)
        for state, kept in zip(states, margin, strict=True):
            assert kept > 0.019 or "balance" in state.relaxed
        lost, ticks = lost + np.count_nonzero(margin < 0.0), ticks + len(margin)
    assert lost < 0.1 * ticks


def test_a_row_that_braking_breaks_gives_way_and_is_named():
    """Swinging fast with balance switched on late: braking hard is allowed, and said."""
    v = np.zeros(15)
    v[PEPPER.joint_index("HipPitch")] = 2.5
    task = pk.ik.JointPosture([0.8], joints=["HipPitch"])
    step = pk.servo.differential_step(PEPPER, STAND, v, 0.01, task, balance=0.08, collisions=False)
    assert step.relaxed == ("balance",)
    calm = pk.servo.differential_step(PEPPER, STAND, 0 * v, 0.01, task, balance=0.08, collisions=False)
    assert calm.relaxed == ()


@pytest.mark.thorough
@pytest.mark.parametrize("collisions", [False, True])
@pytest.mark.parametrize("away", [(0.8, 0.2, 1.6), (-1.0, 0.3, 0.8), (0.79, 0.73, 1.06)])
def test_a_target_out_of_reach_is_approached_and_left_again_with_balance(away, collisions):
    """The hand stays where it is nearest, balance is hardly ever lost, and the target back is reached."""
    servo, errors, path, lost = pk.servo.Servo(PEPPER, STAND, balance=0.01, collisions=collisions), [], [], 0
    for target in [(0.3, 0.2, 0.9)] * 150 + [away] * 500 + [(0.3, 0.2, 0.9)] * 500:
        servo.set_target(pk.ik.HandPosition("left", target))
        state = servo.step()
        hand = pk.kinematics.frame_pose(PEPPER, state.q, "LArm_effector")[:3, 3]
        errors.append(np.linalg.norm(hand - target))
        path.append(state.q)
        lost += "balance" in state.relaxed
    assert errors[649] < min(errors[150:650]) + 0.01
    assert errors[-1] < 0.001
    v, a = np.diff(path, axis=0) * 100, np.diff(path, 2, axis=0) * 1e4
    margin = pk.dynamics.tip_over_margin(PEPPER, np.array(path[1:-1]), v[:-1], a)
    assert np.count_nonzero(margin < 0.0) <= lost < 0.02 * len(path)


@pytest.mark.parametrize("comes", [False, True])
def test_an_arm_without_a_task_that_gives_way_is_named(comes):
    """A ball is pushed slowly against the right hand, while only the left has a target."""
    start = PEPPER.posture("Ready")
    left, right = (pk.kinematics.frame_pose(PEPPER, start, f"{s}Arm_effector")[:3, 3] for s in "LR")
    servo = pk.servo.Servo(PEPPER, start)
    arm = [PEPPER.joint_index(name) for name in PEPPER.joint_group("right_arm")]
    for tick in range(250):
        away = 0.22 - 0.0008 * tick if comes else 0.5
        servo.set_scene(pk.Scene().add_sphere("ball", 0.05, right + np.array((away, 0.0, 0.0))))
        servo.set_target(pk.ik.HandPosition("left", left))
        state = servo.step()
    far = [PEPPER.joint_names[j] for j in arm if abs(state.q[j] - start[j]) > 0.1]
    assert bool(far) == comes
    assert {words.split()[0] for words in state.aside} >= set(far)
    assert ("no task moves" in state.report()) == comes
