"""Nearby pairs of bodies at one configuration after another.

A call-back measures the distances that machine code does not know: of meshes, clouds and overlapping cores.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.collision.distances import (
    CARRIER,
    MEETING,
    PLANE,
    SCRATCH,
    SLACK,
    NearPoints,
    NearTable,
    find_near,
    is_known,
    measure,
    slopes,
)
from pepper_kin.core.collision.scene_rows import KIND, PLACE, RADIUS, ROW
from pepper_kin.core.kinematic_tree import compose, place_joints
from pepper_kin.core.velocity_dampers import PairTable
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.interrupts import call_back
from pepper_kin.kernels.signatures import Flags1, Flags2, Floats1, Floats2, Ints1

ANSWER = 10
"""Size of an answer: a distance [m], the nearest points of both shapes [m], and the unit vector from the
second to the first, in the world."""

STATES, PAIRS = 0, 1
"""Indices in `OtherMeasures.counts`."""


class OtherMeasures(NamedTuple):
    """A call-back that measures pairs at configurations, and its input.

    Attributes:
        address: See `kernels.callback.Callback`; it reads the addresses of configurations of Pinocchio's
            model, of indices of pairs, and of its answers: ANSWER numbers for each pair, state after state.
        mail: Addresses for the call-back, shape (3,).
        counts: Numbers of states and pairs, shape (2,).
        within: Distance beyond which only distances are needed, without points, shape (1,) [m].
    """

    address: int
    mail: Ints1
    counts: Ints1
    within: Floats1


class NearWorld(NamedTuple):
    """Bodies and the m pairs that are compared, of a robot with n joints.

    Attributes:
        examined: Whether any pairs are compared; if not, `table` is empty.
        table: The shapes and pairs.
        memory: Memory for the results of all pairs.
        movers: Which joints move the bodies of each pair against one another, shape (m, n).
        cores: Length of the straight part of each pair, see `PairTable`, shape (m,) [m].
        owners: Index of the pair of owners that the two shapes belong to, shape (m,).
        to_world: Whether the second shape of each pair is fixed in the world, shape (m,).
        motion_bounds: Motion bound of each joint, see `PairTable`, shape (n,).
        full_map: E of q_full = E q + e, shape (n_full, n).
        full_offset: e, shape (n_full,).
        others: Call-back for distances that machine code does not know.
        places: Row in `seen` of each pair whose distance machine code never knows, else -1, shape (m,).
        seen: Last distance of each pair in `places`, inf while unknown, then its configuration,
            shape (u, 1 + n).
    """

    examined: bool
    table: NearTable
    memory: NearPoints
    movers: Flags2
    cores: Floats1
    owners: Ints1
    to_world: Flags1
    motion_bounds: Floats1
    full_map: Floats2
    full_offset: Floats1
    others: OtherMeasures
    places: Ints1
    seen: Floats2


class NearState(NamedTuple):
    """Pairs nearer than a distance at a configuration, the nearest first.

    Attributes:
        known: Whether the list is complete; if not, the call-back has failed.
        within: The distance [m].
        indices: Indices of the pairs, shape (k,).
        distances: Distances of the pairs, shape (k,) [m].
        table: Gradients, movers and cores of the pairs; its `spare` has the distances.
    """

    known: bool
    within: float
    indices: Ints1
    distances: Floats1
    table: PairTable


@compiled
def write_full(world: NearWorld, q: Floats1, full: Floats1) -> None:
    """Write the coordinates of Pinocchio's model, shape (n_full,), at q, shape (n,)."""
    for i in range(full.size):
        total = world.full_offset[i]
        for j in range(q.size):
            total += world.full_map[i, j] * q[j]
        full[i] = total


@compiled
def moved(q: Floats1, shift: Floats1) -> Floats1:
    """Return q + shift, shape (n,)."""
    place = np.empty(q.size)
    for i in range(q.size):
        place[i] = q[i] + shift[i]
    return place


