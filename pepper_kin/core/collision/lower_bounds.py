"""Lower bounds of distances, compiled: part by part of the robot."""

from __future__ import annotations

import math
from typing import Any

from pepper_kin.arrays import Array
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.ball_check import (
    BALL_SINGLES,
    CORE_LANES,
    CORE_SINGLES,
    GROUP_WORDS,
    LINK_PART_WORDS,
    LINK_WORDS,
    NODE_SINGLES,
    OBJECT_SINGLES,
    RANGE_WORDS,
    ROOT_WORDS,
    SIDE_WORDS,
    Tables,
    box_distance,
    core_distance,
    place_all,
    squared_distance,
    tables_of,
    to_frame,
)
from pepper_kin.core.collision.clouds import cloud_at, field_squared, nearest_squared
from pepper_kin.core.collision.layout import CLOUD, STATES_AT_ONCE, section, section_bits, section_single
from pepper_kin.core.collision.narrow_phase import SOLID_SIZE, ball_meets, pair_distance, place_solids
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
    store_single,
    word_at,
)

SMALL = 0.03
"""Bounds by balls below this are replaced by exact distances where there is a closed form [m]."""
NEAR = 0.1
"""Bounds to clouds below this are exact for each ball [m]."""
FAR = 1e30
"""Where there is nothing to be near to [m]."""


@compiled(inline=True, lean=True)
def _less_reach(squared: Any, reach: float) -> Any:
    """Return d - R in lanes; -FAR where d is zero, since the depth is not measured."""
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
    parts = t.link_parts + 8 * LINK_PART_WORDS * word_at(words + 48)
    last = t.link_parts + 8 * LINK_PART_WORDS * (word_at(words + 56) - 1)
    for s in range(word_at(parts + 24), word_at(last + 32)):
        side = t.sides + 8 * SIDE_WORDS * s
        e = word_at(side)
        core, scratch = t.cores + 4 * CORE_SINGLES * e, t.placed + CORE_LANES * LANE_BYTES * e
        apart = lane_sqrt(core_distance(core, scratch, x, y, z)) - wide - single_at(core + 4)
        if lanes_below(apart, least) == 0:
            continue
        for r in range(word_at(side + 8), word_at(side + 16)):
            pair = t.ranges + 8 * RANGE_WORDS * r
            for i in range(word_at(pair), word_at(pair + 8)):
                ball, place = t.balls + 4 * BALL_SINGLES * i, t.centers + 3 * LANE_BYTES * i
                squared = core_distance(
                    core, scratch, load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
                )
                least = lane_minimum(least, _less_reach(squared, single_at(ball + 12) + single_at(core + 4)))
    return least


@compiled
def _cloud_bound(t: Tables, k: int, i: int, least: Any) -> Any:
    """Return a bound in lanes, or that of the distance of ball i from a cloud, object k, where less."""
    item, scratch = t.objects + 4 * OBJECT_SINGLES * k, t.cloud_scratch
    c, place = cloud_at(word_at(t.clouds + 8 * k)), t.centers + 3 * LANE_BYTES * i
    x, y, z = load_lanes(place), load_lanes(place + LANE_BYTES), load_lanes(place + 2 * LANE_BYTES)
    x, y, z = to_frame(item, x, y, z)
    reach = single_at(t.balls + 4 * BALL_SINGLES * i + 12) + single_at(item + 4)
    bound = lane_sqrt(field_squared(c, x, y, z, scratch))
    near = lanes_below(bound, spread(reach + NEAR)) & lanes_below(bound - reach, least)
    if near == 0:
        return lane_minimum(least, bound - reach)
    store_lanes(scratch, x)
    store_lanes(scratch + LANE_BYTES, y)
    store_lanes(scratch + 2 * LANE_BYTES, z)
    store_lanes(scratch + 3 * LANE_BYTES, bound)
    for j in range(LANES):
        own = scratch + 4 * j
        if (near >> j) & 1:
            at_x, at_y, at_z = single_at(own), single_at(own + 32), single_at(own + 64)
            nearest = nearest_squared(c, at_x, at_y, at_z, reach + NEAR, reach * reach)
            store_single(own + 3 * LANE_BYTES, math.sqrt(nearest))
    return lane_minimum(least, load_lanes(scratch + 3 * LANE_BYTES) - reach)


