"""Goals of a path from IK tasks: many solutions found at once in machine code, of which the clear ones stay."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.ik import IKResult, Task, TaskGroup, solve
from pepper_kin.ik.problem import flatten_tasks, movable_joints
from pepper_kin.model.shapes import read_only
from pepper_kin.motion.checks import Checks

Array = NDArray[np.float64]

FURTHER = 3
"""Solutions of a goal's tasks besides the first."""

ROUNDS = (16, 48, 160, 512)
"""Starts of one round of inverse kinematics after the other."""

ROUNDS_FOR_MARGIN = 2
"""Rounds after which a solution nearer to something than the margin will do."""

MOST_CHECKED = 64
"""Solutions of a round that are examined, nearest first."""

APART = 0.1
"""Solutions that differ by less than this in every joint count as one [rad or m]."""

_SEEDS_APART = 104_729


def clear_goals(
    checks: Checks,
    start: Array,
    tasks: Sequence[Task | TaskGroup],
    joints: str | Sequence[str] | None,
    margin: float,
    seed: int,
    timeout: float,
) -> tuple[Array, IKResult] | None:
    """Return solutions of tasks that touch nothing and can be held; None where none was found this way.

    Solutions from starts ever farther away are examined together.  Those with the margin to the scene are
    preferred to nearer ones without.

    Args:
        checks: The robot in its scene, compiled.
        start: Where the motion starts, shape (n,).
        tasks: Tasks that the fast solver knows.
        joints: Joints that may move: a group or names; None for all.
        margin: Distance to the scene that is preferred [m].
        seed: Draws the starts.
        timeout: Time budget [s]; it is looked at between rounds.

    Returns:
        Goals, shape (m, n), m of 1 to 4, the best first, and the result of inverse kinematics for that one.
    """
    from pepper_kin.ik.fast import alternatives

    begin = time.perf_counter()
    pepper = checks.pepper
    first = solve(pepper, tasks, start, seed=seed, joints=joints, timeout=timeout)
    if not first.success:
        return None
    parts = tuple(flatten_tasks(pepper, tasks))
    movable = None if joints is None else movable_joints(pepper, joints)
    spent = first.restarts
    spare = np.empty((0, pepper.n))  # clear, but for the margin
    for number, count in enumerate(ROUNDS):
        more = alternatives(pepper, parts, start, movable, seed + _SEEDS_APART * number, count, 150)
        spent += count
        candidates = np.array([first.q, *more] if number == 0 else more).reshape(-1, pepper.n)[:MOST_CHECKED]
        candidates = candidates[checks.holds(candidates)]
        good = different(candidates[checks.free(candidates, margin)], 1 + FURTHER)
        if not len(good):
            spare = np.concatenate([spare, candidates[checks.free(candidates)]])
            if number + 1 >= ROUNDS_FOR_MARGIN:
                good = different(spare, 1 + FURTHER)
        if len(good):
            scene = checks.exact.scene
            evidence = replace(first.evidence, scene=scene, q=read_only(good[0].copy()))  # type: ignore[type-var]
            elapsed = time.perf_counter() - begin
            return good, replace(first, q=evidence.q, evidence=evidence, restarts=spent, time=elapsed)
        if time.perf_counter() - begin > timeout:
            break
    return None


def different(solutions: Array, count: int) -> Array:
    """Return the first solutions that differ from one another, shape (m, n), m at most `count`."""
    kept: list[int] = []
    for k, q in enumerate(solutions):
        if all(np.abs(q - solutions[other]).max() >= APART for other in kept):
            kept.append(k)
            if len(kept) == count:
                break
    return solutions[kept]