@compiled
def _ask(others: OtherMeasures, states: Floats2, pairs: Ints1, within: float, answers: Floats1) -> bool:
    """Measure some pairs at some configurations by the call-back; return whether it succeeded.

    Args:
        others: The call-back.
        states: Configurations of Pinocchio's model, shape (m, n_full) [rad or m].
        pairs: Indices of the pairs, shape (k,).
        within: Nearest points and normals are only needed for pairs nearer than this [m].
        answers: Output, shape (m k ANSWER,).
    """
    others.counts[STATES], others.counts[PAIRS], others.within[0] = states.shape[0], pairs.size, within
    others.mail[0], others.mail[1] = states.ctypes.data, pairs.ctypes.data
    others.mail[2] = answers.ctypes.data
    return call_back(others.address) >= 0


@compiled
def _is_surely_far(world: NearWorld, pair: int, q: Floats1, within: float) -> bool:
    """Return whether motion bounds prove a pair to be farther than a distance [m] at q, shape (n,)."""
    place = world.places[pair]
    if place < 0:
        return False
    distance = world.seen[place, 0]
    if not math.isfinite(distance):
        return False
    for i in range(q.size):
        if world.movers[pair, i]:
            distance -= world.motion_bounds[i] * abs(q[i] - world.seen[place, 1 + i])
    return bool(distance > within + SLACK)


@compiled
def _complete(
    world: NearWorld, q: Floats1, states: Floats2, within: float, found: int, undecided: int
) -> int:
    """Append the undecided pairs that are near; return the total number, -1 if the call-back failed.

    Args:
        world: The pairs; its memory has the pairs found so far.
        q: Configuration, shape (n,) [rad or m].
        states: Configuration of Pinocchio's model, shape (1, n_full).
        within: The distance [m].
        found: Number of pairs found so far.
        undecided: Number of undecided pairs.
    """
    near, asked = world.memory, 0
    for k in range(undecided):
        if not _is_surely_far(world, near.undecided[k], q, within):
            near.undecided[asked] = near.undecided[k]
            asked += 1
    answers = np.empty(ANSWER * asked)
    if asked > 0 and not _ask(world.others, states, near.undecided[:asked], within, answers):
        return -1
    for k in range(asked):
        own, place = answers[ANSWER * k : ANSWER * (k + 1)], world.places[near.undecided[k]]
        if place >= 0:
            world.seen[place, 0], world.seen[place, 1:] = own[0], q
        if own[0] < within:
            near.found[found], near.distances[found] = near.undecided[k], own[0]
            for i in range(3):
                near.points[found, 0, i], near.points[found, 1, i] = own[1 + i], own[4 + i]
                near.normals[found, i] = own[7 + i]
            found += 1
    return found


@compiled
def nearest_first(found: Ints1, distances: Floats1, count: int) -> Ints1:
    """Return the order of the first `count` pairs by distance, then by index; arrays: shape (>= count,)."""
    order = np.empty(count, dtype=np.int64)
    for k in range(count):
        place = k
        while place > 0:
            before = order[place - 1]
            if distances[before] < distances[k] or (
                distances[before] == distances[k] and found[before] < found[k]
            ):
                break
            order[place] = before
            place -= 1
        order[place] = k
    return order


