"""Planners of OMPL through the same problem and result."""

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError, MissingDependencyError
from pepper_kin.planners import (
    OMPL_PLANNERS,
    Problem,
    Status,
    available_ompl_planners,
    ompl_plan,
    ompl_planner,
)

AVAILABLE = ("LBKPIECE", "BKPIECE", "KPIECE", "RRT", "RRTConnect", "RRTstar", "PRM", "PRMstar", "FMT", "BFMT")


def outside_a_ball(states):
    return np.linalg.norm(states, axis=1) > 0.5


def problem(**changes):
    given = dict(
        lower=[-1.0, -1.0, -1.0], upper=[1.0, 1.0, 1.0], start=[-0.9, -0.1, 0.0], goals=[0.9, 0.1, 0.0],
        validity=outside_a_ball, weights=[1.0, 2.0, 0.5], resolution=0.02,
    )  # fmt: skip
    return Problem(**given | changes)


def test_the_names_are_those_of_moveit_and_most_wheels_have_ten():
    assert len(OMPL_PLANNERS) == len(set(OMPL_PLANNERS)) == 24
    assert set(AVAILABLE) <= set(available_ompl_planners()) <= set(OMPL_PLANNERS)


@pytest.mark.thorough
@pytest.mark.parametrize("name", AVAILABLE)
def test_each_finds_a_way_round_the_ball(name):
    task = problem()
    result = ompl_plan(task, name, timeout=3.0 if name in ompl_planner.IMPROVING else 20.0)
    assert result.status is Status.SOLVED, str(result)
    np.testing.assert_array_equal(result.path.points[0], task.start)
    np.testing.assert_array_equal(result.path.points[-1], task.goals[0])
    assert result.cost == pytest.approx(result.path.length)
    fractions = np.linspace(0, 1, 400)[:, None]
    for a, b in zip(result.path.points, result.path.points[1:], strict=False):
        dense = a + fractions * (b - a)
        # OMPL checks at steps of the resolution: between them a straight line dips in by less than that.
        assert np.linalg.norm(dense, axis=1).min() > 0.5 - 0.02


def test_what_cannot_move_stays():
    task = problem(
        lower=[-1.0, -1.0, 0.3], upper=[1.0, 1.0, 0.3], start=[-0.9, -0.1, 0.3], goals=[0.9, 0.1, 0.3]
    )
    result = ompl_plan(task)
    assert result.success
    assert (result.path.points[:, 2] == 0.3).all()


def test_the_nearest_of_several_goals_is_named():
    goals = [[0.1, 0.0, 0.0], [0.9, 0.1, 0.0], [-0.9, 0.2, 0.0]]
    result = ompl_plan(problem(goals=goals))
    assert result.success
    assert result.goal_index in (1, 2)
    np.testing.assert_array_equal(result.path.points[-1], goals[result.goal_index])


@pytest.mark.parametrize("name", sorted(set(ompl_planner.TWO_THREADS) & set(AVAILABLE)))
def test_planners_with_a_second_thread_return_where_there_are_several_goals(child, name):
    """In a process that can be ended: they waited for ever, and no interrupt was heard."""
    script = (
        "import numpy as np; from pepper_kin.planners import Problem, ompl_plan;"
        "valid = lambda states: np.linalg.norm(states, axis=1) > 0.5;"
        "goals = [[0.1, 0.0, 0.0], [0.9, 0.1, 0.0], [-0.9, 0.9, 0.0]];"
        "task = Problem([-1.0] * 3, [1.0] * 3, [-0.9, -0.1, 0.0], goals, valid, resolution=0.02);"
        f"result = ompl_plan(task, {name!r}, timeout=0.6);"
        "print(result.status.name, result.goal_index, np.linalg.norm(result.path.points, axis=1).min() > 0.5)"
    )
    assert child(script).stdout.split() == ["SOLVED", "2", "True"]


def test_planners_that_ask_in_many_threads_are_refused_by_name():
    with pytest.raises(InvalidValueError, match=r"several threads.*expected one of .*RRTConnect"):
        ompl_plan(problem(), "AnytimePathShortening")
    assert "AnytimePathShortening" not in available_ompl_planners()


def test_statuses():
    assert ompl_plan(problem(start=[0.0, 0.0, 0.0])).status is Status.START_INVALID
    assert ompl_plan(problem(goals=[0.0, 0.0, 0.0])).status is Status.GOAL_INVALID

    def two_rooms(states):
        return np.abs(states[:, 0]) > 0.2

    result = ompl_plan(problem(validity=two_rooms), timeout=0.3)
    assert result.status is Status.NO_PATH_IN_TIME
    assert result.path is None
    assert result.time < 2.0


def test_misuse_is_named(monkeypatch):
    with pytest.raises(InvalidValueError, match="RRTConnect"):
        ompl_plan(problem(), "Dijkstra")
    known = (*available_ompl_planners(), *ompl_planner.MANY_THREADS)
    lacking = next(name for name in OMPL_PLANNERS if name not in known)
    with pytest.raises(InvalidValueError, match="lacks it"):
        ompl_plan(problem(), lacking)
    with pytest.raises(InvalidValueError, match="sampler"):
        ompl_plan(problem(goals=lambda rng: None))

    def missing():
        raise MissingDependencyError("ompl", "pip install 'pepper_kin[ompl]'", "ompl_plan")

    monkeypatch.setattr(ompl_planner, "_library", missing)
    with pytest.raises(MissingDependencyError, match="pip install"):
        ompl_plan(problem())
    assert available_ompl_planners() == ()
