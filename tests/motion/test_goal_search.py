import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.ik.fast import alternatives
from pepper_kin.motion.checks import checks_for
from pepper_kin.motion.goal_search import APART, GOALS, NEARBY, STEPS, clear_goals
from pepper_kin.motion.static_limits import static_limits

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
TABLE = pk.Scene().add_box("table", (0.40, 0.80, 0.03), (0.47, 0.05, 0.715))
MARGIN = 0.01


def checks_of(scene, **limits):
    return checks_for(PEPPER, scene, static_limits(PEPPER, limits.get("balance"), limits.get("payload")))


def one_by_one(statics, scene, tasks, seed, movable=None):
    """Solve from each start by itself, and ask coal and the gravity torque of each solution."""
    joints = None if movable is None else [PEPPER.joint_names[k] for k in np.flatnonzero(movable)]
    first = pk.ik.solve(PEPPER, tasks, STAND, collisions=False, seed=seed, joints=joints)
    more = alternatives(PEPPER, tuple(tasks), STAND, movable, seed, NEARBY, STEPS)
    coal = pk.collision.CollisionChecker(PEPPER, scene, MARGIN)
    kept = []
    for q in [first.q, *more]:
        differs = all(np.abs(q - other).max() >= APART for other in kept)
        if differs and not statics.violation(q, "goal") and not coal.in_collision(q):
            kept.append(q)
    return np.array(kept[:GOALS])


@pytest.mark.parametrize("seed", range(8))
def test_goals_are_those_of_the_starts_one_by_one(seed):
    rng = np.random.default_rng(seed)
    point = rng.uniform((0.28, 0.05, 0.80), (0.40, 0.30, 1.00))
    tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
    checks = checks_of(TABLE)
    found = clear_goals(checks, STAND, tasks, None, MARGIN, seed, 5.0)
    expected = one_by_one(checks.statics, TABLE, tasks, seed)
    assert len(expected)
    np.testing.assert_allclose(found.goals, expected, atol=1e-9)


@pytest.mark.parametrize("payload", [None, {"left": 0.2}])
def test_goals_with_balance_are_those_farthest_inside_the_wheels_first(payload):
    rng, moved = np.random.default_rng(4), 0
    for _ in range(8):
        tasks = [pk.ik.HandPosition("left", rng.uniform((0.28, 0.05, 0.80), (0.42, 0.30, 1.00)))]
        checks = checks_of(TABLE, balance=0.01, payload=payload)
        goals = clear_goals(checks, STAND, tasks, None, MARGIN, 0, 5.0).goals
        inside = [
            checks.statics.distance_inside(q) for q in goals
        ]  # the zero-moment point of a robot at rest
        assert (np.diff(inside) <= 1e-9).all()
        moved += np.ptp(inside) > 0.005
    assert moved >= 4


def test_goals_with_a_load_can_be_held_with_it():
    point = (0.32, 0.25, 0.85)
    tasks = [pk.ik.HandPosition("left", point)]
    checks = checks_of(pk.Scene(), payload={"left": 0.3}, balance=0.0)
    found = clear_goals(checks, STAND, tasks, None, MARGIN, 1, 5.0)
    assert all(not checks.statics.violation(q, "goal") for q in found.goals)
    heavy = checks_of(pk.Scene(), payload={"left": 30.0})
    assert clear_goals(heavy, STAND, tasks, None, MARGIN, 1, 5.0) is None


def test_no_goals_from_a_start_in_collision():
    around = pk.Scene().add_box("box", (0.3, 0.3, 0.3), (0.0, 0.0, 0.9))
    tasks = [pk.ik.HandPosition("left", (0.32, 0.25, 0.85))]
    assert clear_goals(checks_of(around), STAND, tasks, None, MARGIN, 0, 5.0) is None
    plan = pk.plan(PEPPER, STAND, tasks, around)
    assert plan.status is pk.motion.PlanStatus.START_IN_COLLISION


def test_goals_nearer_than_the_margin_where_none_keeps_it():
    """The target is 9 cm above a board: what reaches it cannot keep 15 cm."""
    board = pk.Scene().add_box("board", (0.3, 0.3, 0.02), (0.40, 0.2, 0.76))
    tasks = [pk.ik.HandPosition("left", (0.34, 0.2, 0.86))]
    checks = checks_of(board)
    found = clear_goals(checks, STAND, tasks, None, 0.15, 0, 5.0)
    assert 1 <= len(found.goals) <= GOALS
    coal = pk.collision.CollisionChecker(PEPPER, board)
    assert not coal.in_collision(found.goals).any()
    assert pk.collision.CollisionChecker(PEPPER, board, 0.15).in_collision(found.goals).all()
    assert found.kept[0] < 0.15
    assert not pk.collision.CollisionChecker(PEPPER, board, found.kept[0]).in_collision(found.goals).all()


def test_hard_tasks_come_first_as_in_solve():
    point = (0.34, 0.2, 0.86)
    tasks = [pk.ik.HandPosition("left", point, hard=True), pk.ik.LookAt((1.0, 0.2, 0.86), tolerance=0.3)]
    found = clear_goals(checks_of(pk.Scene()), STAND, tasks, None, MARGIN, 0, 5.0)
    for q in found.goals:
        assert all(task.error(PEPPER, q) <= task.tolerance for task in tasks)
    assert found.ik.success
    assert found.ik.hard_met
