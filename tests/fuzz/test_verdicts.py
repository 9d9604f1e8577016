"""Verdicts of the compiled check on states, batches and edges, against coal on the URDF's text.

Five robots among random boxes, balls, cylinders, capsules, convex meshes, clouds and half-spaces, with and
without margins, holding something or not.  What touches by `must` has to be a collision, what does not by
`may` has to be free (see `coal_world`).
"""

import coal_world as world
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.fast import fast_checker_for
from pepper_kin.motion.checks import Checks

MARGINS = ((0.0, 0.0), (0.013, 0.005), (0.05, 0.0))
STATES, EDGES, STEPS = 100, 5, 12
"""States of a scene that are checked one by one, and edges with their steps."""


def scenes(rng, robot, count):
    """Yield random scenes with a robot's world by coal and its compiled check, at random margins."""
    for number in range(count):
        scene = world.random_scene(rng, robot, int(rng.integers(0, 12)), holding=number % 3 == 2)
        margins = MARGINS[int(rng.integers(len(MARGINS)))]
        yield scene, margins, world.World(robot, scene, *margins)


@pytest.mark.parametrize("name", world.ROBOTS)
def test_verdicts_on_states_are_those_of_coal(name, amount, rng, tried):
    robot, asked, wrong = world.robot_of(name), 0, []
    for scene, margins, oracle in scenes(rng, robot, amount(1, 26, 2000)):
        q = world.random_states(rng, robot, STATES)
        checker = fast_checker_for(robot.model, scene, *margins)
        together = checker.in_collision(q)
        alone = np.array([bool(checker.in_collision(state)) for state in q[:10]])
        assert np.array_equal(together[:10], alone)
        for state, found in zip(q, together, strict=True):
            truth = oracle.verdict(state)
            asked += truth is not None
            if truth is not None and truth != found:
                wrong.append((name, margins, scene, state.tolist(), bool(found)))
    tried("verdicts on states", asked, wrong=len(wrong))
    assert not wrong, wrong[0]


@pytest.mark.parametrize("name", world.ROBOTS)
def test_verdicts_on_edges_are_those_of_their_states_by_coal(name, amount, rng, tried):
    """An edge is valid where nothing touches at any step and gravity is held, by Pinocchio's torques."""
    robot, asked, wrong = world.robot_of(name), 0, []
    effort = 0.95 * robot.model.effort_limits
    for scene, margins, oracle in scenes(rng, robot, amount(1, 14, 1000)):
        everything = np.arange(robot.model.n)
        validity = Checks(robot.model, scene).validity(robot.model.neutral(), everything, margins)
        for _ in range(EDGES):
            a, b = world.random_states(rng, robot, 2)
            b = a + (b - a) * rng.uniform(0.0, 0.3)
            states = np.array([a + (b - a) * j / STEPS for j in range(1, STEPS)] + [b])
            truths = [state_is_valid(oracle, robot, effort, state) for state in states]
            found = validity(states)
            asked += sum(truth is not None for truth in truths)
            pairs = zip(truths, found, strict=True)
            wrong += [(name, margins, scene, a, b) for t, f in pairs if t is not None and t != bool(f)]
            if any(truth is None for truth in truths) or not hasattr(validity, "address"):
                continue
            steps = last_valid(validity, a, b)
            asked += 1
            if (steps == STEPS) != all(truths):
                wrong.append((name, margins, scene, a, b, steps))
    tried("verdicts on edges", asked, wrong=len(wrong))
    assert not wrong, wrong[0]


def state_is_valid(oracle, robot, effort, state):
    """Return whether a state is valid; None where nothing is asked."""
    use = np.abs(robot.holding_torque(state)) - effort
    if (use > 1e-6 * effort + 1e-9).any():
        return False
    touches = oracle.verdict(state)
    if touches is None or (use > -1e-6 * effort - 1e-9).any():
        return False if touches else None
    return not touches


def last_valid(validity, a, b):
    """Return what the C function behind a validity answers on an edge."""
    import ctypes

    function = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 2, ctypes.c_int64, ctypes.c_void_p)(
        validity.address
    )
    memory = validity.fresh_memory()
    start, stop = np.ascontiguousarray(a), np.ascontiguousarray(b)
    return function(start.ctypes.data, stop.ctypes.data, STEPS, memory.ctypes.data)


def test_the_world_by_coal_tells_contact_from_none():
    """The oracle itself: a ball in the hand's place touches, and one a meter above the head does not."""
    robot = world.robot_of("pepper")
    q = robot.model.posture("Stand")
    hand = pk.kinematics.frame_pose(robot.model, q, "l_gripper")[:3, 3]
    assert world.World(robot, pk.Scene().add_sphere("ball", 0.05, hand)).verdict(q) is True
    assert world.World(robot, pk.Scene().add_sphere("ball", 0.05, (0, 0, 2.2))).verdict(q) is False
