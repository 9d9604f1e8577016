"""Solutions that touch nothing, picked from many that are found in machine code."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.search import Budget, torque_ratios
from pepper_kin.ik.tasks.task import Array, Task

# Starts of one round after the other; each round has starts of its own.
ROUNDS = (32, 96, 256, 512)

# So many configurations are checked in one call: as many as cost little where the first of them is free.
PIECE = 8


def find_clear(
    tasks: tuple[Task, ...], q0: Array, movable: np.ndarray | None, collisions: Collisions, budget: Budget
) -> tuple[Array, int] | None:
    """Return a solution that touches nothing and the starts spent on it; None where none was found.

    Of the solutions of one round the nearest to q0 is taken that the motors can hold or, where all that are
    free ask too much of them, the nearest of these.

    Args:
        tasks: The tasks.
        q0: Where the motion starts, within the limits, shape (n,).
        movable: Joints that may move, shape (n,); None for all.
        collisions: What may not touch.
        budget: Its restarts bound the first round, and further rounds follow only after a full one.
    """
    from pepper_kin.ik.fast import alternatives  # compiles the fast solver where that is not done yet

    spent = 0
    for number, count in enumerate(ROUNDS):
        count = min(count, budget.restarts) if number == 0 else count
        if count == 0 or time.perf_counter() > budget.deadline:
            break
        spent += count
        seed = budget.seed + 104_729 * number
        found = alternatives(collisions.pepper, tasks, q0, movable, seed, count, budget.max_iterations)
        for q in clear_ones(found, collisions):
            return q, spent
        if count < ROUNDS[0]:
            break
    return None


def clear_ones(solutions: list[Array], collisions: Collisions) -> Iterator[Array]:
    """Yield the solutions that touch nothing, those first that the motors can hold."""
    if not solutions:
        return
    q = np.array(solutions)
    held = np.array([torque_ratios(collisions.pepper, row).max() <= 1.0 for row in q])
    for part in (q[held], q[~held]):
        for begin in range(0, len(part), PIECE):
            piece = part[begin : begin + PIECE]
            yield from piece[collisions.free_many(piece)]
