"""Balls that cover a robot against a scene and against the robot itself, eight configurations side by side.

Each convex part of the robot is covered by balls with outer radii R_i and holds balls of inner radii r_i
about the same centers.  Where no outer ball comes near anything, the configuration is free; where an inner
ball does, it is in contact; all else is in doubt.  Joint after joint, the bodies are placed, a coarse ball
of each is compared first and its fine balls where it is near, so that a contact near the base costs little.

Numbers are single precision; radii carry an allowance for that (`collision/fast/rounding.py`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from pepper_kin.arrays import Array
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.clouds import cloud_at, field_squared, nearest_squared
from pepper_kin.core.collision.layout import CLOUD, CYLINDER
from pepper_kin.core.collision.records import (
    BALL,
    BODY,
    BOXES,
    CORE,
    FRAME,
    GROUP,
    HEAD,
    LANE_POSE,
    LINK,
    LINK_PART,
    NODE,
    OBJECT,
    PART,
    PLACED_BODY,
    PLACED_CORE,
    PLACED_PART,
    RANGE,
    ROOT,
    SIDE,
    dot,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel
from pepper_kin.kernels.lanes import (
    LANES,
    ONE_LANE,
    TRIPLES,
    double_at,
    greatest_lane,
    lane_abs,
    lane_maximum,
    lane_minimum,
    lane_round,
    lane_sqrt,
    lanes_below,
    least_lane,
    load_lanes,
    lowest_bit,
    spread,
    store_lanes,
    store_word,
    word_at,
)
from pepper_kin.kernels.records import SINGLES, WORDS

ALL = 255
"""Bits of all lanes."""
POINT, SEGMENT, BLOCK = 0, 1, 2
"""Kinds of cores."""
FEW = 4 * LANES
"""Objects of a tree that are not worth tests of its nodes."""
ROUNDED_UP, ROUNDED_DOWN = 1.0 + 2.0**-22, 1.0 - 2.0**-22
"""What margins are multiplied by before they are rounded to single precision, added and squared there."""


class Tables(NamedTuple):
    """Addresses of the tables in a block, and how long they are; see `records` for their rows."""

    body_count: int
    group_count: int
    class_count: int
    link_count: int
    bodies: int
    frames: int
    placed_at: int
    parts_at: int
    groups: int
    parts: int
    balls: int
    allowances: int
    lists: int
    roots: int
    nodes: int
    boxes: int
    objects: int
    clouds: int
    cloud_scratch: int
    links: int
    link_parts: int
    sides: int
    ranges: int
    cores: int
    coordinates: int
    poses: int
    centers: int
    placed: int
    group_doubts: int
    class_doubts: int
    doubtful: int
    order: int
    placing: int
    placing_work: int
    margin: float
    self_margin: float


@compiled
def tables_of(memory: Array) -> Tables:
    """Return the tables of a block, shape (s,), and of its scene."""
    head, here, scene = at.head_of(memory), at.address_of, at.scene_of(memory)
    return Tables(
        HEAD.bodies(head),
        HEAD.groups(head),
        HEAD.classes(head),
        HEAD.links(head),
        here(memory, at.BODIES),
        here(memory, at.FRAMES),
        here(memory, at.PLACED_AT),
        here(memory, at.PARTS_AT),
        here(memory, at.GROUPS),
        here(memory, at.PARTS),
        here(memory, at.BALLS),
        here(memory, at.ALLOWANCES),
        here(scene, at.ROOT_LISTS),
        here(scene, at.ROOTS),
        here(scene, at.NODES),
        here(scene, at.BOXES),
        here(scene, at.OBJECTS),
        here(scene, at.CLOUDS),
        here(memory, at.CLOUD_WORKSPACE),
        here(memory, at.LINKS),
        here(memory, at.LINK_PARTS),
        here(memory, at.SIDES),
        here(memory, at.RANGES),
        here(memory, at.CORES),
        here(memory, at.COORDINATES),
        here(memory, at.POSES),
        here(memory, at.CENTERS),
        here(memory, at.PLACED),
        here(memory, at.GROUP_DOUBTS),
        here(memory, at.CLASS_DOUBTS),
        here(memory, at.DOUBTFUL),
        here(memory, at.ORDER),
        HEAD.placing_kernel(head),
        here(memory, at.PLACING),
        HEAD.margin(head),
        HEAD.self_margin(head),
    )


@compiled(inline=True, lean=True)
def sine_cosine(x: Any) -> tuple[Any, Any]:
    """Return sine and cosine in each lane, with an error below 2.5e-7 for |x| of at most 16.

    x is reduced by a whole multiple of pi, in three parts, to at most pi / 2; the polynomials are
    least-maximum fits there.
    """
    turns = lane_round(x * 0.31830988618379067)
    r = x - turns * 3.140625
    r = r - turns * 0.0009670257568359375
    r = r - turns * 6.2771141529083252e-07
    half = turns * 0.5
    sign = 1.0 - lane_abs(half - lane_round(half)) * 4.0
    s = r * r
    sine = (
        (((s * -2.3889859e-08 + 2.7525562e-06) * s - 1.9840874e-04) * s + 8.3333310e-03) * s - 1.6666667e-01
    ) * s
    sine = (sine * r + r) * sign
    cosine = (
        ((((s * 1.9896851e-09 - 2.7529682e-07) * s + 2.4801168e-05) * s - 1.3888881e-03) * s + 4.1666664e-02)
        * s
        - 0.5
    ) * s + 1.0
    return sine, cosine * sign


@compiled(lean=True)
def place_body(t: Tables, b: int) -> None:
    """Write the pose of a body from its parent's."""
    body, frame = BODY.at(t.bodies, b), FRAME.at(t.frames, b)
    above, here = LANE_POSE.at(t.poses, BODY.parent(body)), LANE_POSE.at(t.poses, b + 1)
    q = load_lanes(t.coordinates, BODY.coordinate(body)) * FRAME.gain(frame) + FRAME.offset(frame)
    shift, turn = FRAME.origin(frame), FRAME.rotation(frame)
    across, up, axis = (turn[0], turn[3], turn[6]), (turn[1], turn[4], turn[7]), (turn[2], turn[5], turn[8])
    origin, moved = LANE_POSE.origin_at(above), LANE_POSE.origin_at(here)
    if BODY.slides(body) != 0:
        for i in range(3):
            x, y, z = TRIPLES.xyz(above, i)
            along = dot(x, y, z, axis)
            TRIPLES.set_xyz(here, (dot(x, y, z, across), dot(x, y, z, up), along), i)
            store_lanes(moved, load_lanes(origin, i) + dot(x, y, z, shift) + along * q, i)
        return
    sine, cosine = sine_cosine(q)
    for i in range(3):
        x, y, z = TRIPLES.xyz(above, i)
        u, v = dot(x, y, z, across), dot(x, y, z, up)
        TRIPLES.set_xyz(here, (u * cosine + v * sine, v * cosine - u * sine, dot(x, y, z, axis)), i)
        store_lanes(moved, load_lanes(origin, i) + dot(x, y, z, shift), i)


