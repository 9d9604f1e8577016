import re
import time

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Problem, Roadmap, Status
from pepper_kin.planners.roadmap import EDGES


@pytest.fixture
def maze_problem(maze, machine_code) -> Problem:  # type: ignore[no-untyped-def]
    code = machine_code(maze, 0.007)
    return Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.95], code, resolution=0.014)


def free_pairs(problem: Problem, count: int) -> np.ndarray:
    rng = np.random.default_rng(5)
    states = rng.random((20 * count, problem.n))
    return states[problem.validity(states)][: 2 * count].reshape(count, 2, problem.n)


def test_many_queries_in_a_maze(maze, maze_problem) -> None:  # type: ignore[no-untyped-def]
    roadmap = Roadmap(maze_problem)
    for start, goal in free_pairs(maze_problem, 60):
        result = roadmap.solve(start, goal, timeout=60.0)
        assert result.status is Status.SOLVED
        assert np.array_equal(result.path.points[[0, -1]], [start, goal])
        assert maze.path_free(result.path.points)
        assert result.cost == result.path.length
    asked = roadmap.edges_checked
    again = roadmap.solve(start, goal, timeout=60.0)
    assert again.cost == result.cost
    assert again.iterations == 0
    assert roadmap.edges_checked == asked  # all that was needed is known


def test_balls_in_six_dimensions(balls, machine_code) -> None:  # type: ignore[no-untyped-def]
    world, resolution = balls(6), 0.02
    code = machine_code(world, resolution / 2.0)
    weights = np.array([1.0, 2.0, 1.0, 0.5, 1.0, 1.5])
    problem = Problem(np.zeros(6), np.ones(6), np.full(6, 0.1), np.full(6, 0.9), code, weights, resolution)
    roadmap = Roadmap(problem)
    for start, goal in ((problem.start, problem.goals), *free_pairs(problem, 20)):
        result = roadmap.solve(start, goal, timeout=60.0)
        assert result.success
        assert np.all(world.free(result.path.resample(0.001).points))
        assert result.cost == pytest.approx(
            np.linalg.norm(np.diff(result.path.points, axis=0) * weights, axis=1).sum()
        )


def test_path_is_the_shortest_on_the_graph(discs, machine_code) -> None:  # type: ignore[no-untyped-def]
    """Against Dijkstra's method on the same graph, with edges checked by the exact test beforehand."""
    problem = Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.9], machine_code(discs, 0.001), resolution=0.002)
    roadmap = Roadmap(problem)
    roadmap.grow(150, timeout=60.0)
    result = roadmap.solve(timeout=60.0)
    graph, count = roadmap._graph, roadmap.nodes
    grown = type(discs)(centers=discs.centers, radii=discs.radii + 0.001)
    states = graph.states[:count]
    costs = np.full(count, np.inf)
    start = int(np.argmin(np.linalg.norm(states - problem.start, axis=1)))
    goal = int(np.argmin(np.linalg.norm(states - problem.goals[0], axis=1)))
    costs[start] = 0.0
    ends = graph.arcs[0, : 2 * graph.counters[EDGES]].reshape(-1, 2)
    edges = [(b, a) for a, b in ends if grown.edge_free(states[a], states[b])]
    lengths = [float(np.linalg.norm(states[a] - states[b])) for a, b in edges]
    for _ in range(count):  # relaxation until nothing changes
        before = costs.copy()
        for (a, b), length in zip(edges, lengths, strict=True):
            costs[a], costs[b] = min(costs[a], costs[b] + length), min(costs[b], costs[a] + length)
        if np.array_equal(before, costs):
            break
    assert result.cost == pytest.approx(costs[goal], rel=1e-12)


def test_more_nodes_shorter_paths(toy) -> None:  # type: ignore[no-untyped-def]
    """Around a box whose shortest path is known; the gap closes as the roadmap grows."""
    world = toy.world([[0.3, -1.0]], [[0.7, 0.8]])
    problem = Problem([0, 0], [1, 1], [0.1, 0.2], [0.9, 0.2], toy.code(world), resolution=0.002)
    shortest = 2 * np.hypot(0.2, 0.6) + 0.4
    roadmap = Roadmap(problem)
    costs = []
    for nodes in (100, 900, 4000):
        assert roadmap.grow(nodes, timeout=60.0) == nodes
        costs.append(roadmap.solve(timeout=60.0).cost)
    assert np.all(np.diff(costs) <= 0.0)
    assert 0.999 * shortest < costs[-1] < 1.03 * shortest
    assert costs[-1] < costs[0]
    assert roadmap.edges > 5000


