"""Other goals at the end of a path: lengths in closed form, walls whose free edges are known exactly."""

import numpy as np
import pytest

from pepper_kin.planners import Path, Problem, rejoin


def bent(problem: Problem) -> Path:
    """From the start straight up, then right to the first goal."""
    return Path(np.array([problem.start, [0.2, 0.5], problem.goals[0]]))


def test_a_path_ends_at_the_goal_that_is_nearest_from_a_way_point(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    goals = [[0.9, 0.5], [0.4, 0.7], [0.25, 0.7]]
    problem = Problem([0, 0], [1, 1], [0.2, 0.2], goals, machine_code(wall), resolution=0.01)
    path, goal = rejoin(problem, bent(problem), 0)
    direct = {k: np.hypot(*(np.array(goals[k]) - [0.2, 0.2])) for k in (1, 2)}
    best = min(direct, key=direct.__getitem__)
    assert goal == best
    np.testing.assert_array_equal(path.points, [[0.2, 0.2], goals[best]])
    assert path.length == pytest.approx(direct[best])


def test_what_stands_in_the_way_is_gone_round(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    """From the start the wall hides the second goal; from the waypoint before the gap it does not."""
    goals = [[0.9, 0.9], [0.6, 0.5]]
    problem = Problem([0, 0], [1, 1], [0.2, 0.2], goals, machine_code(wall), resolution=0.01)
    path = Path(np.array([[0.2, 0.2], [0.2, 0.5], [0.6, 0.52], [0.9, 0.9]]))
    shorter, goal = rejoin(problem, path, 0)
    assert goal == 1
    np.testing.assert_array_equal(shorter.points, [[0.2, 0.2], [0.2, 0.5], goals[1]])
    assert wall.path_free(shorter.points)
    assert not wall.edge_free(problem.start, problem.goals[1])


def test_a_path_stays_where_nothing_is_saved(closed_wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    for others, gain in ([[[0.9, 0.2]], 0.01], [[[0.2, 0.9]], 0.01], [[[0.2, 0.45]], 0.99]):
        goals = [[0.4, 0.5], *others]  # behind the wall; farther than the path's own; not by so much nearer
        problem = Problem([0, 0], [1, 1], [0.2, 0.2], goals, machine_code(closed_wall), resolution=0.01)
        path = bent(problem)
        assert rejoin(problem, path, 0, gain=gain) == (path, 0)


def test_one_goal_leaves_a_path_alone_and_a_callable_does_what_machine_code_does(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = Problem([0, 0], [1, 1], [0.2, 0.2], [[0.4, 0.5]], machine_code(wall), resolution=0.01)
    path = bent(problem)
    assert rejoin(problem, path, 0) == (path, 0)
    goals = [[0.4, 0.5], [0.2, 0.25]]
    for validity in (machine_code(wall), wall.free):
        problem = Problem([0, 0], [1, 1], [0.2, 0.2], goals, validity, resolution=0.01)
        shorter, goal = rejoin(problem, bent(problem), 0)
        assert goal == 1
        np.testing.assert_array_equal(shorter.points, [[0.2, 0.2], [0.2, 0.25]])
