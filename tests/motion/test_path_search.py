"""The whole way from problem to curve in one call: paths as of the planner alone, answers as of coal."""

import gc
import weakref

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.collision import CollisionChecker
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.kinematics import frame_pose
from pepper_kin.motion import path_search
from pepper_kin.motion.checks import LEAST_MARGIN, Checks
from pepper_kin.motion.goals import ends_of
from pepper_kin.motion.path_search import PathSearch
from pepper_kin.motion.plan_request import PlanOptions, PlanRequest
from pepper_kin.motion.plan_result import Plan
from pepper_kin.motion.planning import path_found
from pepper_kin.motion.problem import COARSE, path_problem
from pepper_kin.motion.static_limits import static_limits
from pepper_kin.planners import tree
from pepper_kin.planners.deadline import PausedClock, whole
from pepper_kin.trajectory.path import as_cubic_path

PEPPER = pk.load_pepper()
TABLE = pk.Scene().add_box("table", (0.6, 1.2, 0.04), (0.53, 0.0, 0.72))
ARM = np.array([PEPPER.joint_index(name) for name in PEPPER.joint_group("left_arm")])
LOW = PEPPER.joint_vector({"LShoulderPitch": 1.3, "LShoulderRoll": 0.2, "LElbowRoll": -0.3})
HIGH = PEPPER.joint_vector({"LShoulderPitch": 0.2, "LShoulderRoll": 0.2, "LElbowRoll": -0.5})


def path_problem_of_table():
    return path_problem(Checks(PEPPER, TABLE), LOW, HIGH[None], ARM, 0.01, COARSE)


def test_the_first_goal_is_preferred_with_balance_and_another_met_where_it_cannot_be():
    far, inside_the_table = HIGH.copy(), LOW.copy()
    far[ARM[0]], inside_the_table[ARM[0]] = -1.2, 0.7
    assert CollisionChecker(PEPPER, TABLE).in_collision(inside_the_table)
    for balance, first, met in ((0.01, far, {0}), (None, far, {0, 1}), (0.01, inside_the_table, {1})):
        checks = Checks(PEPPER, TABLE, static_limits(PEPPER, balance, None))
        problem = path_problem(checks, LOW, np.array([first, HIGH]), ARM, 0.01, COARSE)
        ways = [PathSearch(problem, seed, 5.0).searched(True) for seed in range(12)]
        assert {found.goal_index for found, _ in ways} == met
        for found, way in ways:
            np.testing.assert_array_equal(way.points[-1], (first, HIGH)[found.goal_index])


@pytest.mark.parametrize("nodes", [4096, 16])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_path_is_that_of_the_planner_alone_also_where_arrays_run_full(monkeypatch, nodes, seed):
    monkeypatch.setattr(path_search, "_NODES", nodes)
    monkeypatch.setattr(tree, "_FIRST_CAPACITY", nodes)
    monkeypatch.setattr(tree, "_left", type(tree._left)())
    monkeypatch.setattr(path_search, "_local", type(path_search._local)())
    alone = planners.rrt_connect(path_problem_of_table().search_problem, seed=seed)
    found, way = PathSearch(path_problem_of_table(), seed, 5.0).searched(False)
    np.testing.assert_array_equal(found.path.points, alone.path.points)
    assert (found.iterations, found.states_checked) == (alone.iterations, alone.states_checked)
    np.testing.assert_array_equal(way.points[[0, -1]], [LOW, HIGH])
    coal = CollisionChecker(PEPPER, TABLE)
    segments = np.arange(len(way.curve.breaks) - 1)
    for share in np.linspace(0.0, 1.0, 30):
        assert not coal.in_collision(way.curve.at(segments, share * np.diff(way.curve.breaks))).any()


def test_a_search_in_slices_is_the_same_whatever_is_computed_in_its_pauses():
    """Checks of the same robot in other scenes, at other margins, use this thread's tables meanwhile."""
    rng, paused, lower, upper = np.random.default_rng(2), 0, PEPPER.lower_limits, PEPPER.upper_limits
    other = pk.Scene().add_sphere("ball", 0.3, (0.4, 0.3, 0.9))
    for seed in range(40):
        low, high = rng.uniform(lower, upper, (2, PEPPER.n))
        low[:3] = high[:3] = 0.0
        options = PlanOptions(seed=seed, timeout=0.3)
        asked = PlanRequest(PEPPER, low, high, TABLE, options)
        request = asked.checked()
        ends = ends_of(request)
        if isinstance(ends, Plan):
            continue
        at_once = whole(path_found(request, ends))
        clock = PausedClock()
        slices = path_found(asked.checked(now=clock.now), ends, clock)
        while True:
            clock.resume(1e-6)
            try:
                next(slices)
            except StopIteration as end:
                found = end.value
                break
            clock.pause()
            paused += 1
            PathSearch(path_problem_of_table(), seed, 1.0).searched(False)
            pk.plan(PEPPER, low, high, other, timeout=0.01)
        assert (found.way is None) == (at_once.way is None)
        if found.way is not None:
            np.testing.assert_array_equal(found.way.points, at_once.way.points)
            assert found.states == at_once.states
    assert paused >= 5


