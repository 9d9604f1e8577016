"""Whether a robot that brakes stays clear of everything on its way."""

from __future__ import annotations

import numpy as np

from pepper_kin.core.near_state import NearState, NearWorld, come_nearer, moved, near_at
from pepper_kin.core.velocity_dampers import PairTable, RangeTable, clear_rows, entered_range
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2

NOTHING, UNKNOWN, EVERYTHING, OBSTACLE = -1, -2, 0, 1
"""What is in the way: nothing, what a call-back failed to tell, what cannot be named, or OBSTACLE + k, with k
the curve of a range or, from the number of curves on, a pair."""

FARTHEST = 0.08
MAX_QUERIES = 4
"""How far bodies are looked for [m], and how often one brake path is looked at again."""

STEP_OF_NEAR = 0.75
DEEPER = 1e-4
"""Pairs nearer than what is kept keep this share of their distance; those that touch may be found so much
deeper [m]."""


@compiled
def _floor(distance: float) -> float:
    """Return how near a pair may come that is near already [m]."""
    return STEP_OF_NEAR * distance if distance > 0.0 else distance - DEEPER


@compiled
def _write_floors(world: NearWorld, near: NearState, close: int, at: NearState, hard: float) -> Floats1:
    """Return how near each pair of a state may come, shape (k,) [m].

    Args:
        world: The pairs.
        near: Those near at the beginning, the nearest first: the least of equal owners counts.
        close: How many of them are nearer than what is kept at the least.
        at: The state.
        hard: What all others keep [m].
    """
    least = np.full(at.indices.size, hard)
    for k in range(at.indices.size):
        owner = world.owners[at.indices[k]]
        for i in range(close):
            if world.owners[near.indices[i]] == owner:
                least[k] = _floor(near.distances[i])
                break
    return least


@compiled
def obstacle(
    world: NearWorld, ranges: RangeTable, q: Floats1, shifts: Floats2, near: NearState, hard: float,
    joints: Flags1,
) -> int:  # fmt: skip
    """Find what a brake path runs into.

    Most pairs are shown to stay apart all the way by how far the joints can move them, see `clear_rows`;
    those of which this says nothing are measured at every tick of the way.  No pair may come nearer than
    `hard`, or than 3/4 of its distance at q if that is less; pairs that touch at q may part, and else not go
    deeper.

    Args:
        world: The pairs.
        ranges: Joint ranges that stand for pairs of neighbors.
        q: Where it begins, shape (n,) [rad or m].
        shifts: Positions along it, tick by tick, from there on, the first zero, shape (m, n) [rad or m].
        near: The pairs that are near at q.
        hard: What pairs keep [m].
        joints: Written: which joints would have to brake for it, shape (n,).

    Returns:
        See NOTHING, ....
    """
    joints[:] = True
    entered = entered_range(ranges, q, shifts)
    if entered >= 0:
        joints[:] = False
        joints[int(ranges.heads[entered, 0])] = joints[int(ranges.heads[entered, 1])] = True
        return OBSTACLE + entered
    close, tick, end, at = 0, 0, shifts.shape[0] - 1, near
    while close < near.distances.size and near.distances[close] <= hard / STEP_OF_NEAR:
        close += 1
    for _ in range(MAX_QUERIES):
        least = _write_floors(world, near, close, at, hard)
        doubts, table = np.empty(at.indices.size, dtype=np.bool_), at.table
        spare = np.empty(least.size)
        for k in range(least.size):
            spare[k] = at.distances[k] - least[k]
        pairs = PairTable(table.gradients, table.movers, table.cores, table.motion_bounds, spare)
        clear = clear_rows(shifts, tick, pairs, at.within - hard, doubts)
        # So far no pair that was not seen can have come too near.
        if clear < 1:
            return EVERYTHING
        hit = _first_hit(world, q, shifts[tick + 1 : tick + clear + 1], (at, least, doubts), joints)
        if hit != NOTHING:
            return hit if hit == UNKNOWN else OBSTACLE + ranges.heads.shape[0] + hit
        tick += clear
        if tick >= end:
            return NOTHING
        at = near_at(world, moved(q, shifts[tick]), FARTHEST)
        if not at.known:
            return UNKNOWN
    return EVERYTHING


@compiled
def _first_hit(
    world: NearWorld,
    q: Floats1,
    shifts: Floats2,
    doubtful: tuple[NearState, Floats1, Flags1],
    joints: Flags1,
) -> int:
    """Measure pairs in doubt along a path; return the nearest that comes too near, or NOTHING or UNKNOWN.

    Args:
        world: The pairs.
        q: Where the path begins, shape (n,) [rad or m].
        shifts: Positions along it, shape (m, n) [rad or m].
        doubtful: A state, what its pairs keep, shape (k,) [m], and which of them are in doubt, shape (k,).
        joints: Written where one comes too near: the joints that move those, shape (n,).
    """
    at, least, doubts = doubtful
    count = 0
    chosen, kept = np.empty(doubts.size, dtype=np.int64), np.empty(doubts.size)
    places = np.empty(doubts.size, dtype=np.int64)
    for k in range(doubts.size):
        if doubts[k]:
            chosen[count], kept[count], places[count] = at.indices[k], least[k], k
            count += 1
    if count == 0:
        return NOTHING
    nearer = np.empty(count, dtype=np.bool_)
    if not come_nearer(world, q, shifts, chosen[:count], kept, nearer):
        return UNKNOWN
    first = NOTHING
    for k in range(count):
        if nearer[k]:
            if first == NOTHING:
                first = chosen[k]
                joints[:] = False
            for i in range(joints.size):
                joints[i] |= at.table.movers[places[k], i]
    return int(first)
