"""Plans that begin in motion: certificates, continuity, ways that are said, refusals."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.motion import PlanStatus

HOW = {"straight": "Straight on", "joined": "joined in motion", "after a stop": "stops first"}


@pytest.fixture(scope="module")
def pepper():
    """The robot whose motions use all that the limits allow: velocities are drawn up to these."""
    return pk.load_pepper().with_requirements("limits")


def cases(pepper, rng, count, boxes):
    """Yield starts, velocities, goals, and scenes which the ends do not touch, legs near upright."""
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.04 * lower[:3], 0.04 * upper[:3]
    while count:
        ends, scene = rng.uniform(lower, upper, (2, pepper.n)), pk.Scene()
        if pk.collision.in_collision(pepper, ends).any():
            continue
        room = np.minimum(pepper.upper_limits - ends[0], ends[0] - pepper.lower_limits)
        most = np.minimum(np.sqrt(2.0 * pepper.acceleration_limits * room), pepper.velocity_limits)
        velocity = rng.uniform(-0.7, 0.7, pepper.n) * most
        while len(scene.names) < boxes:
            place, name = rng.uniform((0.2, -0.6, 0.5), (0.8, 0.6, 1.3)), f"box {len(scene.names)}"
            more = scene.add_box(name, rng.uniform(0.08, 0.2, 3), place)
            scene = scene if pk.collision.in_collision(pepper, ends, more).any() else more
        count -= 1
        yield ends[0], velocity, ends[1], scene


@pytest.mark.thorough
@pytest.mark.parametrize("boxes", [0, 6])
def test_motions_begin_with_the_velocity_and_keep_all_limits(pepper, boxes):
    """The certificate measures distances by coal and torques by Newton-Euler, every millisecond."""
    ways = []
    for start, velocity, goal, scene in cases(pepper, np.random.default_rng(boxes), 25, boxes):
        plan = pk.plan(pepper, start, goal, scene, start_velocity=velocity, timeout=1.0)
        if not plan.success:
            ways.append(plan.status)
            assert plan.trajectory is None
            assert plan.splice is None
            continue
        ways.append(plan.splice.how)
        assert HOW[plan.splice.how] in plan.message
        motion = plan.trajectory
        first, last = motion(0.0), motion(motion.duration)
        assert np.allclose(first.position, start, rtol=0, atol=1e-9)
        assert np.allclose(first.velocity, velocity, rtol=0, atol=1e-9)
        assert np.allclose(last.position, goal, rtol=0, atol=1e-9)
        assert np.abs(last.velocity).max() < 1e-9
        inner = np.arange(len(motion.breaks) - 2)
        before = motion.at_segments(inner, np.diff(motion.breaks)[:-1])
        after = motion.at_segments(inner + 1, 0 * inner)
        assert np.allclose(before.position, after.position, rtol=0, atol=1e-9)
        assert np.allclose(before.velocity, after.velocity, rtol=0, atol=1e-6)
        certificate = motion.check(pepper, scene, balance=None)
        assert set(certificate.failures) <= {"balance"}, certificate.report()
        if scene is not None and scene.objects:
            near = certificate.obstacle_clearance.value
            assert plan.clearance.obstacles == pytest.approx(near, abs=1e-6)
        assert plan.clearance.itself == pytest.approx(certificate.self_clearance.value, abs=1e-6)
        assert plan.path.shape == (len(motion.breaks), pepper.n)
        assert np.array_equal(plan.goal, motion.end)
    assert sum(way in HOW for way in ways) >= (14 if boxes else 22), ways
    assert ways.count("straight") >= 5
    assert not boxes or ways.count("joined") >= 4, ways


def test_goals_of_tasks_and_several_goals(pepper):
    start = pepper.posture("Stand")
    velocity = np.zeros(pepper.n)
    velocity[pepper.joint_index("LShoulderPitch")] = -0.8
    tasks = [pk.ik.HandPosition("left", (0.3, 0.2, 0.9))]
    found = pk.plan(pepper, start, tasks, start_velocity=velocity, balance=0.0)
    assert found.success
    assert found.ik is not None
    reached = pk.kinematics.frame_pose(pepper, found.trajectory.end, "LArm_effector")[:3, 3]
    assert np.allclose(reached, (0.3, 0.2, 0.9), rtol=0, atol=2e-3)
    assert found.trajectory.check(pepper, balance=0.0).success
    near, far = (pepper.joint_vector({"LShoulderPitch": x}) for x in (1.2, -1.0))
    both = pk.plan(pepper, start, [far, near], start_velocity=velocity)
    alone = [pk.plan(pepper, start, one, start_velocity=velocity).trajectory.duration for one in (far, near)]
    assert both.trajectory.duration == pytest.approx(min(alone))
    with pytest.raises(InvalidValueError, match=r"begins in motion.*its trajectory"):
        pk.retime(pepper, both)


def test_a_joint_without_room_to_stop_is_named(pepper):
    start, velocity = pepper.posture("Stand").copy(), np.zeros(pepper.n)
    j = pepper.joint_index("HeadYaw")
    start[j], velocity[j] = pepper.upper_limits[j] - 0.01, pepper.velocity_limits[j]
    plan = pk.plan(pepper, start, pepper.posture("Stand"), start_velocity=velocity)
    assert plan.status is PlanStatus.START_TOO_FAST
    assert plan.message.startswith("HeadYaw takes ")
    assert "0.01 rad from its limit" in plan.message


def test_at_rest_it_is_a_motion_from_rest(pepper):
    goal = pepper.joint_vector({"LShoulderPitch": 0.4})
    plan = pk.plan(pepper, pepper.posture("Stand"), goal, start_velocity=np.zeros(pepper.n))
    assert plan.splice.how == "straight"
    assert plan.trajectory.check(pepper).success


def test_toward_a_board(pepper):
    """A hand below a board turns back in time, has to stop first, or would meet it, by its speed."""
    start = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -0.1})
    hand = pk.kinematics.frame_pose(pepper, start, "LArm_effector")[:3, 3]
    board = pk.Scene().add_box("board", (0.2, 0.2, 0.02), hand + np.array([0.05, 0.0, 0.15]))
    goal, velocity, said = pepper.joint_vector({"LShoulderPitch": 1.5}), np.zeros(pepper.n), []
    for share in (0.1, 0.3, 0.6, 1.0):
        velocity[5] = -share * pepper.velocity_limits[5]
        plan = pk.plan(pepper, start, goal, board, start_velocity=velocity)
        said.append(plan.splice.how if plan.success else plan.status)
        assert not plan.success or plan.trajectory.check(pepper, board).success
    assert said == ["straight", "after a stop", PlanStatus.START_TOO_FAST, PlanStatus.START_TOO_FAST]
    line = pk.Trajectory(pepper.joint_names, [0.0, 1.0], np.stack([start, velocity])[None])
    assert line.stop(pepper, 0.0, scene=board).clearance.obstacles <= 0.0
    touching = pk.Scene().add_box("wall", (0.2, 0.2, 0.02), hand)
    plan = pk.plan(pepper, start, goal, touching, start_velocity=velocity)
    assert plan.status is PlanStatus.START_IN_COLLISION
    assert "wall" in plan.message


def test_refusals_name_what_is_wrong(pepper):
    start, goal = pepper.posture("Stand"), pepper.joint_vector({"HeadYaw": 0.4})
    slow = np.zeros(pepper.n)
    slow[pepper.joint_index("HeadYaw")] = 0.1
    fast = 2.0 * pepper.velocity_limits
    with pytest.raises(LimitError, match=r"start_velocity: .* rad/s"):
        pk.plan(pepper, start, goal, start_velocity=fast)
    for wrong in (slow[:-1], np.full(pepper.n, np.nan), 0.0):
        with pytest.raises(InvalidValueError, match="start_velocity"):
            pk.plan(pepper, start, goal, start_velocity=wrong)
    for options in ({"smooth": True}, {"costs": [pk.ik.LookAt((1.0, 0.0, 1.0))]}):
        with pytest.raises(InvalidValueError, match="start_velocity"):
            pk.plan(pepper, start, goal, start_velocity=slow, **options)
    with pytest.raises(InvalidValueError, match="HeadYaw"):
        pk.plan(pepper, start, start, start_velocity=slow, joints="left_arm")
    planar = pk.load_pepper(base="planar")
    stand = planar.posture("Stand")
    with pytest.raises(InvalidValueError, match="BaseX"):
        pk.plan(planar, stand, stand, start_velocity=0.0 * stand)
    moving = pk.Scene().add_sphere("ball", 0.1, (2, 0, 1), velocity=(-0.1, 0, 0))
    with pytest.raises(InvalidValueError, match="ball"):
        pk.plan(pepper, start, goal, moving, start_velocity=slow)
    seeds = pk.motion.PlanProblem(pepper=pepper, start=start, goal=goal, start_velocity=slow)
    slow[:] = 7.0
    assert seeds.solve().success