@compiled
def near_at(world: NearWorld, q: Floats1, within: float) -> NearState:
    """Return the pairs nearer than a distance [m] at q, shape (n,) [rad or m], with their gradients."""
    n, states = q.size, np.empty((1, world.full_offset.size))
    write_full(world, q, states[0])
    joints = world.table.joints.shape[0]
    poses, axes = np.empty((joints, 12)), np.empty((joints, 3))
    place_joints(world.table.joints, states[0], poses, axes)
    near = world.memory
    count, undecided = find_near(poses, world.table, within, True, near)
    if undecided > 0:
        count = _complete(world, q, states, within, count, undecided)
    size = max(count, 0)
    order = nearest_first(near.found, near.distances, size)
    indices, distances = np.empty(size, dtype=np.int64), np.empty(size)
    points, normals = np.empty((size, 2, 3)), np.empty((size, 3))
    movers, cores = np.empty((size, n), dtype=np.bool_), np.empty(size)
    for k in range(size):
        place = order[k]
        indices[k], distances[k] = near.found[place], near.distances[place]
        points[k, 0], points[k, 1] = near.points[place, 0], near.points[place, 1]
        normals[k] = near.normals[place]
        movers[k], cores[k] = world.movers[indices[k]], world.cores[indices[k]]
    full, gradients = np.empty((size, states.shape[1])), np.zeros((size, n))
    slopes(world.table, poses, axes, indices, points, normals, full)
    for k in range(size):
        for i in range(full.shape[1]):
            if full[k, i] != 0.0:
                for j in range(n):
                    gradients[k, j] += full[k, i] * world.full_map[i, j]
    table = PairTable(gradients, movers, cores, world.motion_bounds, distances)
    return NearState(count >= 0, within, indices, distances, table)


@compiled
def _place(world: NearWorld, poses: Floats2, shape: int, pose: Floats1) -> None:
    """Write the world pose, shape (12,), of a shape's core, given the joints' poses, shape (njoints, 12)."""
    row = world.table.shapes[shape]
    compose(poses[int(row[CARRIER])], row[PLACE:ROW], pose)


@compiled
def come_nearer(
    world: NearWorld, q: Floats1, shifts: Floats2, chosen: Ints1, least: Floats1, nearer: Flags1
) -> bool:
    """Write which of some pairs come nearer than allowed at any configuration of a path.

    Args:
        world: The pairs.
        q: Start configuration, shape (n,) [rad or m].
        shifts: Displacements from q along the path, shape (m, n) [rad or m].
        chosen: Indices of the pairs, shape (k,).
        least: Distance that each pair has to keep, shape (k,) [m].
        nearer: Output, shape (k,).

    Returns:
        False if the call-back failed.
    """
    table, count = world.table, chosen.size
    states, joints = np.empty((shifts.shape[0], world.full_offset.size)), table.joints.shape[0]
    poses, axes = np.empty((joints, 12)), np.empty((joints, 3))
    pose, other, near, scratch = np.empty(12), np.empty(12), np.empty((3, 3)), np.empty(SCRATCH)
    unknown = np.zeros(count, dtype=np.bool_)
    nearer[:count] = False
    for row in range(shifts.shape[0]):
        write_full(world, moved(q, shifts[row]), states[row])
        place_joints(table.joints, states[row], poses, axes)
        for k in range(count):
            if nearer[k] or unknown[k]:
                continue
            a, b = table.pairs[chosen[k], 0], table.pairs[chosen[k], 1]
            first, second = table.shapes[a], table.shapes[b]
            if not (is_known(first) and is_known(second)):
                unknown[k] = True
                continue
            _place(world, poses, a, pose)
            _place(world, poses, b, other)
            radii = first[RADIUS] + second[RADIUS]
            far = max(least[k] + radii, 0.0)
            gap = measure(first, pose, second, other, table.vertices, far, near, scratch)
            if gap < MEETING and second[KIND] != PLANE:
                unknown[k] = True
            else:
                nearer[k] = gap - radii < least[k]
    rest, places, size = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64), 0
    for k in range(count):
        if unknown[k]:
            rest[size], places[size] = chosen[k], k
            size += 1
    if size == 0:
        return True
    answers = np.empty(ANSWER * size * states.shape[0])
    if not _ask(world.others, states, rest[:size], -math.inf, answers):
        return False
    for row in range(states.shape[0]):
        for i in range(size):
            if answers[ANSWER * (row * size + i)] < least[places[i]]:
                nearer[places[i]] = True
    return True