def test_several_goals(maze_problem) -> None:  # type: ignore[no-untyped-def]
    roadmap = Roadmap(maze_problem)
    roadmap.grow(2000, timeout=60.0)
    goals = [[0.4, 0.5], [0.5, 0.95], [0.1, 0.5]]  # in a wall; far; near
    result = roadmap.solve([0.05, 0.05], goals, timeout=60.0)
    assert result.goal_index == 2
    assert result.cost == pytest.approx(np.hypot(0.05, 0.45))


def test_same_queries_same_answers(maze_problem) -> None:  # type: ignore[no-untyped-def]
    pairs = free_pairs(maze_problem, 5)
    runs = []
    for seed in (1, 1, 2):
        roadmap = Roadmap(maze_problem, seed=seed)
        runs.append([roadmap.solve(*pair, timeout=60.0).path.points for pair in pairs])
    assert all(np.array_equal(a, b) for a, b in zip(runs[0], runs[1], strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(runs[0], runs[2], strict=True))


def test_callable_gives_the_same_as_machine_code(maze_problem) -> None:  # type: ignore[no-untyped-def]
    code = maze_problem.validity
    called = Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.95], lambda x: code(x), resolution=0.014)
    results = [Roadmap(p).solve(timeout=60.0) for p in (maze_problem, called)]
    assert np.array_equal(results[0].path.points, results[1].path.points)
    assert results[0].states_checked <= results[1].states_checked  # in batches


def test_callable_that_fails_leaves_no_wrong_findings(maze) -> None:  # type: ignore[no-untyped-def]
    broken = [False]

    def checker(states: np.ndarray) -> np.ndarray:
        if broken[0] and len(states) > 2:
            raise ZeroDivisionError("in the oracle")
        return maze.padded(0.007)(states)

    problem = Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.95], checker, resolution=0.014)
    roadmap = Roadmap(problem)
    roadmap.grow(400, timeout=60.0)
    broken[0] = True
    with pytest.raises(ZeroDivisionError, match="in the oracle"):
        roadmap.solve(timeout=60.0)
    broken[0] = False
    assert roadmap.solve(timeout=60.0).success
    assert roadmap.nodes < 500


def test_statuses(closed_wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = Problem([0, 0], [1, 1], [0.1, 0.1], [0.9, 0.1], machine_code(closed_wall, 0.005))
    roadmap = Roadmap(problem)
    assert roadmap.solve([0.5, 0.5]).status is Status.START_INVALID
    assert roadmap.solve([0.1, 0.1], [[0.5, 0.5], [0.46, 0.1]]).status is Status.GOAL_INVALID
    tired = roadmap.solve(timeout=60.0, max_nodes=1000)
    assert tired.status is Status.OUT_OF_ITERATIONS
    assert roadmap.nodes == 1000
    begun, spent = time.perf_counter(), time.thread_time()
    late = roadmap.solve(timeout=0.1, max_nodes=10**7)
    assert late.status is Status.NO_PATH_IN_TIME
    assert 0.1 <= late.time <= time.perf_counter() - begun
    assert time.thread_time() - spent < 1.2  # of its own; others may keep it waiting
    assert late.path is None
    assert late.cost == np.inf


def test_start_is_goal(maze_problem) -> None:  # type: ignore[no-untyped-def]
    result = Roadmap(maze_problem).solve([0.05, 0.05], [0.05, 0.05])
    assert result.success
    assert result.cost == 0.0


def test_misuse_is_named(maze_problem) -> None:
    for call, message in [
        (lambda p: Roadmap(p, seed=-1), "seed: got -1"),
        (lambda p: Roadmap(p, resolution=0), "resolution: got 0, expected a finite number above 0"),
        (lambda p: Roadmap(p).grow(-1), "nodes: got -1, expected an integer >= 0"),
        (lambda p: Roadmap(p).solve([0, 2]), "start[1]: got 2.0, expected a value within the bounds [0, 1]"),
        (lambda p: Roadmap(p).solve([0, 0], [[0, 0], [0, 3]]), "goals[1][1]: got 3.0"),
        (lambda p: Roadmap(p).solve(goals=[[0, np.nan]]), "goals[0][1]: got nan"),
        (lambda p: Roadmap(p).solve(max_nodes=0.5), "max_nodes: got 0.5"),
        (
            lambda p: Roadmap(Problem([0, 0], [1, 1], [0, 0], lambda rng: None, p.validity)).solve(),
            "goals: got a sampler, expected goal states",
        ),
    ]:
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            call(maze_problem)
