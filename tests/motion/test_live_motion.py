"""Live motion: what is sent is continuous, within limits, and ends in a stop that keeps clear of all."""

import math

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.motion import LiveMotion, LiveStatus

GOAL = {"LShoulderPitch": 0.2, "LElbowRoll": -1.0, "RShoulderRoll": -0.4, "HeadYaw": -0.5}
CYCLE = 1.0 / 30.0


@pytest.fixture(scope="module")
def careful():
    """Pepper at 0.3 of its limits, as among people."""
    pepper = pk.load_pepper()
    slower = {"velocity": 0.3 * pepper.velocity_limits, "acceleration": 0.3 * pepper.acceleration_limits}
    return pepper.with_limits(**slower)


def run(live, seconds, see=None, began=0.0):
    """Step through some time; return times and states, continuous from one to the next."""
    found = []
    for k in range(math.ceil(seconds / CYCLE)):
        now = began + k * CYCLE
        if see is not None:
            live.set_scene(see(now), now)
        found.append((now, live.step(now)))
        if k:
            before, after = found[-2][1].at(now), found[-1][1].at(now)
            assert np.abs(before.position - after.position).max() < 1e-9
            assert np.abs(before.velocity - after.velocity).max() < 1e-9
    return found


def moving_contacts(pepper, found, see):
    """At how many times coal finds the moving robot in contact, every fifth of a cycle."""
    hits = 0
    for now, state in found:
        for at in now + CYCLE * np.arange(5) / 5:
            x = state.at(at)
            if np.abs(x.velocity).max() > 1e-6:
                hits += bool(CollisionChecker(pepper, see(at)).in_collision(x.position))
    return hits


def test_a_goal_is_reached_and_another_taken_on_the_way(careful):
    start, goal = careful.posture("Stand"), careful.joint_vector(GOAL)
    with_live = LiveMotion(careful, start, budget=2.0)
    with_live.set_goal(goal)
    found = run(with_live, 0.5)
    with_live.set_goal(start)
    found += run(with_live, 4.0, began=found[-1][0] + CYCLE)
    assert {state.status for _, state in found} == {LiveStatus.MOVING, LiveStatus.REACHED}
    assert found[-1][1].status is LiveStatus.REACHED
    assert np.array_equal(found[-1][1].at(10.0).position, found[-1][1].trajectory.end)
    assert found[-1][1].trajectory.end == pytest.approx(start, abs=1e-9)
    for _, state in found[::5]:
        assert set(state.trajectory.check(careful, balance=None).failures) == set()
        assert np.abs(state.trajectory(state.trajectory.duration).velocity).max() < 1e-9


@pytest.mark.thorough
def test_a_robot_stops_for_what_crosses_and_goes_on(careful):
    """A ball passes where the left arm goes: the robot waits or passes behind it."""
    start, goal = careful.posture("Stand"), careful.joint_vector(GOAL)
    hand = pk.kinematics.frame_pose(careful, goal, "l_gripper")[:3, 3]
    speed = np.array([0.0, -0.4, 0.0])

    def see(now):
        place = hand + np.array([-0.02, 0.5, 0.0]) + now * speed
        return pk.Scene().add_sphere("ball", 0.12, place, velocity=speed)

    live = LiveMotion(careful, start, see(0.0), budget=2.0)
    live.set_goal(goal)
    found = run(live, 6.0, see)
    assert found[-1][1].status is LiveStatus.REACHED
    assert moving_contacts(careful, found, see) == 0
    late = [state for _, state in found if state.status in (LiveStatus.STOPPING, LiveStatus.WAITING)]
    assert late
    assert any("ball" in state.reason for state in late)
    assert all(state.clear for _, state in found)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_hit_while_obstacles_keep_to_their_uncertainty(careful, seed):
    rng, start = np.random.default_rng(seed), careful.posture("Stand")
    boxes = pk.Scene()
    believed, true = rng.uniform(-0.3, 0.3, (2, 6, 3))
    true = believed + 0.3 * true / np.linalg.norm(true, axis=1)[:, None]
    size, place = rng.uniform(0.08, 0.24, (6, 3)), rng.uniform((0.35, -0.7, 0.4), (0.9, 0.7, 1.3), (6, 3))

    def see(now):
        boxes = pk.Scene()
        for k in range(6):
            there = place[k] + now * true[k]
            boxes = boxes.add_box(f"{k}", size[k], there, velocity=believed[k], uncertainty=0.3)
        return boxes

    boxes = see(0.0)
    live = LiveMotion(careful, start, boxes, budget=2.0)
    live.set_goal(careful.joint_vector(GOAL))
    found = run(live, 3.0, see)
    assert moving_contacts(careful, found, see) == 0


