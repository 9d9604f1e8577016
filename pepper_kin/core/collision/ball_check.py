"""Balls that cover a robot against a scene and against the robot itself, eight configurations side by side.

Each convex part of the robot is covered by balls with outer radii R_i and holds balls of inner radii r_i
about the same centers.  Where no outer ball comes near anything, the configuration is free; where an inner
ball does, it is in contact; all else is in doubt.  Joint after joint, the bodies are placed, a coarse ball
of each is compared first and its fine balls where it is near, so that a contact near the base costs little.

Numbers are single precision; radii carry an allowance for that (`collision/fast/rounding.py`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.clouds import cloud_at, field_squared, nearest_squared
from pepper_kin.core.collision.layout import CLOUD, CYLINDER
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import (
    LANE_BYTES,
    LANES,
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
    single_at,
    spread,
    store_lanes,
    store_word,
    word_at,
)

POSE_BYTES = 12 * LANE_BYTES
"""Bytes of a pose in lanes: the rotation row by row, then the origin."""
ALL = 255
"""Bits of all lanes."""

BODY_WORDS, FRAME_SINGLES = 9, 14
"""Numbers of a body: pose it hangs on, slides, coordinate, moves, first group, end of groups, coarse ball,
first and end of its parts.  Of its frame: rotation row by row, origin, then gain and offset of its
own coordinate."""
GROUP_WORDS, PART_WORDS, BALL_SINGLES = 7, 5, 5
"""Numbers of a group: body, coarse ball, first ball, end of balls, whether it is checked, first and end of
its parts.  Of a part: coarse ball, first and end of the balls in it, first and end of its cores; none in the
first of several of a group, which is the whole.  Of a ball: center, outer radius, inner radius."""
OBJECT_SINGLES = 19
"""Numbers of an object: kind, outer radius, inner radius, half lengths, center, x, y and z axis, radius of
the ball around all of it."""
NODE_SINGLES, ROOT_WORDS = 9, 2
"""Numbers of a node of a tree of boxes, its branches behind it: least and greatest corner, the node behind
all its branches, first and end of its objects.  Of a tree: its first node and the end of its nodes."""
LINK_WORDS, LINK_PART_WORDS, SIDE_WORDS, RANGE_WORDS = 8, 5, 3, 2
"""Numbers of a pair of bodies: the one with balls, its coarse ball, the one with cores, its coarse ball, the
distance at which these touch (a float32), class, first and end of its rows in LINK_PARTS; of a row there, a
pair of parts of these: the two, the distance at which their coarse balls touch, first and end of its rows in
SIDES; of a row of SIDES: core, first and end of its rows in RANGES; of a row there: first and end of
balls."""
CORE_SINGLES, CORE_LANES = 18, 12
"""Numbers of a core: kind, outer radius, inner radius, half lengths, center, x, y and z axis in its body;
values in lanes when it is placed: center, z, x and y axis."""
POINT, SEGMENT, BLOCK = 0, 1, 2
"""Kinds of cores."""
ROUNDED_UP, ROUNDED_DOWN = 1.0 + 2.0**-22, 1.0 - 2.0**-22
"""What margins are multiplied by before they are rounded to single precision, added and squared there."""


class Tables(NamedTuple):
    """Addresses of the tables in a block, and how long they are; see the constants above for their rows."""

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
    margin: float
    self_margin: float


@compiled
def tables_of(memory: at.Array) -> Tables:
    """Return the tables of a block, shape (s,), and of its scene."""
    numbers, here, scene = at.section(memory, at.NUMBERS), at.address_of, at.scene_of(memory)
    return Tables(
        int(numbers[at.BODY_COUNT]),
        int(numbers[at.GROUP_COUNT]),
        int(numbers[at.CLASS_COUNT]),
        int(numbers[at.LINK_COUNT]),
        here(memory, at.BODIES),
        here(memory, at.FRAMES),
        here(memory, at.PLACED_AT),
        here(memory, at.PARTS_AT),
        here(memory, at.GROUPS),
        here(memory, at.PARTS),
        here(memory, at.BALLS),
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
        numbers[at.MARGIN],
        numbers[at.SELF_MARGIN],
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


@compiled(inline=True, lean=True)
def _rotate_row(x: Any, y: Any, z: Any, frame: int, column: int) -> Any:
    """Return one entry of a row (x, y, z) times the rotation of a frame."""
    return (
        x * single_at(frame + 4 * column)
        + y * single_at(frame + 12 + 4 * column)
        + z * single_at(frame + 24 + 4 * column)
    )


@compiled(lean=True)
def place_body(t: Tables, b: int) -> None:
    """Write the pose of a body from its parent's."""
    words, frame = t.bodies + 8 * BODY_WORDS * b, t.frames + 4 * FRAME_SINGLES * b
    above, here = t.poses + POSE_BYTES * word_at(words), t.poses + POSE_BYTES * (b + 1)
    q = load_lanes(t.coordinates + LANE_BYTES * word_at(words + 16)) * single_at(frame + 48) + single_at(
        frame + 52
    )
    tx, ty, tz = single_at(frame + 36), single_at(frame + 40), single_at(frame + 44)
    if word_at(words + 8) != 0:
        for i in range(3):
            row = above + 3 * LANE_BYTES * i
            x, y, z = load_lanes(row), load_lanes(row + LANE_BYTES), load_lanes(row + 2 * LANE_BYTES)
            axis = _rotate_row(x, y, z, frame, 2)
            place = 3 * LANE_BYTES * i
            store_lanes(here + place, _rotate_row(x, y, z, frame, 0))
            store_lanes(here + place + LANE_BYTES, _rotate_row(x, y, z, frame, 1))
            store_lanes(here + place + 2 * LANE_BYTES, axis)
            origin = load_lanes(above + LANE_BYTES * (9 + i)) + (x * tx + y * ty + z * tz) + axis * q
            store_lanes(here + LANE_BYTES * (9 + i), origin)
        return
    sine, cosine = sine_cosine(q)
    for i in range(3):
        row = above + 3 * LANE_BYTES * i
        x, y, z = load_lanes(row), load_lanes(row + LANE_BYTES), load_lanes(row + 2 * LANE_BYTES)
        u, v = _rotate_row(x, y, z, frame, 0), _rotate_row(x, y, z, frame, 1)
        place = 3 * LANE_BYTES * i
        store_lanes(here + place, u * cosine + v * sine)
        store_lanes(here + place + LANE_BYTES, v * cosine - u * sine)
        store_lanes(here + place + 2 * LANE_BYTES, _rotate_row(x, y, z, frame, 2))
        origin = load_lanes(above + LANE_BYTES * (9 + i)) + (x * tx + y * ty + z * tz)
        store_lanes(here + LANE_BYTES * (9 + i), origin)


