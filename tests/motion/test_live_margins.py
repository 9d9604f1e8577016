"""Live motion keeps a distance between the robot's own parts, and names joints that go out of the way."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker
from pepper_kin.collision.fast import fast_checker_for
from pepper_kin.motion import LiveMotion, LiveStatus
from pepper_kin.motion.margins import own_margin

KEPT = 0.003  # [m]


@pytest.fixture(scope="module")
def careful():
    """Pepper at 0.3 of its limits, as among people."""
    pepper = pk.load_pepper()
    slower = {"velocity": 0.3 * pepper.velocity_limits, "acceleration": 0.3 * pepper.acceleration_limits}
    return pepper.with_limits(**slower)


def passing_by(pepper, checker, seed):
    """Return two postures between which the straight way passes itself by less than 2 mm."""
    rng, ready = np.random.default_rng(seed), pepper.posture("Ready")
    for _ in range(3000):
        ends = rng.uniform(pepper.lower_limits, pepper.upper_limits, (2, pepper.n))
        ends[:, :5] = ready[:5]
        if checker.in_collision(ends).any() or checker.clearance(ends, to="self").min() < 2 * KEPT:
            continue
        way = ends[0] + np.linspace(0.0, 1.0, 100)[:, None] * (ends[1] - ends[0])
        if 0.0 < checker.clearance(way, to="self").min() < 0.002:
            return ends
    raise AssertionError("no such postures were drawn")


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_own_parts_keep_their_distance(careful, seed):
    """Coal measures what was executed, six times a cycle; between states 2.5 ms apart less is possible."""
    checker = CollisionChecker(careful)
    start, goal = passing_by(careful, checker, seed)
    live = LiveMotion(careful, start, budget=2.0)
    live.set_goal(goal)
    least = np.inf
    for cycle in range(300):
        state = live.step(cycle / 30)
        sent = np.array([state.at(cycle / 30 + part / 180).position for part in range(6)])
        least = min(least, checker.clearance(sent, to="self").min())
    assert state.status is LiveStatus.REACHED
    assert least > KEPT - 5e-4


def test_ends_that_are_nearer_leave_half_of_their_distance(careful):
    checker = CollisionChecker(careful)
    stand, ready = careful.posture("Stand"), careful.posture("Ready")
    near = float(checker.clearance(stand, to="self"))
    assert own_margin(checker, [ready], 0.01) == 0.01
    assert own_margin(checker, [ready, stand], 0.01) == pytest.approx(near / 2)
    assert own_margin(checker, [ready, stand], 0.4 * near) == 0.4 * near
    rng = np.random.default_rng(0)
    states = rng.uniform(careful.lower_limits, careful.upper_limits, (300, careful.n))
    touching = checker.in_collision(states)
    assert own_margin(checker, states[touching], KEPT) == KEPT
    states = states[~touching]
    for q in states:
        kept = own_margin(checker, [q], KEPT)
        assert not checker.with_margins(0.0, kept).in_collision(q)


@pytest.mark.parametrize("hollow", [False, True])
def test_states_nearer_than_a_margin_of_their_own_are_those_of_coal(careful, hollow):
    """With a solid scene, and with a mesh that is not convex, which coal alone decides."""
    scene = pk.Scene().add_box("box", (0.3, 0.3, 0.3), (0.5, 0.1, 0.8))
    if hollow:
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) / 3
        faces = [[0, 1, 2], [0, 3, 2]]
        scene = pk.Scene().add_mesh("corner", corners, faces, position=(0.35, -0.1, 0.7))
    rng = np.random.default_rng(4)
    states = rng.uniform(careful.lower_limits, careful.upper_limits, (400, careful.n))
    fast = fast_checker_for(careful, scene, KEPT, 0.0)
    margins = np.repeat([0.0, 0.001, 0.003, 0.02], 100)
    exact = [
        bool(fast.exact.with_margins(KEPT, float(margin)).in_collision(q))
        for q, margin in zip(states, margins, strict=True)
    ]
    assert 0 < sum(exact) < 400
    assert fast.nearer(states, margins).tolist() == exact


def test_joints_that_go_out_of_the_way_are_named(careful):
    """Between two postures that differ in one joint, where it cannot go alone."""
    turned = {"RShoulderPitch": 0.9, "RShoulderRoll": -0.3, "RElbowRoll": 0.6}
    start = careful.joint_vector(turned)
    goal = careful.joint_vector(turned | {"RShoulderPitch": -0.5})
    hands = [pk.kinematics.frame_pose(careful, q, "r_gripper")[:3, 3] for q in (start, goal)]
    bar = pk.Scene().add_box("bar", (0.06, 0.3, 0.06), np.mean(hands, axis=0) + np.array([0.1, 0.0, 0.0]))
    live = LiveMotion(careful, start, bar, budget=5.0)
    live.set_goal(goal)
    found = [live.step(cycle / 30) for cycle in range(360)]
    assert found[-1].status is LiveStatus.REACHED
    moved = np.ptp([state.at(cycle / 30).position for cycle, state in enumerate(found)], axis=0)
    named = {name.split(" by ")[0] for state in found for name in state.aside}
    joint = careful.joint_index("RShoulderPitch")
    idle = {careful.joint_names[k] for k in np.flatnonzero(moved > 0.11) if k != joint}
    assert named >= idle
    assert named
    assert "RShoulderPitch" not in named
    report = next(state for state in found if state.aside).report()
    assert f"No task moves {', '.join(next(s.aside for s in found if s.aside))}: out of the way." in report
    live.set_goal(None)
    assert live.step(13.0).aside == ()


@pytest.mark.parametrize("goal", [False, True])
def test_a_robot_at_rest_says_what_runs_into_it(careful, goal):
    """A ball rolls into a hand: it is named with the time until coal finds it at the margin."""
    start, radius, speed, horizon, margin = careful.posture("Ready"), 0.08, 0.5, 0.5, 0.01
    hand = pk.kinematics.frame_pose(careful, start, "RArm_effector")[:3, 3]

    def see(now):
        place = hand + np.array([0.0, -0.5 + speed * now, 0.0])
        return pk.Scene().add_sphere("ball", radius, place, velocity=(0.0, speed, 0.0))

    live = LiveMotion(careful, start, horizon=horizon, margin=margin)
    if goal:
        live.set_goal(start)
    gaps, states = [], []
    for cycle in range(27):
        now = cycle / 30
        live.set_scene(see(now), now)
        states.append(live.step(now))
        gaps.append(CollisionChecker(careful, see(now)).clearance(start, "obstacles"))
    when = np.interp(-margin, -np.array(gaps), np.arange(len(gaps)) / 30)
    for cycle, state in enumerate(states):
        left = when - cycle / 30
        assert state.status is (LiveStatus.REACHED if goal else LiveStatus.WAITING)
        if abs(left - horizon) > 0.02:
            assert ("ball" in state.near) == (left < horizon)
        if abs(left) > 0.02:
            assert state.clear == (left > 0)
        if 0.02 < left < horizon - 0.02:
            assert float(state.reason.split(" in ")[1].split(" s ")[0]) == pytest.approx(left, abs=0.02)
    assert states[-1].reason.startswith(" and ".join(states[-1].near))
    assert "ball" in states[-1].near
    assert "set a goal out of the way" in states[-1].report()
    there = hand + np.array([0.0, 0.0, 0.08])
    live.set_scene(pk.Scene().add_box("box", (0.1, 0.1, 0.1), there), 1.0)
    fallen = live.step(1.0)
    assert "box" in fallen.near
    assert not fallen.clear