@compiled(lean=True)
def _group_bound(t: Tables, g: int) -> Any:
    """Return in lanes how far the balls of a group are from the objects of its trees."""
    words = t.groups + 8 * GROUP_WORDS * g
    coarse = word_at(words + 8)
    reach = single_at(t.balls + 4 * BALL_SINGLES * coarse + 12)
    place = t.centers + 3 * LANE_BYTES * coarse
    x, y, z = load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
    least = spread(FAR)
    for r in range(word_at(t.lists + 8 * g), word_at(t.lists + 8 * g + 8)):
        n, end = word_at(t.roots + 8 * ROOT_WORDS * r), word_at(t.roots + 8 * ROOT_WORDS * r + 8)
        while n < end:
            node = t.nodes + 4 * NODE_SINGLES * n
            if lanes_below(lane_sqrt(box_distance(node, x, y, z)) - reach, least) == 0:
                n = int(single_at(node + 24))
                continue
            for k in range(int(single_at(node + 28)), int(single_at(node + 32))):
                item = t.objects + 4 * OBJECT_SINGLES * k
                radius = single_at(item + 4)
                apart = lane_sqrt(squared_distance(item, x, y, z)) - reach - radius
                if lanes_below(apart, least) == 0:
                    continue
                for i in range(word_at(words + 16), word_at(words + 24)):
                    ball, place = t.balls + 4 * BALL_SINGLES * i, t.centers + 3 * LANE_BYTES * i
                    if single_at(item) == CLOUD:
                        least = _cloud_bound(t, k, i, least)
                        continue
                    squared = squared_distance(
                        item, load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
                    )
                    least = lane_minimum(least, _less_reach(squared, single_at(ball + 12) + radius))
            n += 1
    return least


@compiled
def _write(memory: Array, least: Any, bounds: Array, first: int, count: int, part: int) -> None:
    """Write the bounds of a part of the robot in all lanes.

    Args:
        memory: The robot's block, shape (s,).
        least: The bounds in lanes [m].
        bounds: Written from row `first` on, shape (m, parts) [m]: -inf where the bound is not above zero.
        first: Row of the configuration in the first lane.
        count: Number of configurations, LANES at most.
        part: Column of the part.
    """
    scratch = section_single(memory, at.QUEUE)
    store_lanes(scratch.ctypes.data, least)
    for i in range(count):
        value = float(scratch[i])
        bounds[first + i, part] = math.inf if value >= FAR else (value if value > 0.0 else -math.inf)


@compiled
def _group_distance(memory: Array, scene: Array, g: int) -> float:
    """Return a lower bound of the distance of a group's solids, which are placed, to the scene [m].

    Args:
        memory: The robot's block, shape (s,).
        scene: The scene's, shape (t,).
        g: The group.
    """
    members, lists, roots = (
        section(memory, at.GROUP_SOLIDS),
        section_bits(scene, at.ROOT_LISTS),
        section_bits(scene, at.ROOTS),
    )
    nodes, least = section_single(scene, at.NODES), math.inf
    solids, poses = section(memory, at.SOLIDS), section(memory, at.SOLID_POSES)
    for k in range(members.size // 2):
        if int(members[2 * k]) != g:
            continue
        a = int(members[2 * k + 1])
        for r in range(lists[g], lists[g + 1]):
            n, end = roots[ROOT_WORDS * r], roots[ROOT_WORDS * r + 1]
            while n < end:
                node = nodes[NODE_SINGLES * n : NODE_SINGLES * (n + 1)]
                reach = solids[SOLID_SIZE * a + 2] + max(least, 0.0)
                if not ball_meets(node, poses[12 * a : 12 * a + 3], reach):
                    n = int(node[6])
                    continue
                for o in range(int(node[7]), int(node[8])):
                    least = min(least, pair_distance(memory, scene, a, o, least))
                n += 1
    return least


@compiled
def _sharpen(memory: Array, scene: Array, bounds: Array, q: Array) -> None:
    """Raise those bounds of a configuration that are small, by exact distances.

    Args:
        memory: The robot's block, shape (s,).
        scene: The scene's, shape (t,).
        bounds: Changed, shape (classes + groups,) [m].
        q: Configuration, shape (n,) [rad or m].
    """
    numbers, first, pairs = (
        section(memory, at.NUMBERS),
        section(memory, at.PAIR_FIRST),
        section(memory, at.PAIRS),
    )
    classes, groups = int(numbers[at.CLASS_COUNT]), int(numbers[at.GROUP_COUNT])
    if bounds.size == 0 or bounds.min() > SMALL:
        return
    place_solids(memory, q)
    for c in range(classes):
        if bounds[c] > SMALL:
            continue
        least = math.inf
        for k in range(int(first[c]), int(first[c + 1])):
            least = min(least, pair_distance(memory, memory, int(pairs[2 * k]), int(pairs[2 * k + 1]), least))
        bounds[c] = max(bounds[c], least)
    for g in range(groups):
        if bounds[classes + g] <= SMALL:
            bounds[classes + g] = max(bounds[classes + g], _group_distance(memory, scene, g))


@compiled("void(float64[::1], float64[:, ::1], float64[:, ::1])")
def part_bounds(memory: Array, q: Array, bounds: Array) -> None:
    """Write lower bounds of the distance of each class of pairs and of each group to the scene [m].

    Args:
        memory: A block in which all joints are free, shape (s,); its margins do not count.
        q: Configurations, shape (m, n) [rad or m].
        bounds: Written, shape (m, classes + groups) [m].
    """
    coordinates, n, scene = section_single(memory, at.COORDINATES), q.shape[1], at.scene_of(memory)
    for start in range(0, q.shape[0], STATES_AT_ONCE):
        count = min(STATES_AT_ONCE, q.shape[0] - start)
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
            _sharpen(memory, scene, bounds[start + i], q[start + i])
