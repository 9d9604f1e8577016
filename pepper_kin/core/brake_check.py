"""Collision check of the path along which a robot brakes."""

from __future__ import annotations

import numpy as np

from pepper_kin.core.near_state import NearState, NearWorld, come_nearer, moved, near_at
from pepper_kin.core.velocity_dampers import PairTable, RangeTable, clear_rows, entered_range
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2

NOTHING, UNKNOWN, EVERYTHING, OBSTACLE = -1, -2, 0, 1
"""Results of `obstacle`: nothing is in the way; a call-back failed; something that cannot be named is in the
way; or OBSTACLE + k with the index k of a joint-range curve or, from the number of curves on, of a pair."""

FARTHEST = 0.08
MAX_QUERIES = 4
"""Distance up to which pairs are searched for [m], and maximum number of searches along one braking path."""

STEP_OF_NEAR = 0.75
DEEPER = 1e-4
"""Pairs that are nearer than the required clearance keep this ratio of their distance at the start; touching
pairs may come out deeper by this tolerance [m]."""


@compiled
def _floor(distance: float) -> float:
    """Return the clearance [m] required of a pair whose distance at the start is below the usual one."""
    return STEP_OF_NEAR * distance if distance > 0.0 else distance - DEEPER


@compiled
def _write_floors(world: NearWorld, near: NearState, close: int, at: NearState, hard: float) -> Floats1:
    """Return the clearance that each pair of a state has to keep, shape (k,) [m].

    Args:
        world: All pairs.
        near: Pairs near the start state, the nearest first: of pairs of the same owner the nearest counts.
        close: How many of them are nearer than the usual clearance allows.
        at: The state whose pairs are listed.
        hard: Clearance that all other pairs keep [m].
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
    """Find what the robot would collide with along a braking path.

    Most pairs are shown to stay apart along the whole path by how far the joints can move them, see
    `clear_rows`; the pairs left in doubt are measured at every tick of the path.  No pair may come nearer
    than `hard`, or than 3/4 of its distance at q if that is less; pairs that touch at q may separate, but not
    penetrate deeper.

    Args:
        world: The pairs.
        ranges: Joint ranges that stand for pairs of neighbors.
        q: Start configuration, shape (n,) [rad or m].
        shifts: Displacements from q, tick by tick, the first zero, shape (m, n) [rad or m].
        near: Pairs that are near at q.
        hard: Clearance that pairs keep [m].
        joints: Output: joints that would have to brake to avoid the collision, shape (n,).

    Returns:
        NOTHING, UNKNOWN, EVERYTHING or OBSTACLE + k.
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
        # Up to this tick no pair outside the list can have come too near.
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
    """Measure doubtful pairs along a path; return the nearest that comes too near, or NOTHING or UNKNOWN.

    Args:
        world: All pairs.
        q: Start configuration, shape (n,) [rad or m].
        shifts: Displacements from q, shape (m, n) [rad or m].
        doubtful: A state, the clearance that each of its pairs keeps, shape (k,) [m], and whether the pair is
            in doubt, shape (k,).
        joints: Output where a pair comes too near: joints that move such pairs, shape (n,).
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