@compiled(inline=True, lean=True)
def _point(pose: int, point: tuple[float, float, float]) -> tuple[Any, Any, Any]:
    """Return where a point of a body is in the world."""
    x, y, z = LANE_POSE.origin(pose)
    u, v, w = _direction(pose, point)
    return x + u, y + v, z + w


@compiled(inline=True, lean=True)
def _direction(pose: int, direction: tuple[float, float, float]) -> tuple[Any, Any, Any]:
    """Return where a direction of a body points in the world."""
    r = LANE_POSE.rotation(pose)
    x, y, z = direction
    return dot(x, y, z, r[:3]), dot(x, y, z, r[3:6]), dot(x, y, z, r[6:])


@compiled(inline=True, lean=True)
def squared_distance(item: int, x: Any, y: Any, z: Any) -> Any:
    """Return the squared distance of points to the core of an object at an address [m^2]."""
    u, v, w = to_frame(item, x, y, z)
    half, zero = OBJECT.half(item), spread(0.0)
    w = lane_maximum(lane_abs(w) - half[2], zero)
    if OBJECT.kind(item) == CYLINDER:
        r = lane_maximum(lane_sqrt(u * u + v * v) - half[0], zero)
        return r * r + w * w
    u = lane_maximum(lane_abs(u) - half[0], zero)
    v = lane_maximum(lane_abs(v) - half[1], zero)
    return u * u + v * v + w * w