@compiled(inline=True, lean=True)
def _point(pose: int, x: float, y: float, z: float) -> tuple[Any, Any, Any]:
    """Return where a point of a body is in the world."""
    return (
        load_lanes(pose + 288)
        + (load_lanes(pose) * x + load_lanes(pose + 32) * y + load_lanes(pose + 64) * z),
        load_lanes(pose + 320)
        + (load_lanes(pose + 96) * x + load_lanes(pose + 128) * y + load_lanes(pose + 160) * z),
        load_lanes(pose + 352)
        + (load_lanes(pose + 192) * x + load_lanes(pose + 224) * y + load_lanes(pose + 256) * z),
    )


@compiled(inline=True, lean=True)
def _direction(pose: int, x: float, y: float, z: float) -> tuple[Any, Any, Any]:
    """Return where a direction of a body points in the world."""
    return (
        load_lanes(pose) * x + load_lanes(pose + 32) * y + load_lanes(pose + 64) * z,
        load_lanes(pose + 96) * x + load_lanes(pose + 128) * y + load_lanes(pose + 160) * z,
        load_lanes(pose + 192) * x + load_lanes(pose + 224) * y + load_lanes(pose + 256) * z,
    )


@compiled(inline=True, lean=True)
def squared_distance(item: int, x: Any, y: Any, z: Any) -> Any:
    """Return the squared distance of points to the core of an object at an address [m^2]."""
    dx, dy, dz = x - single_at(item + 24), y - single_at(item + 28), z - single_at(item + 32)
    u = dx * single_at(item + 36) + dy * single_at(item + 40) + dz * single_at(item + 44)
    v = dx * single_at(item + 48) + dy * single_at(item + 52) + dz * single_at(item + 56)
    w = lane_abs(dx * single_at(item + 60) + dy * single_at(item + 64) + dz * single_at(item + 68))
    zero = spread(0.0)
    w = lane_maximum(w - single_at(item + 20), zero)
    if single_at(item) == CYLINDER:
        r = lane_maximum(lane_sqrt(u * u + v * v) - single_at(item + 12), zero)
        return r * r + w * w
    u = lane_maximum(lane_abs(u) - single_at(item + 12), zero)
    v = lane_maximum(lane_abs(v) - single_at(item + 16), zero)
    return u * u + v * v + w * w


