"""Lower bounds of distances of each part of the robot, compiled."""

from __future__ import annotations

import math
from typing import Any

from pepper_kin.arrays import Array
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.ball_check import (
    Tables,
    box_distance,
    core_distance,
    place_all,
    squared_distance,
    tables_of,
    to_frame,
)
from pepper_kin.core.collision.clouds import cloud_at, field_squared, nearest_squared
from pepper_kin.core.collision.layout import CLOUD, STATES_AT_ONCE, address_of, section, section_single
from pepper_kin.core.collision.narrow_phase import ball_meets, pair_distance, place_solids
from pepper_kin.core.collision.records import (
    BALL,
    CORE,
    GROUP,
    HEAD,
    LINK,
    LINK_PART,
    NODE,
    OBJECT,
    PLACED_CORE,
    POSE,
    RANGE,
    ROOT,
    SIDE,
    SOLID,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import (
    LANES,
    ONE_LANE,
    TRIPLES,
    lane_minimum,
    lane_sqrt,
    lanes_below,
    load_lanes,
    spread,
    store_lanes,
    store_single,
    word_at,
)
from pepper_kin.kernels.records import SINGLES

SMALL = 0.03
"""Distance below which bounds by spheres are improved by exact distances that have a closed form [m]."""
NEAR = 0.1
"""Distance below which bounds to clouds are exact for each sphere [m]."""
FAR = 1e30
"""Distance that stands for "nothing is near" [m]."""


@compiled(inline=True, lean=True)
def _less_reach(squared: Any, reach: float) -> Any:
    """Return d - R in lanes; -FAR if d is zero, because the depth is not measured."""
    distance = lane_sqrt(squared)
    inside = lane_minimum(distance * 1e30 - 1.0, spread(0.0))  # -1 where the distance is zero
    return distance - reach + inside * FAR


@compiled(lean=True)
def _link_bound(t: Tables, k: int, least: Any) -> Any:
    """Return in lanes `least` or the distance of a body's spheres from another's cores, if smaller [m]."""
    link = LINK.at(t.links, k)
    first, second = LINK.covered_coarse(link), LINK.exact_coarse(link)
    x, y, z = TRIPLES.xyz(t.centers, first)
    other = TRIPLES.xyz(t.centers, second)
    dx, dy, dz = x - other[0], y - other[1], z - other[2]
    wide = BALL.outer(t.balls, first)
    apart = lane_sqrt(dx * dx + dy * dy + dz * dz) - wide - BALL.outer(t.balls, second)
    if lanes_below(apart, least) == 0:
        return least
    begin = LINK_PART.first_side(t.link_parts, LINK.first_part(link))
    for s in range(begin, LINK_PART.side_end(t.link_parts, LINK.part_end(link) - 1)):
        side = SIDE.at(t.sides, s)
        e = SIDE.core(side)
        core, scratch = CORE.at(t.cores, e), PLACED_CORE.at(t.placed, e)
        apart = lane_sqrt(core_distance(core, scratch, x, y, z)) - wide - CORE.outer(core)
        if lanes_below(apart, least) == 0:
            continue
        for r in range(SIDE.first_range(side), SIDE.range_end(side)):
            for i in range(RANGE.first_ball(t.ranges, r), RANGE.ball_end(t.ranges, r)):
                u, v, w = TRIPLES.xyz(t.centers, i)
                squared = core_distance(core, scratch, u, v, w)
                reach = BALL.outer(t.balls, i) + CORE.outer(core)
                least = lane_minimum(least, _less_reach(squared, reach))
    return least


@compiled
def _cloud_bound(t: Tables, k: int, i: int, least: Any) -> Any:
    """Return in lanes the smaller of `least` and a bound of sphere i's distance from cloud k [m]."""
    item, scratch, c = OBJECT.at(t.objects, k), t.cloud_scratch, cloud_at(word_at(t.clouds, k))
    x, y, z = TRIPLES.xyz(t.centers, i)
    x, y, z = to_frame(item, x, y, z)
    reach = BALL.outer(t.balls, i) + OBJECT.outer(item)
    bound = lane_sqrt(field_squared(c, x, y, z, scratch))
    near = lanes_below(bound, spread(reach + NEAR)) & lanes_below(bound - reach, least)
    if near == 0:
        return lane_minimum(least, bound - reach)
    bounds = TRIPLES.at(scratch, 1)
    TRIPLES.set_xyz(scratch, (x, y, z))
    store_lanes(bounds, bound)
    for j in range(LANES):
        if (near >> j) & 1:
            at_x, at_y, at_z = ONE_LANE.xyz(SINGLES.at(scratch, j))
            nearest = nearest_squared(c, at_x, at_y, at_z, reach + NEAR, reach * reach)
            store_single(bounds, math.sqrt(nearest), j)
    return lane_minimum(least, load_lanes(bounds) - reach)


@compiled(lean=True)
def _group_bound(t: Tables, g: int) -> Any:
    """Return in lanes the minimum distance of the spheres of a group from the objects of its trees [m]."""
    group, least = GROUP.at(t.groups, g), spread(FAR)
    reach = BALL.outer(t.balls, GROUP.coarse(group))
    x, y, z = TRIPLES.xyz(t.centers, GROUP.coarse(group))
    for r in range(word_at(t.lists, g), word_at(t.lists, g + 1)):
        n, end = ROOT.first_node(t.roots, r), ROOT.node_end(t.roots, r)
        while n < end:
            node = NODE.at(t.nodes, n)
            if lanes_below(lane_sqrt(box_distance(node, x, y, z)) - reach, least) == 0:
                n = int(NODE.after(node))
                continue
            for k in range(int(NODE.first_object(node)), int(NODE.object_end(node))):
                item = OBJECT.at(t.objects, k)
                radius = OBJECT.outer(item)
                apart = lane_sqrt(squared_distance(item, x, y, z)) - reach - radius
                if lanes_below(apart, least) == 0:
                    continue
                for i in range(GROUP.first_ball(group), GROUP.ball_end(group)):
                    if OBJECT.kind(item) == CLOUD:
                        least = _cloud_bound(t, k, i, least)
                        continue
                    u, v, w = TRIPLES.xyz(t.centers, i)
                    squared = squared_distance(item, u, v, w)
                    least = lane_minimum(least, _less_reach(squared, BALL.outer(t.balls, i) + radius))
            n += 1
    return least


@compiled
def _write(memory: Array, least: Any, bounds: Array, first: int, count: int, part: int) -> None:
    """Write the bounds of a part of the robot from all lanes.

    Args:
        memory: The robot's block, shape (s,).
        least: The bounds in lanes [m].
        bounds: Output from row `first` on, shape (m, parts) [m]: -inf where the bound is not positive.
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
    """Return a lower bound of the distance of a group's placed solids to the scene [m].

    Args:
        memory: The robot's block, shape (s,).
        scene: The scene's block, shape (t,).
        g: Index of the group.
    """
    members, least = section(memory, at.GROUP_SOLIDS), math.inf
    lists, roots, nodes = (
        address_of(scene, at.ROOT_LISTS),
        address_of(scene, at.ROOTS),
        address_of(scene, at.NODES),
    )
    for k in range(members.size // 2):
        if int(members[2 * k]) != g:
            continue
        a = int(members[2 * k + 1])
        center = POSE.at(address_of(memory, at.SOLID_POSES), a)
        for r in range(word_at(lists, g), word_at(lists, g + 1)):
            n, end = ROOT.first_node(roots, r), ROOT.node_end(roots, r)
            while n < end:
                node = NODE.at(nodes, n)
                reach = SOLID.bounding(address_of(memory, at.SOLIDS), a) + max(least, 0.0)
                if not ball_meets(node, center, reach):
                    n = int(NODE.after(node))
                    continue
                for o in range(int(NODE.first_object(node)), int(NODE.object_end(node))):
                    least = min(least, pair_distance(memory, scene, a, o, least))
                n += 1
    return least


@compiled
def _sharpen(memory: Array, scene: Array, bounds: Array, q: Array) -> None:
    """Raise the small bounds of a configuration by exact distances.

    Args:
        memory: The robot's block, shape (s,).
        scene: The scene's block, shape (t,).
        bounds: Bounds, changed, shape (classes + groups,) [m].
        q: Configuration, shape (n,) [rad or m].
    """
    head, first, pairs = at.head_of(memory), section(memory, at.PAIR_FIRST), section(memory, at.PAIRS)
    classes, groups = HEAD.classes(head), HEAD.groups(head)
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
    """Write lower bounds of the distance of each class of pairs, and of each group to the scene [m].

    Args:
        memory: A block in which all joints are free, shape (s,); its margins do not count.
        q: Configurations, shape (m, n) [rad or m].
        bounds: Output, shape (m, classes + groups) [m].
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
                    if LINK.pair_class(t.links, k) == c:
                        least = _link_bound(t, k, least)
                _write(memory, least, bounds, start + first, filled, c)
            for g in range(t.group_count):
                _write(memory, _group_bound(t, g), bounds, start + first, filled, t.class_count + g)
        for i in range(count):
            _sharpen(memory, scene, bounds[start + i], q[start + i])