def test_another_goal_ends_the_path_where_that_is_shorter():
    goals = np.array([HIGH, HIGH])
    goals[0, ARM[1]] += 0.6
    problem = path_problem(Checks(PEPPER, TABLE), LOW, goals, ARM, 0.01, COARSE)
    for seed in range(4):
        found, _ = PathSearch(problem, seed, 5.0).searched(True)
        alone = planners.rrt_connect(problem.search_problem, seed=seed)
        assert found.path.length <= alone.path.length + 1e-12
        end = problem.search_problem.goals[found.goal_index]
        np.testing.assert_array_equal(found.path.points[-1], end)
        validator = problem.search_problem.validator()
        for a, b in zip(found.path.points[:-1], found.path.points[1:], strict=True):
            steps = max(1, int(np.ceil(problem.metric.distance(a, b) / problem.resolution)))
            assert validator.last_valid_step(a, b, steps) == steps


def splines(count):
    rng = np.random.default_rng(5)
    for _ in range(count):
        points = np.tile(HIGH, (4, 1))
        points[:, ARM] += rng.uniform(-0.35, 0.35, (4, len(ARM)))
        yield as_cubic_path(PEPPER, np.clip(points, PEPPER.lower_limits + 0.05, PEPPER.upper_limits - 0.05))


def test_what_is_asked_of_coal_is_answered_as_machine_code_does():
    checks, coal = Checks(PEPPER, TABLE), Checks(PEPPER, TABLE)
    coal.compiled = coal.quick = False
    verdicts = []
    for curve in splines(6):
        clear = [is_clear_along(each, curve, (0.005, 0.001), motion=(HIGH, ARM)) for each in (checks, coal)]
        assert clear[0] == clear[1]
        verdicts.append(clear[0])
    assert 0 < sum(verdicts) < 6


def test_what_coal_raises_is_raised_and_keeps_nothing():
    checks = Checks(PEPPER, TABLE)
    checks.compiled = False

    def interrupted(*_):
        raise KeyboardInterrupt

    checks.answer, gone = interrupted, weakref.ref(checks)
    curve = next(splines(1))
    gc.disable()
    try:
        with pytest.raises(KeyboardInterrupt):
            is_clear_along(checks, curve, motion=(HIGH, ARM))
        del checks
        assert gone() is None
    finally:
        gc.enable()
    assert Checks(PEPPER, TABLE).margins(LOW, HIGH[None], ARM, 0.01)[0] > 0.0


def halved(scene):
    """The margins that coal says both ends keep."""

    def free(margin, self_margin):
        return not CollisionChecker(PEPPER, scene, margin, self_margin).in_collision([LOW, HIGH]).any()

    own = wide = 0.01
    while own > LEAST_MARGIN and not free(0.0, own):
        own /= 2
    own = own if own == 0.01 else own / 2 if own > LEAST_MARGIN else 0.0
    while wide > LEAST_MARGIN and not free(wide, own):
        wide /= 2
    return wide if wide > LEAST_MARGIN else 0.0, own


def test_margins_are_halved_until_coal_says_that_both_ends_keep_them():
    hand, found = frame_pose(PEPPER, HIGH, "l_gripper")[:3, 3], set()
    for height in np.linspace(0.03, 0.12, 40):
        scene = pk.Scene().add_sphere("near", 0.01, hand + np.array([0.0, 0.0, height]))
        kept = Checks(PEPPER, scene).margins(LOW, HIGH[None], ARM, 0.01)
        assert kept == halved(scene)
        found.add(kept[0])
    assert {0.0, 0.01} < found


@pytest.mark.parametrize("seconds", [1e-5, 3e-5, 1e-4, 3e-4, 60.0])
def test_a_way_does_not_depend_on_how_long_machine_code_runs_at_once(monkeypatch, seconds):
    goals = np.array([HIGH, HIGH])
    goals[0, ARM[1]] += 0.6
    problem = path_problem(Checks(PEPPER, TABLE), LOW, goals, ARM, 0.01, COARSE)
    usual = [PathSearch(problem, seed, 60.0).searched(True) for seed in range(6)]
    monkeypatch.setattr(planners.deadline, "TIME_SLICE", seconds)
    for seed, (found, way) in enumerate(usual):
        again, other = PathSearch(problem, seed, 60.0).searched(True)
        assert again.goal_index == found.goal_index
        np.testing.assert_array_equal(again.path.points, found.path.points)
        np.testing.assert_array_equal(other.points, way.points)