@pytest.mark.thorough
def test_a_robot_that_is_behind_hits_nothing_either(careful):
    """What is commanded is done 0.3 s later, while balls that come to where a hand leaves are on time."""
    start, goal = careful.joint_vector(GOAL), careful.posture("Stand")
    hand, hits = pk.kinematics.frame_pose(careful, start, "l_gripper")[:3, 3], {}
    for known in (0.0, 0.3):
        hits[known] = 0
        for apart in np.linspace(0.16, 0.4, 7):

            def see(now, apart=apart):
                place = hand + np.array([apart - 0.4 * now, 0.0, 0.0])
                return pk.Scene().add_sphere("ball", 0.08, place, velocity=(-0.4, 0.0, 0.0))

            live = LiveMotion(careful, start, see(0.0), budget=2.0, delay=known)
            live.set_goal(goal)
            found = run(live, 1.5, see)
            hits[known] += moving_contacts(careful, found, lambda at, see=see: see(at + 0.3))
    assert hits[0.0] > 0
    assert hits[0.3] == 0


@pytest.mark.thorough
def test_a_way_around_what_stands_is_planned(careful):
    start = careful.joint_vector({"RShoulderPitch": 0.9, "RShoulderRoll": -0.3, "RElbowRoll": 0.6})
    goal = careful.joint_vector({"RShoulderPitch": -0.5, "RShoulderRoll": -0.3, "RElbowRoll": 0.6})
    a, b = (pk.kinematics.frame_pose(careful, q, "r_gripper")[:3, 3] for q in (start, goal))
    bar = pk.Scene().add_box("bar", (0.06, 0.3, 0.06), (a + b) / 2 + np.array([0.1, 0.0, 0.0]))
    straight = pk.retime(careful, [start, goal])
    assert straight.check(careful, bar).obstacle_clearance.value < 0.0
    live = LiveMotion(careful, start, bar, budget=5.0)
    live.set_goal(goal)
    found = run(live, 12.0)
    assert found[-1][1].status is LiveStatus.REACHED
    assert moving_contacts(careful, found, lambda _: bar) == 0


def test_a_way_that_is_given_is_gone_along(careful):
    """At rest it is the motion, slower where limits ask for that; in motion it is joined."""
    start, via, goal = (careful.joint_vector(x) for x in ({}, {"HeadYaw": 0.8, "LShoulderRoll": 0.4}, GOAL))
    way = pk.retime(careful, [start, via, goal])
    for given, factor in ((way, 1.0), (way.scaled(0.5), 2.0)):
        live = LiveMotion(careful, start, budget=2.0)
        live.set_goal(goal, given)
        found = run(live, way.duration + 0.5)
        assert found[-1][1].status is LiveStatus.REACHED
        for now, state in found[1:-20]:
            assert np.allclose(state.at(now).position, given(now / factor).position, rtol=0, atol=1e-6)
    live = LiveMotion(careful, start, budget=2.0)
    live.set_goal(careful.joint_vector({"RShoulderPitch": 0.8}))
    now, state = run(live, 0.3)[-1]
    live.set_goal(goal, way)
    later = run(live, 5.0, began=now + CYCLE)
    assert later[-1][1].status is LiveStatus.REACHED
    joined = np.array([one.at(at).position for at, one in later])
    assert np.abs(joined[:, None] - way(np.linspace(0, way.duration, 400)).position).max(axis=2).min() < 0.02
    with pytest.raises(InvalidValueError, match="way"):
        live.set_goal(start, way)
    with pytest.raises(InvalidValueError):
        live.set_goal(goal, pk.Trajectory(("HeadYaw",), [0.0, 1.0], np.zeros((1, 1, 1))))