@compiled(inline=True, lean=True)
def _center_ball(t: Tables, pose: int, k: int) -> None:
    """Write where the center of a ball is."""
    ball, place = t.balls + 4 * BALL_SINGLES * k, t.centers + 3 * LANE_BYTES * k
    x, y, z = _point(pose, single_at(ball), single_at(ball + 4), single_at(ball + 8))
    store_lanes(place, x)
    store_lanes(place + LANE_BYTES, y)
    store_lanes(place + 2 * LANE_BYTES, z)


@compiled(inline=True, lean=True)
def _is_new(t: Tables, b: int, place: int) -> bool:
    """Whether what is noted at a place has not been done since a body was placed; notes that it is."""
    now = word_at(t.placed_at + 16 * b)
    if word_at(place) == now:
        return False
    store_word(place, now)
    return True


@compiled(lean=True)
def _center_balls(t: Tables, b: int, p: int) -> None:
    """Write where the centers of the balls of a body's part are, if that has not been done yet."""
    part = t.parts + 8 * PART_WORDS * p
    if _is_new(t, b, t.parts_at + 16 * p):
        for k in range(word_at(part + 8), word_at(part + 16)):
            _center_ball(t, t.poses + POSE_BYTES * (b + 1), k)


@compiled(lean=True)
def _center_parts(t: Tables, b: int) -> None:
    """Write where the coarse balls of a body's parts are, if that has not been done yet."""
    words = t.bodies + 8 * BODY_WORDS * b
    if _is_new(t, b, t.placed_at + 16 * b + 8):
        for p in range(word_at(words + 56), word_at(words + 64)):
            _center_ball(t, t.poses + POSE_BYTES * (b + 1), word_at(t.parts + 8 * PART_WORDS * p))


@compiled(lean=True)
def _place_cores(t: Tables, b: int, p: int) -> None:
    """Write where the cores of a body's part are, if that has not been done yet."""
    if not _is_new(t, b, t.parts_at + 16 * p + 8):
        return
    part = t.parts + 8 * PART_WORDS * p
    pose = t.poses + POSE_BYTES * (b + 1)
    for k in range(word_at(part + 24), word_at(part + 32)):
        core, place = t.cores + 4 * CORE_SINGLES * k, t.placed + CORE_LANES * LANE_BYTES * k
        x, y, z = _point(pose, single_at(core + 24), single_at(core + 28), single_at(core + 32))
        store_lanes(place, x)
        store_lanes(place + 32, y)
        store_lanes(place + 64, z)
        kind = single_at(core)
        if kind == POINT:
            continue
        x, y, z = _direction(pose, single_at(core + 60), single_at(core + 64), single_at(core + 68))
        store_lanes(place + 96, x)
        store_lanes(place + 128, y)
        store_lanes(place + 160, z)
        if kind == SEGMENT:
            continue
        x, y, z = _direction(pose, single_at(core + 36), single_at(core + 40), single_at(core + 44))
        store_lanes(place + 192, x)
        store_lanes(place + 224, y)
        store_lanes(place + 256, z)
        x, y, z = _direction(pose, single_at(core + 48), single_at(core + 52), single_at(core + 56))
        store_lanes(place + 288, x)
        store_lanes(place + 320, y)
        store_lanes(place + 352, z)


