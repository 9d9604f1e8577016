"""Rewards, observations and starts of episodes of many learning robots."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.random_numbers import GAMMA, mixed
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Floats3, Ints1, Singles2


class Score(NamedTuple):
    """Scores of N states against their goals.

    Attributes:
        distance: Maximum distance of a led point from its goal [m], shape (N,).
        cost: Additional cost, in meters of distance, shape (N,).
        success: Whether the goals are met, shape (N,).
        failed: Whether the episode has failed and ends, shape (N,).
    """

    distance: Floats1
    cost: Floats1
    success: Flags1
    failed: Flags1


class StepRules(NamedTuple):
    """Rules of rewards and of the end of episodes.

    Attributes:
        horizon: Maximum number of steps of an episode.
        lost: Penalty of a failure for each step that remains until the horizon.
        sparse: Whether the reward is 0 if the goals are met, else -1.
    """

    horizon: int
    lost: float
    sparse: bool


class StepOutcome(NamedTuple):
    """Output of a step: rewards and which episodes end, shape (N,) each."""

    rewards: Floats1
    terminated: Flags1
    truncated: Flags1


class Seen(NamedTuple):
    """Observed quantities of N robots.

    Attributes:
        position: Positions of all joints [rad or m], shape (N, n).
        velocity: Velocities of all joints [rad/s or m/s], shape (N, n).
        places: Positions of the led points [m], shape (N, g, 3).
        goals: Goals of the led points [m], shape (N, g, 3).
        extra: Additional observations, shape (N, e).
    """

    position: Floats2
    velocity: Floats2
    places: Floats3
    goals: Floats3
    extra: Floats2


@compiled("void(float64[:, :, ::1], float64[:, :, ::1], float64[::1])")
def greatest_distances(places: Floats3, goals: Floats3, distance: Floats1) -> None:
    """Write the maximum distance of each robot's points from their goals [m]: (N, g, 3) each, into (N,)."""
    for robot in range(len(distance)):
        most = 0.0
        for k in range(places.shape[1]):
            total = 0.0
            for i in range(3):
                gap = goals[robot, k, i] - places[robot, k, i]
                total += gap * gap
            most = max(most, total)
        distance[robot] = math.sqrt(most)


@compiled("void(Score, boolean[::1], boolean[::1], int64[::1], StepRules, StepOutcome)")
def end_step(
    score: Score, sound: Flags1, anew: Flags1, elapsed: Ints1, rules: StepRules, ends: StepOutcome
) -> None:
    """Write the rewards of a step, and which episodes it ends.

    Args:
        score: Scores at the end of the step; a failure in a step that starts an episode does not count.
        sound: Which robots are in a valid state, shape (N,); the episodes of the others are truncated.
        anew: Which episodes have just started, shape (N,).
        elapsed: Steps of the episodes so far, shape (N,).
        rules: Rules of rewards.
        ends: Output.
    """
    for robot in range(len(sound)):
        lost = score.failed[robot] and sound[robot] and not anew[robot]
        over = elapsed[robot] >= rules.horizon or not sound[robot]
        reward = -score.distance[robot] - score.cost[robot]
        if rules.sparse:
            reward = 0.0 if score.success[robot] else -1.0
        if lost:
            reward -= rules.lost * max(rules.horizon - elapsed[robot], 0)
        ends.rewards[robot] = 0.0 if anew[robot] else reward
        ends.terminated[robot] = lost
        ends.truncated[robot] = over and not anew[robot] and not lost


@compiled("void(Seen, float64[:, ::1], int64[::1], boolean, float32[:, ::1])")
def observe(seen: Seen, scales: Floats2, joints: Ints1, ways: bool, out: Singles2) -> None:
    """Write observations: positions and velocities of k joints, points, vectors to the goals, and extras.

    Args:
        seen: Observed quantities.
        scales: Position that maps to 0, half range that maps to 1, and velocity that maps to 1, shape (3, k).
        joints: Indices of the joints, shape (k,).
        ways: Whether the vectors from points to goals are observed.
        out: Output, shape (N, 2 k + 3 g (+ 3 g) + e).
    """
    count = joints.size
    for robot in range(len(out)):
        for k in range(count):
            j = joints[k]
            out[robot, k] = (seen.position[robot, j] - scales[0, k]) / scales[1, k]
            out[robot, count + k] = seen.velocity[robot, j] / scales[2, k]
        at = 2 * count
        for k in range(seen.places.shape[1]):
            for i in range(3):
                out[robot, at] = seen.places[robot, k, i]
                at += 1
        if ways:
            for k in range(seen.places.shape[1]):
                for i in range(3):
                    out[robot, at] = seen.goals[robot, k, i] - seen.places[robot, k, i]
                    at += 1
        for k in range(seen.extra.shape[1]):
            out[robot, at + k] = seen.extra[robot, k]


@compiled("void(int64[::1], int64[::1], int64[::1], float64[:, ::1], float64[:, ::1])")
def begin_episodes(rows: Ints1, keys: Ints1, counts: Ints1, bank: Floats2, episode: Floats2) -> None:
    """Draw the next episodes of some robots from a bank.

    Args:
        rows: Indices of the robots, shape (r,).
        keys: Keys of the robots' random streams, as integers of 64 bits, shape (N,).
        counts: Number of episodes that each robot has started, changed, shape (N,).
        bank: Episodes to draw from, shape (m, w).
        episode: Current episode of each robot, changed, shape (N, w).
    """
    for k in range(rows.size):
        robot = rows[k]
        number = mixed(mixed(np.uint64(keys[robot])) + np.uint64(counts[robot]) + GAMMA)
        chosen = np.int64(number % np.uint64(len(bank)))
        counts[robot] += 1
        for i in range(bank.shape[1]):
            episode[robot, i] = bank[chosen, i]