def test_a_given_way_that_is_not_clear_or_too_heavy_is_left(careful):
    start, goal = careful.posture("Stand"), careful.joint_vector(GOAL)
    hand = pk.kinematics.frame_pose(careful, careful.joint_vector({"LShoulderPitch": -0.5}), "l_gripper")
    ball = pk.Scene().add_sphere("ball", 0.1, hand[:3, 3])
    away = pk.retime(careful, [start, careful.joint_vector({"LShoulderPitch": -0.8}), goal])
    assert away.check(careful, ball).obstacle_clearance.value < 0.0
    jumps = pk.Trajectory(careful.joint_names, [0.0, 1.0], np.stack([start, goal - start])[None])
    for way in (away, jumps):
        live = LiveMotion(careful, start, ball, budget=2.0)
        live.set_goal(goal, way)
        found = run(live, 4.0)
        assert found[-1][1].status is LiveStatus.REACHED
        assert moving_contacts(careful, found, lambda _: ball) == 0


def test_a_search_pauses_where_its_budget_is_spent_and_goes_on(careful):
    """A wall with a slit: no cycle waits for the search, which takes some of them."""
    start = careful.joint_vector({"RShoulderPitch": 0.9, "RShoulderRoll": -0.3, "RElbowRoll": 0.6})
    goal = careful.joint_vector({"RShoulderPitch": -0.5, "RShoulderRoll": -0.3, "RElbowRoll": 0.6})
    a, b = (pk.kinematics.frame_pose(careful, q, "r_gripper")[:3, 3] for q in (start, goal))
    bar = pk.Scene().add_box("bar", (0.06, 0.3, 0.06), (a + b) / 2 + np.array([0.1, 0.0, 0.0]))
    live = LiveMotion(careful, start, bar, budget=2e-4)
    live.set_goal(goal)
    found = run(live, 12.0)
    searching = [state for _, state in found if state.searching]
    assert len(searching) > 2
    assert all(state.status is not LiveStatus.REACHED for state in searching)
    assert all(state.status is not LiveStatus.HALTED for _, state in found)
    assert moving_contacts(careful, found, lambda _: bar) == 0
    live.set_goal(None)
    assert not run(live, 0.1, began=found[-1][0] + CYCLE)[-1][1].searching


@pytest.mark.parametrize("gap", [0.1, 0.3, 1.0, 10.0])
def test_a_loop_that_is_starved_finds_the_robot_on_its_stop(careful, gap):
    live = LiveMotion(careful, careful.posture("Stand"), budget=2.0)
    live.set_goal(careful.joint_vector(GOAL))
    now, state = run(live, 0.4)[-1]
    assert state.status is LiveStatus.MOVING
    later = live.step(now + gap)
    before, after = state.at(now + gap), later.at(now + gap)
    assert before.position == pytest.approx(after.position, abs=1e-9)
    assert before.velocity == pytest.approx(after.velocity, abs=1e-9)
    if gap >= 1.0:
        assert np.abs(before.velocity).max() == 0.0
    assert run(live, 4.0, began=now + gap + CYCLE)[-1][1].status is LiveStatus.REACHED


def a_moment_on(careful):
    live = LiveMotion(careful, careful.posture("Stand"), budget=2.0)
    live.set_goal(careful.joint_vector(GOAL))
    now, state = run(live, 0.4)[-1]
    return live, now + CYCLE, state


def test_an_old_scene_stops_the_robot_until_a_new_one_comes(careful):
    live, now, _ = a_moment_on(careful)
    live.set_scene(pk.Scene(), now - 1.5)
    found = run(live, 1.0, began=now)
    assert found[0][1].status is LiveStatus.STOPPING
    assert "1.50 s old" in found[0][1].reason
    assert found[-1][1].status is LiveStatus.WAITING
    live.set_scene(pk.Scene(), found[-1][0])
    assert live.step(found[-1][0] + CYCLE).status is LiveStatus.MOVING