@compiled(inline=True, lean=True)
def _center_ball(t: Tables, pose: int, k: int) -> None:
    """Write where the center of a ball is."""
    TRIPLES.set_xyz(t.centers, _point(pose, BALL.center(t.balls, k)), k)


@compiled(inline=True, lean=True)
def _is_new(t: Tables, b: int, place: int) -> bool:
    """Whether what is noted at a place has not been done since a body was placed; notes that it is."""
    now = PLACED_BODY.count(t.placed_at, b)
    if word_at(place) == now:
        return False
    store_word(place, now)
    return True


@compiled(lean=True)
def _center_balls(t: Tables, b: int, p: int) -> None:
    """Write where the centers of the balls of a body's part are, if that has not been done yet."""
    if _is_new(t, b, PLACED_PART.balls_at(t.parts_at, p)):
        for k in range(PART.first_ball(t.parts, p), PART.ball_end(t.parts, p)):
            _center_ball(t, LANE_POSE.at(t.poses, b + 1), k)


@compiled(lean=True)
def _center_parts(t: Tables, b: int) -> None:
    """Write where the coarse balls of a body's parts are, if that has not been done yet."""
    if _is_new(t, b, PLACED_BODY.parts_at(t.placed_at, b)):
        for p in range(BODY.first_part(t.bodies, b), BODY.part_end(t.bodies, b)):
            _center_ball(t, LANE_POSE.at(t.poses, b + 1), PART.coarse(t.parts, p))


@compiled(lean=True)
def _place_cores(t: Tables, b: int, p: int) -> None:
    """Write where the cores of a body's part are, if that has not been done yet."""
    if not _is_new(t, b, PLACED_PART.cores_at(t.parts_at, p)):
        return
    pose = LANE_POSE.at(t.poses, b + 1)
    for k in range(PART.first_core(t.parts, p), PART.core_end(t.parts, p)):
        core, place = CORE.at(t.cores, k), PLACED_CORE.at(t.placed, k)
        PLACED_CORE.set_center(place, _point(pose, CORE.center(core)))
        kind = CORE.kind(core)
        if kind == POINT:
            continue
        PLACED_CORE.set_z_axis(place, _direction(pose, CORE.z_axis(core)))
        if kind == SEGMENT:
            continue
        PLACED_CORE.set_x_axis(place, _direction(pose, CORE.x_axis(core)))
        PLACED_CORE.set_y_axis(place, _direction(pose, CORE.y_axis(core)))


@compiled(inline=True, lean=True)
def box_distance(node: int, x: Any, y: Any, z: Any) -> Any:
    """Return the squared distance of points to the box of a node at an address [m^2]."""
    low, high, zero = NODE.low(node), NODE.high(node), spread(0.0)
    dx = lane_maximum(lane_maximum(low[0] - x, x - high[0]), zero)
    dy = lane_maximum(lane_maximum(low[1] - y, y - high[1]), zero)
    dz = lane_maximum(lane_maximum(low[2] - z, z - high[2]), zero)
    return dx * dx + dy * dy + dz * dz


