"""Several solutions of one problem, such as alternative goals of a planner."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.loads import loads_of
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast import alternatives
from pepper_kin.ik.priorities import equally_weighted
from pepper_kin.ik.problem import flatten_tasks, movable_joints
from pepper_kin.ik.solve import checked_scene, checked_start, turns_left_out
from pepper_kin.ik.standing import rests
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.task import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_seed, check_whole
from pepper_kin.model.requirements import Balance

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

APART = 0.1
"""Minimum difference of two solutions in at least one joint [rad or m]."""

CHUNK = 8
MOST_STARTS = 1_000_000
"""Maximum number of starts; `CHUNK` is the number of configurations checked for collision in one call."""


def solutions(
    pepper: PepperModel,
    tasks: Task | TaskGroup | Iterable[Task | TaskGroup],
    start: ArrayLike | None = None,
    *,
    count: int = 8,
    scene: Scene | None = None,
    collisions: bool = True,
    margin: float = 0.0,
    balance: Balance = "robot",
    payload: Mapping[str, float] | None = None,
    seed: int = 0,
    joints: str | Sequence[str] | None = None,
    starts: int = 64,
    max_iterations: int = 150,
) -> Array:
    """Return different joint positions that fulfill tasks: those that can be held first, nearest first.

    The fast solver searches from configurations ever farther from the start. Solutions in collision are moved
    clear if a descent succeeds. The same arguments give the same solutions. For the best solution, or the
    reason of a failure, call `solve`.

    Args:
        pepper: The robot.
        tasks: Tasks to fulfill.
        start: Joint positions to which solutions are near [rad or m], shape (n,); `pepper.neutral()` if None.
        count: Maximum number of solutions.
        scene: Obstacles around the robot; None for none. Self-collision is checked with or without a scene.
        collisions: Whether collisions are checked.
        margin: Minimum distance to the scene [m].
        balance: Minimum distance of the center of mass from the edges of the wheels' triangle [m], see
            `solve`: solutions that keep it come first.
        payload: Point masses at "left", "right" or a frame by name [kg], see `solve`.
        seed: Seed of the starts.
        joints: Joints that may move, by names of joints and groups; the others keep their positions.
            None for all.
        starts: Number of starts.
        max_iterations: Maximum number of steps from each start.

    Returns:
        Joint positions [rad or m], shape (m, n) with m <= count, read-only; any two differ by 0.1 or more in
        some joint. No rows without a solution.

    Raises:
        InvalidValueError: for no task, or numbers that are malformed, NaN or infinite.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a start outside the joint limits.
    """
    parts = flatten_tasks(pepper, tasks)
    q0 = checked_start(pepper, start)
    turns = turns_left_out(pepper, parts, q0)
    q0 = q0 - turns
    movable = None if joints is None else movable_joints(pepper, joints)
    world, apart = checked_scene(scene, collisions, margin)
    around = Collisions(pepper, world, apart, loads_of(pepper, world, payload))
    parts = with_loads(parts, around.loads)
    wanted, tried = check_whole("count", count, 1), check_whole("starts", starts, 1, MOST_STARTS)
    steps = check_whole("max_iterations", max_iterations, 1)
    drawn = check_seed(seed)
    found = alternatives(pepper, equally_weighted(parts), q0, movable, drawn, tried, steps, around=around)
    kept: list[Array] = []
    for q in _clear_ones(found, around, checked_balance(pepper, balance)):
        if all(np.abs(q - other).max() >= APART for other in kept):
            kept.append(q)
        if len(kept) == wanted:
            break
    return read_only(np.array(kept).reshape(-1, pepper.n) + turns)


def _clear_ones(solutions: list[Array], collisions: Collisions, balance: float | None) -> Iterator[Array]:
    """Yield the collision-free solutions, shape (n,) [rad or m], first those that can be held."""
    if not solutions:
        return
    q = np.array(solutions)
    held = rests(collisions.pepper, q, balance, collisions.loads)
    for part in (q[held], q[~held]):
        for begin in range(0, len(part), CHUNK):
            chunk = part[begin : begin + CHUNK]
            yield from chunk[collisions.free_many(chunk)]