@pytest.mark.parametrize("fault", ["off", "nan", "clock", "clock nan"])
def test_what_cannot_be_right_halts_the_robot(careful, fault):
    live, now, state = a_moment_on(careful)
    live.set_state(state.at(now - 0.1).position, now)  # behind, as robots are
    assert live.step(now).status is LiveStatus.MOVING
    now += CYCLE
    if fault == "off":
        live.set_state(state.at(now).position + 0.5, now)
    elif fault == "nan":
        live.set_state(np.full(careful.n, np.nan), now)
    if fault.startswith("clock"):
        live.step(math.nan if fault == "clock nan" else now - 0.5)
    found = run(live, 1.5, began=now)
    assert {state.status for _, state in found} == {LiveStatus.HALTED}
    words = {"off": "off the motion", "nan": "not finite", "clock": "clock", "clock nan": "clock"}
    assert words[fault] in found[-1][1].reason
    assert np.abs(found[-1][1].at(now + 2.0).velocity).max() == 0.0


def test_without_a_goal_the_robot_stops(careful):
    live, now, _ = a_moment_on(careful)
    live.set_goal(None)
    found = run(live, 1.0, began=now)
    assert found[0][1].status is LiveStatus.STOPPING
    assert found[-1][1].status in (LiveStatus.WAITING, LiveStatus.REACHED)


def test_what_is_refused(careful):
    stand = careful.posture("Stand")
    with pytest.raises(InvalidValueError, match="in contact"):
        LiveMotion(careful, stand, pk.Scene().add_sphere("ball", 0.3, (0.0, 0.0, 0.9)))
    for option in ("rate", "horizon", "margin", "delay", "tolerance", "budget"):
        with pytest.raises(InvalidValueError, match=option):
            LiveMotion(careful, stand, **{option: -1.0})
    live = LiveMotion(careful, stand)
    with pytest.raises(LimitError):
        live.set_goal(stand + 10.0)
    with pytest.raises(InvalidValueError, match="goal"):
        live.set_goal(stand * np.nan)
    with pytest.raises(InvalidValueError, match="time"):
        live.set_scene(pk.Scene(), math.nan)
    with pytest.raises(InvalidValueError, match="scene"):
        live.set_scene("wall", 0.0)


@pytest.mark.parametrize("seed", range(6))
def test_whatever_comes_what_is_sent_is_continuous_and_within_limits(careful, seed):
    rng, live = np.random.default_rng(seed), LiveMotion(careful, careful.posture("Stand"), rate=100.0)
    goals = [
        careful.posture("Stand"),
        careful.joint_vector(GOAL),
        careful.joint_vector({"HipRoll": 0.2}),
        None,
    ]
    now, before, said = 0.0, None, set()
    for _ in range(150):
        if rng.random() < 0.1:
            live.set_goal(goals[rng.choice(4, p=[0.3, 0.3, 0.3, 0.1])])
        if rng.random() < 0.2:
            scene = pk.Scene()
            for k in range(rng.integers(0, 4)):
                place = rng.uniform((0.3, -0.8, 0.4), (1.0, 0.8, 1.4))
                motion = {"velocity": rng.uniform(-0.5, 0.5, 3), "uncertainty": rng.choice([0.0, 0.2])}
                scene = scene.add_box(f"{k}", rng.uniform(0.05, 0.3, 3), place, **motion)
            live.set_scene(scene, now)
        now += 0.01 * rng.choice([1.0, 0.1, 2.5, 30.0], p=[0.7, 0.1, 0.15, 0.05])
        state = live.step(now)
        said.add(state.status)
        if before is not None:
            old, new = before.at(now), state.at(now)
            assert np.abs(old.position - new.position).max() < 1e-9
            assert np.abs(old.velocity - new.velocity).max() < 1e-8
        sent, before = state.trajectory, state
        assert sent.coefficients.shape[1] < 30
        sampled = sent(np.linspace(0.0, sent.duration, 50))
        assert np.all(np.abs(sampled.velocity) <= careful.velocity_limits * (1 + 1e-6))
        assert np.all(np.abs(sampled.acceleration) <= careful.acceleration_limits * (1 + 1e-6))
        assert np.abs(sampled.velocity[-1]).max() < 1e-6
    assert {LiveStatus.MOVING, LiveStatus.STOPPING} <= said


@pytest.mark.thorough
def test_the_example_gives_way_and_goes_on(run_example, tmp_path):
    done = run_example("22_live_motion.py", cwd=tmp_path)
    assert done.returncode == 0
    assert "s it waited" in done.stdout
    assert "ball come too near" in done.stdout
