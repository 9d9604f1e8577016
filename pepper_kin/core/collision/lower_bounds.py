"""Lower bounds of distances, compiled: part by part of the robot."""

from __future__ import annotations

import math
from typing import Any

from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.ball_check import (
    BALL_SINGLES,
    CORE_LANES,
    CORE_SINGLES,
    GROUP_WORDS,
    LINK_WORDS,
    OBJECT_SINGLES,
    RANGE_WORDS,
    SIDE_WORDS,
    Tables,
    core_distance,
    place_all,
    squared_distance,
    tables_of,
)
from pepper_kin.core.collision.layout import ROOM, Array, section, section_single
from pepper_kin.core.collision.narrow_phase import SOLID_SIZE, pair_distance, place_solids
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import (
    LANE_BYTES,
    LANES,
    lane_minimum,
    lane_sqrt,
    lanes_below,
    load_lanes,
    single_at,
    spread,
    store_lanes,
    word_at,
)

SMALL = 0.03
"""Bounds by balls below this are replaced by exact distances where there is a closed form [m]."""
FAR = 1e30
"""Where there is nothing to be near to [m]."""


@compiled(inline=True, lean=True)
def _less_reach(squared: Any, reach: float) -> Any:
    """Return d - R in lanes; -FAR where d is zero, since a core entered says nothing of how deep."""
    distance = lane_sqrt(squared)
    inside = lane_minimum(distance * 1e30 - 1.0, spread(0.0))  # -1 where the distance is zero
    return distance - reach + inside * FAR


@compiled(lean=True)
def _link_bound(t: Tables, k: int, least: Any) -> Any:
    """Return a bound in lanes, or the distance of a body's balls from another's cores where less."""
    words = t.links + 8 * LINK_WORDS * k
    first, second = word_at(words + 8), word_at(words + 24)
    place, other = t.centers + 3 * LANE_BYTES * first, t.centers + 3 * LANE_BYTES * second
    x, y, z = load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
    dx, dy, dz = x - load_lanes(other), y - load_lanes(other + 32), z - load_lanes(other + 64)
    wide = single_at(t.balls + 4 * BALL_SINGLES * first + 12)
    apart = (
        lane_sqrt(dx * dx + dy * dy + dz * dz) - wide - single_at(t.balls + 4 * BALL_SINGLES * second + 12)
    )
    if lanes_below(apart, least) == 0:
        return least
    for s in range(word_at(words + 48), word_at(words + 56)):
        side = t.sides + 8 * SIDE_WORDS * s
        e = word_at(side)
        core, room = t.cores + 4 * CORE_SINGLES * e, t.placed + CORE_LANES * LANE_BYTES * e
        apart = lane_sqrt(core_distance(core, room, x, y, z)) - wide - single_at(core + 4)
        if lanes_below(apart, least) == 0:
            continue
        for r in range(word_at(side + 8), word_at(side + 16)):
            pair = t.ranges + 8 * RANGE_WORDS * r
            for i in range(word_at(pair), word_at(pair + 8)):
                ball, place = t.balls + 4 * BALL_SINGLES * i, t.centers + 3 * LANE_BYTES * i
                squared = core_distance(
                    core, room, load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
                )
                least = lane_minimum(least, _less_reach(squared, single_at(ball + 12) + single_at(core + 4)))
    return least


@compiled(lean=True)
def _group_bound(t: Tables, g: int) -> Any:
    """Return in lanes how far the balls of a group are from the objects of its list."""
    words = t.groups + 8 * GROUP_WORDS * g
    coarse = word_at(words + 8)
    reach = single_at(t.balls + 4 * BALL_SINGLES * coarse + 12)
    place = t.centers + 3 * LANE_BYTES * coarse
    x, y, z = load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
    least = spread(FAR)
    for k in range(word_at(words + 32), word_at(words + 40)):
        item = t.objects + 4 * OBJECT_SINGLES * word_at(t.lists + 8 * k)
        radius = single_at(item + 4)
        apart = lane_sqrt(squared_distance(item, x, y, z)) - reach - radius
        if lanes_below(apart, least) == 0:
            continue
        for i in range(word_at(words + 16), word_at(words + 24)):
            ball, place = t.balls + 4 * BALL_SINGLES * i, t.centers + 3 * LANE_BYTES * i
            squared = squared_distance(
                item, load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
            )
            least = lane_minimum(least, _less_reach(squared, single_at(ball + 12) + radius))
    return least