@compiled(inline=True, lean=True)
def to_frame(item: int, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    """Return the coordinates of points in the frame of an object at an address."""
    center = OBJECT.center(item)
    x, y, z = x - center[0], y - center[1], z - center[2]
    return (
        dot(x, y, z, OBJECT.x_axis(item)),
        dot(x, y, z, OBJECT.y_axis(item)),
        dot(x, y, z, OBJECT.z_axis(item)),
    )


@compiled(lean=True)
def _check_cloud(t: Tables, b: int, p: int, k: int, margin: float, lanes: int) -> int:
    """Compare the balls of a part of a body with a cloud, object k, at a margin [m], in some lanes.

    Returns those in contact, and those in doubt 8 bits higher.
    """
    c, item, scratch = cloud_at(word_at(t.clouds, k)), OBJECT.at(t.objects, k), t.cloud_scratch
    coarse = BALL.at(t.balls, PART.coarse(t.parts, p))
    x, y, z = _point(LANE_POSE.at(t.poses, b + 1), BALL.center(coarse))
    x, y, z = to_frame(item, x, y, z)
    outside, inside = OBJECT.outer(item) + margin, OBJECT.inner(item) + margin
    wide = BALL.outer(coarse) + outside
    near = lanes_below(field_squared(c, x, y, z, scratch), spread(wide * wide)) & lanes
    if near == 0:
        return 0
    _center_balls(t, b, p)
    contact, doubt = 0, 0
    for i in range(PART.first_ball(t.parts, p), PART.ball_end(t.parts, p)):
        x, y, z = TRIPLES.xyz(t.centers, i)
        x, y, z = to_frame(item, x, y, z)
        outer, inner = BALL.outer(t.balls, i) + outside, BALL.inner(t.balls, i) + inside
        found = lanes_below(field_squared(c, x, y, z, scratch), spread(outer * outer)) & near & ~contact
        if found == 0:
            continue
        TRIPLES.set_xyz(scratch, (x, y, z))
        square = inner * inner if inner > 0.0 else 0.0
        for lane in range(LANES):
            if (found >> lane) & 1:
                at_x, at_y, at_z = ONE_LANE.xyz(SINGLES.at(scratch, lane))
                nearest = nearest_squared(c, at_x, at_y, at_z, outer, square)
                if nearest < square:
                    contact |= 1 << lane
                elif nearest < outer * outer:
                    doubt |= 1 << lane
        if contact == near:
            break
    return contact | doubt << LANES


@compiled(inline=True, lean=True)
def _near_boxes(boxes: int, low: tuple[Any, Any, Any], high: tuple[Any, Any, Any]) -> int:
    """Return which of the eight boxes at an address meet the box with these corners, each in all lanes."""
    lows, highs = BOXES.low(boxes), BOXES.high(boxes)
    apart = lane_maximum(lows[0] - high[0], low[0] - highs[0])
    apart = lane_maximum(apart, lows[1] - high[1])
    apart = lane_maximum(apart, low[1] - highs[1])
    apart = lane_maximum(apart, lows[2] - high[2])
    apart = lane_maximum(apart, low[2] - highs[2])
    return lanes_below(apart, spread(0.0))


@compiled(inline=True, lean=True)
def _check_balls(t: Tables, b: int, p: int, item: int, outside: Any, inside: Any) -> int:
    """Compare the balls of a part of a body with an object.

    Returns the lanes in contact, and those in doubt 8 bits higher.
    """
    _center_balls(t, b, p)
    outside, inside, zero = outside + OBJECT.outer(item), inside + OBJECT.inner(item), spread(0.0)
    contact, doubt = 0, 0
    for i in range(PART.first_ball(t.parts, p), PART.ball_end(t.parts, p)):
        x, y, z = TRIPLES.xyz(t.centers, i)
        squared, ball = squared_distance(item, x, y, z), BALL.at(t.balls, i)
        outer, inner = outside + BALL.outer(ball), lane_maximum(inside + BALL.inner(ball), zero)
        doubt |= lanes_below(squared, outer * outer)
        contact |= lanes_below(squared, inner * inner)
    return contact | doubt << LANES


@compiled(inline=True, lean=True)
def _check_part(t: Tables, g: int, b: int, p: int, margin: float, decided: int, first_contact: bool) -> int:
    """Compare a part of a group with the objects of its trees, at a margin [m].

    Objects that the box around the part's coarse ball in all lanes does not meet are left out, eight at a
    time.  Returns the lanes in contact, those in doubt 8 bits higher, and -1 where a part without balls is
    near an object.
    """
    part = PART.at(t.parts, p)
    coarse = BALL.at(t.balls, PART.coarse(part))
    x, y, z = _point(LANE_POSE.at(t.poses, b + 1), BALL.center(coarse))
    outside, inside = spread(margin * ROUNDED_UP), spread(margin * ROUNDED_DOWN)
    reach = outside + BALL.outer(coarse)
    low = spread(least_lane(x)), spread(least_lane(y)), spread(least_lane(z))
    high = spread(greatest_lane(x)), spread(greatest_lane(y)), spread(greatest_lane(z))
    low = low[0] - reach, low[1] - reach, low[2] - reach
    high = high[0] + reach, high[1] + reach, high[2] + reach
    contact, doubt = decided, 0
    for r in range(word_at(t.lists, g), word_at(t.lists, g + 1)):
        n, end = ROOT.first_node(t.roots, r), ROOT.node_end(t.roots, r)
        k, last = ROOT.first_object(t.roots, r), ROOT.object_end(t.roots, r)
        few = last - k <= FEW
        if few:
            n = end - 1
        while n < end:
            if not few:
                node = NODE.at(t.nodes, n)
                if (lanes_below(box_distance(node, x, y, z), reach * reach) & ~contact) == 0:
                    n = int(NODE.after(node))
                    continue
                k, last = int(NODE.first_object(node)), int(NODE.object_end(node))
            while k < last:
                start = k & -LANES
                met = _near_boxes(BOXES.at(t.boxes, start // LANES), low, high) & (ALL << (k - start))
                if last - start < LANES:
                    met &= (1 << (last - start)) - 1
                k = start + LANES
                while met != 0:
                    item = OBJECT.at(t.objects, start + lowest_bit(met))
                    wide = reach + OBJECT.outer(item)
                    near = lanes_below(squared_distance(item, x, y, z), wide * wide) & ~contact
                    if near != 0:
                        if PART.first_ball(part) == PART.ball_end(part):
                            return -1
                        if OBJECT.kind(item) == CLOUD:
                            found = _check_cloud(t, b, p, start + lowest_bit(met), margin, near)
                        else:
                            found = _check_balls(t, b, p, item, outside, inside)
                        contact |= found & ALL
                        doubt |= found >> LANES
                        if first_contact and contact != 0:
                            return contact
                    met &= met - 1
            n += 1
    return contact | doubt << LANES


@compiled(inline=True, lean=True)
def _check_group(t: Tables, g: int, decided: int, first_contact: bool) -> int:
    """Compare a group with the objects of its trees, part by part; return the lanes in contact.

    Lanes in doubt are written to `group_doubts` and noted in `doubtful`.
    """
    group = GROUP.at(t.groups, g)
    contact, doubt = decided, 0
    if GROUP.checked(group) == 0:
        return decided
    margin = t.margin + double_at(t.allowances, t.class_count + g)
    for p in range(GROUP.first_part(group), GROUP.part_end(group)):
        found = _check_part(t, g, GROUP.body(group), p, margin, contact, first_contact)
        if found < 0:
            continue
        if PART.first_ball(t.parts, p) == PART.ball_end(t.parts, p):
            break
        contact |= found & ALL
        doubt |= found >> LANES
        if first_contact and contact != 0:
            return contact
    if doubt != 0:
        store_word(t.group_doubts, doubt, g)
        store_word(t.doubtful, 1)
    return contact


@compiled(inline=True, lean=True)
def core_distance(core: int, place: int, x: Any, y: Any, z: Any) -> Any:
    """Return the squared distance of points to a core that has been placed [m^2]."""
    center, kind = PLACED_CORE.center(place), CORE.kind(core)
    x, y, z = x - center[0], y - center[1], z - center[2]
    if kind == POINT:
        return x * x + y * y + z * z
    axis, half = PLACED_CORE.z_axis(place), CORE.half(core)
    along = dot(x, y, z, axis)
    if kind == SEGMENT:
        end = spread(half[2])
        along = lane_maximum(lane_minimum(along, end), spread(0.0) - end)
        x, y, z = x - along * axis[0], y - along * axis[1], z - along * axis[2]
        return x * x + y * y + z * z
    zero = spread(0.0)
    w = lane_maximum(lane_abs(along) - half[2], zero)
    u = lane_maximum(lane_abs(dot(x, y, z, PLACED_CORE.x_axis(place))) - half[0], zero)
    v = lane_maximum(lane_abs(dot(x, y, z, PLACED_CORE.y_axis(place))) - half[1], zero)
    return u * u + v * v + w * w


@compiled(inline=True, lean=True)
def _within(t: Tables, first: int, second: int, reach: Any) -> int:
    """Return the lanes in which two coarse balls, which are placed, are within reach."""
    a, b = TRIPLES.xyz(t.centers, first), TRIPLES.xyz(t.centers, second)
    dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return lanes_below(dx * dx + dy * dy + dz * dz, reach * reach)


@compiled(inline=True, lean=True)
def _check_side(t: Tables, side: int, a: int, p: int, margin: float, decided: int) -> int:
    """Compare balls of part p of body a with a core, which is placed, at a margin [m].

    Returns as `_check_balls` does.
    """
    e, coarse = SIDE.core(side), PART.coarse(t.parts, p)
    core, scratch = CORE.at(t.cores, e), PLACED_CORE.at(t.placed, e)
    outside, zero = spread(margin * ROUNDED_UP) + CORE.outer(core), spread(0.0)
    reach = outside + BALL.outer(t.balls, coarse)
    x, y, z = TRIPLES.xyz(t.centers, coarse)
    squared = core_distance(core, scratch, x, y, z)
    if (lanes_below(squared, reach * reach) & ~decided) == 0:
        return 0
    _center_balls(t, a, p)
    inside = spread(margin * ROUNDED_DOWN) + CORE.inner(core)
    contact, doubt = 0, 0
    for r in range(SIDE.first_range(side), SIDE.range_end(side)):
        for i in range(RANGE.first_ball(t.ranges, r), RANGE.ball_end(t.ranges, r)):
            x, y, z = TRIPLES.xyz(t.centers, i)
            squared, ball = core_distance(core, scratch, x, y, z), BALL.at(t.balls, i)
            outer, inner = outside + BALL.outer(ball), lane_maximum(inside + BALL.inner(ball), zero)
            doubt |= lanes_below(squared, outer * outer)
            contact |= lanes_below(squared, inner * inner)
    return contact | doubt << LANES


@compiled(inline=True, lean=True)
def _check_link(t: Tables, k: int, decided: int, first_contact: bool) -> int:
    """Compare the balls of one body with the cores of another, part by part; return the lanes in contact."""
    link = LINK.at(t.links, k)
    own = t.self_margin + double_at(t.allowances, LINK.pair_class(link))
    margin = spread(own * ROUNDED_UP)
    reach = margin + LINK.touching(link)
    if (_within(t, LINK.covered_coarse(link), LINK.exact_coarse(link), reach) & ~decided) == 0:
        return decided
    a, b = LINK.covered(link), LINK.exact(link)
    contact, doubt = decided, 0
    _center_parts(t, a)
    _center_parts(t, b)
    for p in range(LINK.first_part(link), LINK.part_end(link)):
        pair = LINK_PART.at(t.link_parts, p)
        first, second = LINK_PART.covered(pair), LINK_PART.exact(pair)
        coarse, reach = PART.coarse(t.parts, first), margin + LINK_PART.touching(pair)
        if (_within(t, coarse, PART.coarse(t.parts, second), reach) & ~contact) == 0:
            continue
        _place_cores(t, b, second)
        for s in range(LINK_PART.first_side(pair), LINK_PART.side_end(pair)):
            found = _check_side(t, SIDE.at(t.sides, s), a, first, own, contact)
            contact |= found & ALL
            doubt |= found >> LANES
            if first_contact and contact != 0:
                return contact
    if doubt != 0:
        place = WORDS.at(t.class_doubts, LINK.pair_class(link))
        store_word(place, word_at(place) | doubt)
        store_word(t.doubtful, 1)
    return contact


@compiled(lean=True)
def place_all(t: Tables) -> None:
    """Place all bodies, with all balls and cores, for those that will not be moved."""
    for b in range(t.body_count):
        body, pose = BODY.at(t.bodies, b), LANE_POSE.at(t.poses, b + 1)
        if BODY.moves(body) != 0:
            place_body(t, b)
        PLACED_BODY.set_count(t.placed_at, PLACED_BODY.count(t.placed_at, b) + 1, b)
        _center_ball(t, pose, BODY.coarse(body))
        _center_parts(t, b)
        for p in range(BODY.first_part(body), BODY.part_end(body)):
            _center_balls(t, b, p)
            _place_cores(t, b, p)
        for g in range(BODY.first_group(body), BODY.group_end(body)):
            _center_ball(t, pose, GROUP.coarse(t.groups, g))


@compiled(inline=True, lean=True)
def _place(t: Tables, b: int) -> None:
    """Place a body that moves, unless the kernel has placed all; its balls and cores are to be placed."""
    if BODY.moves(t.bodies, b) != 0:
        if t.placing == 0:
            place_body(t, b)
        PLACED_BODY.set_count(t.placed_at, PLACED_BODY.count(t.placed_at, b) + 1, b)


@compiled(inline=True, lean=True)
def _check_links(t: Tables, decided: int, first_contact: bool) -> int:
    """Compare the pairs of bodies; return the lanes in contact."""
    contact = decided
    for b in range(t.body_count):
        body = BODY.at(t.bodies, b)
        if BODY.moves(body) != 0:
            _center_ball(t, LANE_POSE.at(t.poses, b + 1), BODY.coarse(body))
    for k in range(t.link_count):
        contact = _check_link(t, k, contact, first_contact)
        if contact == ALL or (first_contact and contact != 0):
            break
    return contact


@compiled(inline=True, lean=True)
def _to_front(order: int, i: int) -> None:
    """Move the entry at place i of a list of words to its front."""
    moved = word_at(order, i)
    for k in range(i, 0, -1):
        store_word(order, word_at(order, k - 1), k)
    store_word(order, moved)


@compiled(lean=True)
def check_block(t: Tables, first_contact: bool) -> int:
    """Check the configurations in `coordinates`; return the lanes that are certainly in contact.

    Lanes in doubt, which may be in contact too, are written to `group_doubts` and `class_doubts`, and
    `doubtful` shows whether there are any.

    Args:
        t: The tables.
        first_contact: Whether one lane in contact ends the check.
    """
    contact, placed = 0, 0
    if word_at(t.doubtful) != 0:
        store_word(t.doubtful, 0)
        for g in range(t.group_count):
            store_word(t.group_doubts, 0, g)
        for c in range(t.class_count):
            store_word(t.class_doubts, 0, c)
    if t.placing != 0:
        call_kernel(t.placing, t.coordinates, LANE_POSE.at(t.poses, 1), t.placing_work)
    for i in range(t.group_count):
        g = word_at(t.order, i) if first_contact else i
        while placed <= GROUP.body(t.groups, g):
            _place(t, placed)
            placed += 1
        contact = _check_group(t, g, contact, first_contact)
        if first_contact and contact != 0:
            _to_front(t.order, i)
            return contact
        if contact == ALL:
            return contact
    while placed < t.body_count:
        _place(t, placed)
        placed += 1
    return _check_links(t, contact, first_contact)