@compiled(inline=True, lean=True)
def box_distance(node: int, x: Any, y: Any, z: Any) -> Any:
    """Return the squared distance of points to the box of a node at an address [m^2]."""
    zero = spread(0.0)
    dx = lane_maximum(lane_maximum(single_at(node) - x, x - single_at(node + 12)), zero)
    dy = lane_maximum(lane_maximum(single_at(node + 4) - y, y - single_at(node + 16)), zero)
    dz = lane_maximum(lane_maximum(single_at(node + 8) - z, z - single_at(node + 20)), zero)
    return dx * dx + dy * dy + dz * dz


@compiled(inline=True, lean=True)
def to_frame(item: int, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    """Return the coordinates of points in the frame of an object at an address."""
    dx, dy, dz = x - single_at(item + 24), y - single_at(item + 28), z - single_at(item + 32)
    return (
        dx * single_at(item + 36) + dy * single_at(item + 40) + dz * single_at(item + 44),
        dx * single_at(item + 48) + dy * single_at(item + 52) + dz * single_at(item + 56),
        dx * single_at(item + 60) + dy * single_at(item + 64) + dz * single_at(item + 68),
    )


@compiled(lean=True)
def _check_cloud(t: Tables, b: int, p: int, k: int, lanes: int) -> int:
    """Compare the balls of a part of a body with a cloud, object k, in some lanes.

    Returns those in contact, and those in doubt 8 bits higher.
    """
    c, item, scratch = (
        cloud_at(word_at(t.clouds + 8 * k)),
        t.objects + 4 * OBJECT_SINGLES * k,
        t.cloud_scratch,
    )
    part, pose = t.parts + 8 * PART_WORDS * p, t.poses + POSE_BYTES * (b + 1)
    coarse = t.balls + 4 * BALL_SINGLES * word_at(part)
    x, y, z = _point(pose, single_at(coarse), single_at(coarse + 4), single_at(coarse + 8))
    x, y, z = to_frame(item, x, y, z)
    outside, inside = single_at(item + 4) + t.margin, single_at(item + 8) + t.margin
    wide = single_at(coarse + 12) + outside
    near = lanes_below(field_squared(c, x, y, z, scratch), spread(wide * wide)) & lanes
    if near == 0:
        return 0
    _center_balls(t, b, p)
    contact, doubt = 0, 0
    for i in range(word_at(part + 8), word_at(part + 16)):
        ball, place = t.balls + 4 * BALL_SINGLES * i, t.centers + 3 * LANE_BYTES * i
        x, y, z = load_lanes(place), load_lanes(place + LANE_BYTES), load_lanes(place + 2 * LANE_BYTES)
        x, y, z = to_frame(item, x, y, z)
        outer, inner = single_at(ball + 12) + outside, single_at(ball + 16) + inside
        found = lanes_below(field_squared(c, x, y, z, scratch), spread(outer * outer)) & near & ~contact
        if found == 0:
            continue
        store_lanes(scratch, x)
        store_lanes(scratch + LANE_BYTES, y)
        store_lanes(scratch + 2 * LANE_BYTES, z)
        square = inner * inner if inner > 0.0 else 0.0
        for lane in range(LANES):
            if (found >> lane) & 1:
                place = scratch + 4 * lane
                at_x, at_y, at_z = single_at(place), single_at(place + 32), single_at(place + 64)
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
    apart = lane_maximum(load_lanes(boxes) - high[0], low[0] - load_lanes(boxes + 3 * LANE_BYTES))
    apart = lane_maximum(apart, load_lanes(boxes + LANE_BYTES) - high[1])
    apart = lane_maximum(apart, low[1] - load_lanes(boxes + 4 * LANE_BYTES))
    apart = lane_maximum(apart, load_lanes(boxes + 2 * LANE_BYTES) - high[2])
    apart = lane_maximum(apart, low[2] - load_lanes(boxes + 5 * LANE_BYTES))
    return lanes_below(apart, spread(0.0))


@compiled(inline=True, lean=True)
def _check_balls(t: Tables, b: int, p: int, item: int, outside: Any, inside: Any) -> int:
    """Compare the balls of a part of a body with an object.

    Returns the lanes in contact, and those in doubt 8 bits higher.
    """
    _center_balls(t, b, p)
    part = t.parts + 8 * PART_WORDS * p
    outside, inside, zero = outside + single_at(item + 4), inside + single_at(item + 8), spread(0.0)
    contact, doubt = 0, 0
    for i in range(word_at(part + 8), word_at(part + 16)):
        ball, place = t.balls + 4 * BALL_SINGLES * i, t.centers + 3 * LANE_BYTES * i
        squared = squared_distance(
            item, load_lanes(place), load_lanes(place + LANE_BYTES), load_lanes(place + 2 * LANE_BYTES)
        )
        outer, inner = outside + single_at(ball + 12), lane_maximum(inside + single_at(ball + 16), zero)
        doubt |= lanes_below(squared, outer * outer)
        contact |= lanes_below(squared, inner * inner)
    return contact | doubt << LANES


@compiled(inline=True, lean=True)
def _check_part(t: Tables, g: int, b: int, p: int, decided: int, first_contact: bool) -> int:
    """Compare a part of a group with the objects of its trees.

    Objects that the box around the part's coarse ball in all lanes does not meet are left out, eight at a
    time.  Returns the lanes in contact, those in doubt 8 bits higher, and -1 where a part without balls is
    near an object.
    """
    part, pose = t.parts + 8 * PART_WORDS * p, t.poses + POSE_BYTES * (b + 1)
    coarse = t.balls + 4 * BALL_SINGLES * word_at(part)
    x, y, z = _point(pose, single_at(coarse), single_at(coarse + 4), single_at(coarse + 8))
    outside, inside = spread(t.margin * ROUNDED_UP), spread(t.margin * ROUNDED_DOWN)
    reach = outside + single_at(coarse + 12)
    low = spread(least_lane(x)), spread(least_lane(y)), spread(least_lane(z))
    high = spread(greatest_lane(x)), spread(greatest_lane(y)), spread(greatest_lane(z))
    low = low[0] - reach, low[1] - reach, low[2] - reach
    high = high[0] + reach, high[1] + reach, high[2] + reach
    contact, doubt = decided, 0
    for r in range(word_at(t.lists + 8 * g), word_at(t.lists + 8 * g + 8)):
        n, end = word_at(t.roots + 8 * ROOT_WORDS * r), word_at(t.roots + 8 * ROOT_WORDS * r + 8)
        alone = n + 1 == end  # the box of a tree of one node is not worth a test
        while n < end:
            node = t.nodes + 4 * NODE_SINGLES * n
            if not alone and (lanes_below(box_distance(node, x, y, z), reach * reach) & ~contact) == 0:
                n = int(single_at(node + 24))
                continue
            k, last = int(single_at(node + 28)), int(single_at(node + 32))
            while k < last:
                start = k & -LANES
                met = _near_boxes(t.boxes + 6 * 4 * start, low, high) & (ALL << (k - start))
                if last - start < LANES:
                    met &= (1 << (last - start)) - 1
                k = start + LANES
                while met != 0:
                    item = t.objects + 4 * OBJECT_SINGLES * (start + lowest_bit(met))
                    wide = reach + single_at(item + 4)
                    near = lanes_below(squared_distance(item, x, y, z), wide * wide) & ~contact
                    if near != 0:
                        if word_at(part + 8) == word_at(part + 16):
                            return -1
                        if single_at(item) == CLOUD:
                            found = _check_cloud(t, b, p, start + lowest_bit(met), near)
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
    words = t.groups + 8 * GROUP_WORDS * g
    contact, doubt = decided, 0
    if word_at(words + 32) == 0:
        return decided
    for p in range(word_at(words + 40), word_at(words + 48)):
        part = t.parts + 8 * PART_WORDS * p
        found = _check_part(t, g, word_at(words), p, contact, first_contact)
        if found < 0:
            continue
        if word_at(part + 8) == word_at(part + 16):
            break
        contact |= found & ALL
        doubt |= found >> LANES
        if first_contact and contact != 0:
            return contact
    if doubt != 0:
        store_word(t.group_doubts + 8 * g, doubt)
        store_word(t.doubtful, 1)
    return contact


@compiled(inline=True, lean=True)
def core_distance(core: int, place: int, x: Any, y: Any, z: Any) -> Any:
    """Return the squared distance of points to a core that has been placed [m^2]."""
    x, y, z = x - load_lanes(place), y - load_lanes(place + 32), z - load_lanes(place + 64)
    kind = single_at(core)
    if kind == POINT:
        return x * x + y * y + z * z
    zx, zy, zz = load_lanes(place + 96), load_lanes(place + 128), load_lanes(place + 160)
    along = x * zx + y * zy + z * zz
    if kind == SEGMENT:
        half = spread(single_at(core + 20))
        along = lane_maximum(lane_minimum(along, half), spread(0.0) - half)
        x, y, z = x - along * zx, y - along * zy, z - along * zz
        return x * x + y * y + z * z
    zero = spread(0.0)
    w = lane_maximum(lane_abs(along) - single_at(core + 20), zero)
    along = x * load_lanes(place + 192) + y * load_lanes(place + 224) + z * load_lanes(place + 256)
    u = lane_maximum(lane_abs(along) - single_at(core + 12), zero)
    along = x * load_lanes(place + 288) + y * load_lanes(place + 320) + z * load_lanes(place + 352)
    v = lane_maximum(lane_abs(along) - single_at(core + 16), zero)
    return u * u + v * v + w * w


@compiled(inline=True, lean=True)
def _within(t: Tables, first: int, second: int, reach: Any) -> int:
    """Return the lanes in which two coarse balls, which are placed, are within reach."""
    place, other = t.centers + 3 * LANE_BYTES * first, t.centers + 3 * LANE_BYTES * second
    dx = load_lanes(place) - load_lanes(other)
    dy = load_lanes(place + LANE_BYTES) - load_lanes(other + LANE_BYTES)
    dz = load_lanes(place + 2 * LANE_BYTES) - load_lanes(other + 2 * LANE_BYTES)
    return lanes_below(dx * dx + dy * dy + dz * dz, reach * reach)


@compiled(inline=True, lean=True)
def _check_side(t: Tables, side: int, a: int, p: int, decided: int) -> int:
    """Compare balls of part p of body a with a core, which is placed; return as `_check_balls` does."""
    e, coarse = word_at(side), word_at(t.parts + 8 * PART_WORDS * p)
    core, scratch = t.cores + 4 * CORE_SINGLES * e, t.placed + CORE_LANES * LANE_BYTES * e
    outside, zero = spread(t.self_margin * ROUNDED_UP) + single_at(core + 4), spread(0.0)
    place, reach = (
        t.centers + 3 * LANE_BYTES * coarse,
        outside + single_at(t.balls + 4 * BALL_SINGLES * coarse + 12),
    )
    squared = core_distance(core, scratch, load_lanes(place), load_lanes(place + 32), load_lanes(place + 64))
    if (lanes_below(squared, reach * reach) & ~decided) == 0:
        return 0
    _center_balls(t, a, p)
    inside = spread(t.self_margin * ROUNDED_DOWN) + single_at(core + 8)
    contact, doubt = 0, 0
    for r in range(word_at(side + 8), word_at(side + 16)):
        pair = t.ranges + 8 * RANGE_WORDS * r
        for i in range(word_at(pair), word_at(pair + 8)):
            ball, place = t.balls + 4 * BALL_SINGLES * i, t.centers + 3 * LANE_BYTES * i
            squared = core_distance(
                core, scratch, load_lanes(place), load_lanes(place + 32), load_lanes(place + 64)
            )
            outer, inner = outside + single_at(ball + 12), lane_maximum(inside + single_at(ball + 16), zero)
            doubt |= lanes_below(squared, outer * outer)
            contact |= lanes_below(squared, inner * inner)
    return contact | doubt << LANES


@compiled(inline=True, lean=True)
def _check_link(t: Tables, k: int, decided: int, first_contact: bool) -> int:
    """Compare the balls of one body with the cores of another, part by part; return the lanes in contact."""
    words, margin = t.links + 8 * LINK_WORDS * k, spread(t.self_margin * ROUNDED_UP)
    reach = margin + single_at(words + 32)
    if (_within(t, word_at(words + 8), word_at(words + 24), reach) & ~decided) == 0:
        return decided
    a, b = word_at(words), word_at(words + 16)
    contact, doubt = decided, 0
    _center_parts(t, a)
    _center_parts(t, b)
    for p in range(word_at(words + 48), word_at(words + 56)):
        pair = t.link_parts + 8 * LINK_PART_WORDS * p
        first, second = word_at(pair), word_at(pair + 8)
        coarse = word_at(t.parts + 8 * PART_WORDS * first), word_at(t.parts + 8 * PART_WORDS * second)
        if (_within(t, coarse[0], coarse[1], margin + single_at(pair + 16)) & ~contact) == 0:
            continue
        _place_cores(t, b, second)
        for s in range(word_at(pair + 24), word_at(pair + 32)):
            found = _check_side(t, t.sides + 8 * SIDE_WORDS * s, a, first, contact)
            contact |= found & ALL
            doubt |= found >> LANES
            if first_contact and contact != 0:
                return contact
    if doubt != 0:
        place = t.class_doubts + 8 * word_at(words + 40)
        store_word(place, word_at(place) | doubt)
        store_word(t.doubtful, 1)
    return contact


@compiled(lean=True)
def place_all(t: Tables) -> None:
    """Place all bodies, with all balls and cores, for those that will not be moved."""
    for b in range(t.body_count):
        words = t.bodies + 8 * BODY_WORDS * b
        if word_at(words + 24) != 0:
            place_body(t, b)
        store_word(t.placed_at + 16 * b, word_at(t.placed_at + 16 * b) + 1)
        _center_ball(t, t.poses + POSE_BYTES * (b + 1), word_at(words + 48))
        _center_parts(t, b)
        for p in range(word_at(words + 56), word_at(words + 64)):
            _center_balls(t, b, p)
            _place_cores(t, b, p)
        for g in range(word_at(words + 32), word_at(words + 40)):
            _center_ball(t, t.poses + POSE_BYTES * (b + 1), word_at(t.groups + 8 * GROUP_WORDS * g + 8))


@compiled(inline=True, lean=True)
def _place_ball(t: Tables, b: int) -> None:
    """Place a body that moves, and its coarse ball."""
    words = t.bodies + 8 * BODY_WORDS * b
    if word_at(words + 24) != 0:
        place_body(t, b)
        store_word(t.placed_at + 16 * b, word_at(t.placed_at + 16 * b) + 1)
        _center_ball(t, t.poses + POSE_BYTES * (b + 1), word_at(words + 48))


@compiled(inline=True, lean=True)
def _to_front(order: int, i: int) -> None:
    """Move the entry at place i of a list of words to its front."""
    moved = word_at(order + 8 * i)
    for k in range(i, 0, -1):
        store_word(order + 8 * k, word_at(order + 8 * (k - 1)))
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
            store_word(t.group_doubts + 8 * g, 0)
        for c in range(t.class_count):
            store_word(t.class_doubts + 8 * c, 0)
    for i in range(t.group_count):
        g = word_at(t.order + 8 * i) if first_contact else i
        while placed <= word_at(t.groups + 8 * GROUP_WORDS * g):
            _place_ball(t, placed)
            placed += 1
        contact = _check_group(t, g, contact, first_contact)
        if first_contact and contact != 0:
            _to_front(t.order, i)
            return contact
        if contact == ALL:
            return contact
    while placed < t.body_count:
        _place_ball(t, placed)
        placed += 1
    for k in range(t.link_count):
        contact = _check_link(t, k, contact, first_contact)
        if contact == ALL or (first_contact and contact != 0):
            return contact
    return contact