@compiled
def _write(memory: Array, least: Any, bounds: Array, first: int, count: int, part: int) -> None:
    """Write the bounds of a part of the robot in all lanes."""
    room = section_single(memory, at.QUEUE)
    store_lanes(room.ctypes.data, least)
    for i in range(count):
        value = float(room[i])
        bounds[first + i, part] = math.inf if value >= FAR else (value if value > 0.0 else -math.inf)


@compiled
def _sharpen(memory: Array, bounds: Array, q: Array) -> None:
    """Raise those bounds of a configuration that are small, by exact distances."""
    numbers, solids, poses = (
        section(memory, at.NUMBERS),
        section(memory, at.SOLIDS),
        section(memory, at.SOLID_POSES),
    )
    first, pairs, members = (
        section(memory, at.PAIR_FIRST),
        section(memory, at.PAIRS),
        section(memory, at.GROUP_SOLIDS),
    )
    compared, objects = section(memory, at.GROUP_OBJECTS), int(numbers[at.OBJECT_COUNT])
    classes, groups = int(numbers[at.CLASS_COUNT]), int(numbers[at.GROUP_COUNT])
    if bounds.size == 0 or bounds.min() > SMALL:
        return
    place_solids(memory, q)
    for c in range(classes):
        if bounds[c] > SMALL:
            continue
        least = math.inf
        for k in range(int(first[c]), int(first[c + 1])):
            least = min(
                least, pair_distance(memory, solids, poses, int(pairs[2 * k]), int(pairs[2 * k + 1]), least)
            )
        bounds[c] = max(bounds[c], least)
    for g in range(groups):
        if bounds[classes + g] > SMALL:
            continue
        least = math.inf
        for k in range(members.size // 2):
            for o in range(objects):
                if int(members[2 * k]) == g and compared[o * groups + g] > 0:
                    b = solids.size // SOLID_SIZE - objects + o
                    least = min(
                        least, pair_distance(memory, solids, poses, int(members[2 * k + 1]), b, least)
                    )
        bounds[classes + g] = max(bounds[classes + g], least)


@compiled("void(float64[::1], float64[:, ::1], float64[:, ::1])")
def part_bounds(memory: Array, q: Array, bounds: Array) -> None:
    """Write lower bounds of the distance of each class of pairs and of each group to the scene [m].

    Args:
        memory: A block whose margins are zero and in which all joints are free.
        q: Configurations, shape (m, n).
        bounds: Written, shape (m, classes + groups).
    """
    coordinates, n = section_single(memory, at.COORDINATES), q.shape[1]
    for start in range(0, q.shape[0], ROOM):
        count = min(ROOM, q.shape[0] - start)
        t = tables_of(memory)
        for first in range(0, count, LANES):
            for i in range(LANES):
                for k in range(n):
                    coordinates[LANES * k + i] = q[start + min(first + i, count - 1), k]
            place_all(t)
            filled = min(LANES, count - first)
            for c in range(t.class_count):
                least = spread(FAR)
                for k in range(t.link_count):
                    if word_at(t.links + 8 * LINK_WORDS * k + 40) == c:
                        least = _link_bound(t, k, least)
                _write(memory, least, bounds, start + first, filled, c)
            for g in range(t.group_count):
                _write(memory, _group_bound(t, g), bounds, start + first, filled, t.class_count + g)
        for i in range(count):
            _sharpen(memory, bounds[start + i], q[start + i])
