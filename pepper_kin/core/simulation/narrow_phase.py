"""Contact points of shapes: bounds for all pairs, then points for the few pairs that are near.

A contact of two shapes is found from faces and round ends if these determine it: a face of one shape clipped
by a face of the other (a manifold), or the nearest points of two segments.  Pairs of edges and corners, and
pairs of other shapes, are listed for the caller.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

from pepper_kin.core.simulation.tree_motion import TreeMotion
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

BALL, CAPSULE, BOX, CYLINDER, HALF_SPACE, OTHER = 0, 1, 2, 3, 4, 5
"""Kinds of shapes; contacts of OTHER are left to the caller."""
STANDS, ON_ROBOT, FREE = 0, 1, 2
"""Movers of a shape: none, a joint of the robot, or the shape's own velocity."""
OPEN = -1
"""Result if neither faces nor round ends determine the contact."""
FACE_TOLERANCE = 1e-4
"""Tolerance by which a manifold's lowest point may be above the lower bound of the distance [m]."""
MARGIN = 2e-3
"""Distance below which points count as contacts at any speed [m]."""
MOST_POINTS = 256
"""Maximum number of contact points at one time."""
OUTLINE_ROWS = 16
"""Maximum number of rows of an outline while it is clipped."""
WORK_ROWS = 2 * OUTLINE_ROWS + 12
"""Vectors of workspace: of the innermost function, then of its callers, then two outlines."""


class ShapeTable(NamedTuple):
    """One row for each of k shapes.

    Attributes:
        kind: BALL ... OTHER, shape (k,).
        size: Radius of a sphere; radius and half the segment of a capsule; half lengths of a box; radius and
            half the length of a cylinder; offset of a half-space, shape (k, 3) [m].
        mover: STANDS, ON_ROBOT or FREE, shape (k,).
        owner: Joint or free body that moves the shape, shape (k,).
        of_robot: 1 if the shape is a part of the robot or attached to it, else 0, shape (k,).
        own_rotation: Rotation in the frame of the owner, shape (k, 3, 3).
        own_position: Position in the frame of the owner [m], shape (k, 3).
        own_middle: Center of the bounding sphere in the frame of the owner [m], shape (k, 3).
        ball: Center, in the shape's frame, and radius of the bounding sphere [m], shape (k, 4).
        placed: Whether the pose in the world has been written, shape (k,); overwritten.
        rotation: Rotation in the world, overwritten if the shape may touch, shape (k, 3, 3).
        position: Position in the world [m], overwritten, shape (k, 3).
        middle: Center of the bounding sphere in the world [m], overwritten, shape (k, 3).
        speed: Bound on the speed of any point of the shape [m/s], overwritten, shape (k,).
        pairs: Rows of shapes that may collide, the moving shape first, shape (p, 2); pairs without the robot
            come first.
        alone: Number of pairs without the robot, shape (1,).
        friction: Friction coefficient of each shape, shape (k,).
    """

    kind: Ints1
    size: Floats2
    mover: Ints1
    owner: Ints1
    of_robot: Ints1
    own_rotation: Floats3
    own_position: Floats2
    own_middle: Floats2
    ball: Floats2
    placed: Ints1
    rotation: Floats3
    position: Floats2
    middle: Floats2
    speed: Floats1
    pairs: Ints2
    alone: Ints1
    friction: Floats1


class BodyTable(NamedTuple):
    """Free bodies; position, rotation and velocity change.

    Attributes:
        position: Centers in the world [m], shape (b, 3).
        rotation: Rotations in the world, shape (b, 3, 3).
        velocity: Velocity of the center [m/s] and angular velocity [rad/s], in the world, shape (b, 6).
        mass: Masses [kg], shape (b,).
        inertia: Principal moments about the axes of the body [kg m^2], shape (b, 3).
        gravity: Acceleration of gravity in the world [m/s^2], shape (b, 3).
    """

    position: Floats2
    rotation: Floats3
    velocity: Floats2
    mass: Floats1
    inertia: Floats2
    gravity: Floats2


class ContactPoints(NamedTuple):
    """Points where shapes touch, or could touch during the step.

    Attributes:
        rows: Point, normal (from the second shape to the first) and gap [m], shape (MOST_POINTS, 7); the
            point is halfway between the surfaces, or on the first if there is a gap and the second is not
            free.
        shapes: The two shapes of each point, shape (MOST_POINTS, 2).
        undecided: Pairs that neither faces nor round ends decide, shape (MOST_POINTS, 2).
        room: Memory for the contact problem, see `contact_solver.room_for`.
        columns: Memory, one entry for each free body, shape (b,).
        work: Workspace, shape (WORK_ROWS, 3).
    """

    rows: Floats2
    shapes: Ints2
    undecided: Ints2
    room: Floats1
    columns: Ints1
    work: Floats2


Vector: TypeAlias = tuple[float, float, float]


class PlacedShape(NamedTuple):
    """A shape in the world: a row of `ShapeTable`, with shapes (3,), (3, 3) and (3,); and workspace."""

    kind: int
    size: Floats1
    rotation: Floats2
    position: Floats1
    work: Floats2


@compiled(lean=True)
def bound_shapes(shapes: ShapeTable, at: TreeMotion, bodies: BodyTable, robot: bool) -> None:
    """Write the bounding sphere of every moving shape, and a bound on its speed; see `ShapeTable`.

    Without `robot`, only shapes of free bodies are written.
    """
    for s in range(len(shapes.mover)):
        if shapes.mover[s] == STANDS or (shapes.mover[s] == ON_ROBOT and not robot):
            continue
        o, own = shapes.owner[s], shapes.own_middle[s]
        away, turning, moving = 0.0, 0.0, 0.0
        if shapes.mover[s] == ON_ROBOT:
            for i in range(3):
                arm = at.pose[o, 3 + i] * own[0] + at.pose[o, 6 + i] * own[1] + at.pose[o, 9 + i] * own[2]
                shapes.middle[s, i] = at.pose[o, i] + arm
                away += arm * arm
                turning += at.angular[o, i] ** 2
                moving += at.linear[o, i] ** 2
        else:
            frame = bodies.rotation[o]
            for i in range(3):
                arm = frame[i, 0] * own[0] + frame[i, 1] * own[1] + frame[i, 2] * own[2]
                shapes.middle[s, i] = bodies.position[o, i] + arm
                away += arm * arm
                turning += bodies.velocity[o, 3 + i] ** 2
                moving += bodies.velocity[o, i] ** 2
        shapes.placed[s] = 0
        shapes.speed[s] = math.sqrt(moving) + math.sqrt(turning) * (math.sqrt(away) + shapes.ball[s, 3])


@compiled(lean=True)
def _place(s: int, shapes: ShapeTable, at: TreeMotion, bodies: BodyTable) -> None:
    """Write the pose of a shape, unless it has been written since `bound_shapes`."""
    if shapes.placed[s] != 0:
        return
    shapes.placed[s] = 1
    o, on_robot = shapes.owner[s], shapes.mover[s] == ON_ROBOT
    for i in range(3):
        if on_robot:
            origin, x, y, z = at.pose[o, i], at.pose[o, 3 + i], at.pose[o, 6 + i], at.pose[o, 9 + i]
        else:
            origin = bodies.position[o, i]
            x, y, z = bodies.rotation[o, i, 0], bodies.rotation[o, i, 1], bodies.rotation[o, i, 2]
        own, turn = shapes.own_position[s], shapes.own_rotation[s]
        shapes.position[s, i] = origin + x * own[0] + y * own[1] + z * own[2]
        for k in range(3):
            shapes.rotation[s, i, k] = x * turn[0, k] + y * turn[1, k] + z * turn[2, k]


@compiled(lean=True)
def find_contacts(
    shapes: ShapeTable, at: TreeMotion, bodies: BodyTable, h: float, points: ContactPoints, robot: bool
) -> tuple[int, int, float]:
    """Write all contacts that faces and round ends determine, and the pairs that they leave undecided.

    Args:
        shapes: The shapes, bounded by `bound_shapes`; poses of shapes that may touch are written.
        at: Poses of the robot's joints.
        bodies: The free bodies.
        h: Length of the step [s].
        points: Output.
        robot: Whether pairs with the robot are tested.

    Returns:
        The number of points, -1 if the arrays are too small; the number of undecided pairs; and a lower bound
        of the robot's distance from all else [m], 0 if something is near.
    """
    found, left, apart = 0, 0, math.inf
    for p in range(len(shapes.pairs) if robot else shapes.alone[0]):
        i, j = shapes.pairs[p, 0], shapes.pairs[p, 1]
        margin = MARGIN + h * (shapes.speed[i] + shapes.speed[j])
        a, b = shapes.kind[i], shapes.kind[j]
        if b != HALF_SPACE:
            square = 0.0
            for k in range(3):
                square += (shapes.middle[i, k] - shapes.middle[j, k]) ** 2
            radii = shapes.ball[i, 3] + shapes.ball[j, 3]
            if square > (radii + margin) ** 2:
                if p >= shapes.alone[0] and square < (radii + apart) ** 2:
                    apart = math.sqrt(square) - radii
                continue
        _place(j, shapes, at, bodies)
        first, second = _solid(shapes, i, points.work), _solid(shapes, j, points.work)
        if b in (BOX, HALF_SPACE):
            height = _height_above(second, shapes.middle[i], shapes.ball[i, 3])
            if height > margin:
                apart = min(apart, height) if p >= shapes.alone[0] else apart
                continue
        _place(i, shapes, at, bodies)
        if (
            a == BOX
            and b != HALF_SPACE
            and _height_above(first, shapes.middle[j], shapes.ball[j, 3]) > margin
        ):
            apart = 0.0 if p >= shapes.alone[0] else apart
            continue
        if p >= shapes.alone[0]:
            apart = 0.0
        if found + 4 > len(points.rows) or left == len(points.undecided):
            return -1, 0, 0.0
        new, swapped, rows = OPEN, False, points.rows[found:]
        if b == HALF_SPACE and a != OTHER:
            new = _on_plane(first, second, margin, rows)
        elif a <= CAPSULE and b <= CAPSULE:
            new = _of_round(first, second, margin, rows)
        elif b == BOX and a != OTHER:
            new = _on_box(first, second, margin, rows)
        elif a == BOX and b < HALF_SPACE:
            swapped = True
            new = _on_box(second, first, margin, rows)
        if new == OPEN:
            points.undecided[left, 0], points.undecided[left, 1] = i, j
            left += 1
            continue
        for k in range(found, found + new):
            points.shapes[k, 0], points.shapes[k, 1] = i, j
            if swapped:
                for m in range(3, 6):
                    points.rows[k, m] = -points.rows[k, m]
            if points.rows[k, 6] > 0.0 and shapes.mover[j] != FREE:  # contact will be on the second's surface
                for m in range(3):
                    points.rows[k, m] += 0.5 * points.rows[k, 6] * points.rows[k, 3 + m]
        found += new
    return found, left, apart


@compiled(lean=True, inline=True)
def _solid(shapes: ShapeTable, row: int, work: Floats2) -> PlacedShape:
    """Return a placed shape, with workspace of shape (WORK_ROWS, 3)."""
    return PlacedShape(shapes.kind[row], shapes.size[row], shapes.rotation[row], shapes.position[row], work)


@compiled(lean=True)
def _height_above(solid: PlacedShape, middle: Floats1, radius: float) -> float:
    """Return a lower bound of the distance of a sphere, center shape (3,), from a half-space or a box [m]."""
    if solid.kind == HALF_SPACE:
        height = -solid.size[0] - radius
        for i in range(3):
            height += solid.rotation[i, 2] * (middle[i] - solid.position[i])
        return height
    square = 0.0
    for k in range(3):
        along = 0.0
        for i in range(3):
            along += solid.rotation[i, k] * (middle[i] - solid.position[i])
        square += max(0.0, abs(along) - solid.size[k]) ** 2
    return math.sqrt(square) - radius


@compiled(lean=True)
def _extent(solid: PlacedShape, x: float, y: float, z: float) -> float:
    """Return how far a shape extends from its center along a unit vector (x, y, z) and its opposite [m]."""
    kind, size, rotation = solid.kind, solid.size, solid.rotation
    if kind == BALL:
        return size[0]
    along = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
    if kind == CAPSULE:
        return size[0] + size[1] * abs(along)
    if kind == CYLINDER:
        return size[0] * math.sqrt(max(0.0, 1.0 - along * along)) + size[1] * abs(along)
    first = x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]
    second = x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]
    return size[0] * abs(first) + size[1] * abs(second) + size[2] * abs(along)


@compiled(lean=True)
def _write_corner(
    points: Floats2, row: int, center: Floats1, along: float, axis: Floats1, out: float, outward: Floats1
) -> None:
    """Write center + along axis + out outward, vectors of shape (3,), to a row of points, shape (p, 3)."""
    for i in range(3):
        points[row, i] = center[i] + along * axis[i] + out * outward[i]


@compiled(lean=True)
def _rim(solid: PlacedShape, axis: Floats1, along: float, d: Floats1, points: Floats2) -> int:
    """Write the end or the side of a cylinder that faces along d; return the number of points.

    Args:
        solid: The cylinder.
        axis: Axis of the cylinder in the world, shape (3,).
        along: d . axis.
        d: Unit vector, shape (3,).
        points: Output, shape (4, 3) [m].
    """
    size, center = solid.size, solid.position
    outward, side = solid.work[0], solid.work[1]
    least = 0
    for i in range(3):
        outward[i] = d[i] - along * axis[i]
        if abs(axis[i]) < abs(axis[least]):
            least = i
    length = math.sqrt(outward[0] ** 2 + outward[1] ** 2 + outward[2] ** 2)
    if length < 1e-12:  # d along the axis: any radius is valid
        for i in range(3):
            outward[i] = -axis[least] * axis[i]
        outward[least] += 1.0
        length = math.sqrt(outward[0] ** 2 + outward[1] ** 2 + outward[2] ** 2)
    for i in range(3):
        outward[i] /= length
    radius, half = size[0], size[1]
    if abs(along) < 0.7:
        _write_corner(points, 0, center, half, axis, radius, outward)
        _write_corner(points, 1, center, -half, axis, radius, outward)
        return 2
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        side[i] = axis[k] * outward[m] - axis[m] * outward[k]
    end = half if along > 0 else -half
    _write_corner(points, 0, center, end, axis, radius, outward)
    _write_corner(points, 1, center, end, axis, radius, side)
    _write_corner(points, 2, center, end, axis, -radius, outward)
    _write_corner(points, 3, center, end, axis, -radius, side)
    return 4


@compiled(lean=True)
def _supporting_feature(solid: PlacedShape, d: Floats1, points: Floats2) -> int:
    """Write the feature of a shape that is farthest along d: a point, a line's ends or a face's corners.

    Args:
        solid: The shape.
        d: Unit vector in the world, shape (3,).
        points: Output, shape (4, 3) [m].

    Returns:
        The number of points: 1 for a sphere, 2 for a capsule or a cylinder's side, 4 for a box's face or a
        cylinder's end, in the order of their outline.
    """
    kind, size, rotation, center = solid.kind, solid.size, solid.rotation, solid.position
    axis = solid.work[2]
    along = 0.0
    for i in range(3):
        axis[i] = rotation[i, 2]
        along += d[i] * axis[i]
    if kind == BALL:
        _write_corner(points, 0, center, 0.0, axis, size[0], d)
        return 1
    if kind == CAPSULE:
        _write_corner(points, 0, center, size[1], axis, size[0], d)
        _write_corner(points, 1, center, -size[1], axis, size[0], d)
        return 2
    if kind == CYLINDER:
        return _rim(solid, axis, along, d, points)
    face, height = 2, along
    for k in range(2):
        other = d[0] * rotation[0, k] + d[1] * rotation[1, k] + d[2] * rotation[2, k]
        if abs(other) > abs(height):
            face, height = k, other
    out = size[face] if height >= 0 else -size[face]
    k, m = (face + 1) % 3, (face + 2) % 3
    for corner in range(4):
        a = size[k] if corner in (0, 3) else -size[k]
        b = size[m] if corner < 2 else -size[m]
        for i in range(3):
            points[corner, i] = center[i] + out * rotation[i, face] + a * rotation[i, k] + b * rotation[i, m]
    return 4


@compiled(lean=True)
def _clip_outline(outline: Floats2, count: int, half_u: float, half_v: float, work: Floats2) -> int:
    """Clip an outline of rows (u, v, height) by |u| <= half_u and |v| <= half_v, in place.

    One row is a point, two are a line, more a convex polygon (Sutherland and Hodgman 1974).

    Args:
        outline: Outline in the first `count` rows, shape (OUTLINE_ROWS, 3) [m].
        count: Number of rows.
        half_u: Half length of the rectangle along u [m].
        half_v: Half length of the rectangle along v [m].
        work: Workspace, shape (OUTLINE_ROWS, 3).

    Returns:
        Number of rows left.
    """
    for side in range(4):
        axis = side % 2
        half = half_u if axis == 0 else half_v
        sign = 1.0 if side < 2 else -1.0
        kept, within = 0, True
        for k in range(count):
            within = within and half - sign * outline[k, axis] >= 0
        if within:
            continue
        for k in range(count):
            here = half - sign * outline[k, axis]
            if here >= 0:
                for i in range(3):
                    work[kept, i] = outline[k, i]
                kept += 1
            if count == 1 or (count == 2 and k == 1):
                continue
            after = k + 1 if k + 1 < count else 0
            there = half - sign * outline[after, axis]
            if (here >= 0) != (there >= 0):
                share = here / (here - there)
                for i in range(3):
                    work[kept, i] = outline[k, i] + share * (outline[after, i] - outline[k, i])
                kept += 1
        count = kept
        for k in range(count):
            for i in range(3):
                outline[k, i] = work[k, i]
        if count == 0:
            return 0
    return count


@compiled(lean=True)
def _reduce_outline(outline: Floats2, count: int, work: Floats2) -> int:
    """Keep at most four rows (u, v, height), in place: the lowest and the rows that span the largest area.

    Args:
        outline: Outline in the first `count` rows, shape (OUTLINE_ROWS, 3) [m].
        count: Number of rows.
        work: Workspace, shape (OUTLINE_ROWS, 3).

    Returns:
        Number of rows kept.
    """
    if count <= 4:
        return count
    lowest = 0
    for k in range(count):
        if outline[k, 2] < outline[lowest, 2] - 1e-9:
            lowest = k
    far, most = lowest, -1.0
    for k in range(count):
        apart = (outline[k, 0] - outline[lowest, 0]) ** 2 + (outline[k, 1] - outline[lowest, 1]) ** 2
        if apart > most:
            far, most = k, apart
    left, right, above, below = -1, -1, 1e-14, -1e-14
    u, v = outline[far, 0] - outline[lowest, 0], outline[far, 1] - outline[lowest, 1]
    for k in range(count):
        area = u * (outline[k, 1] - outline[lowest, 1]) - v * (outline[k, 0] - outline[lowest, 0])
        if area > above:
            left, above = k, area
        if area < below:
            right, below = k, area
    kept = 0
    for k in (lowest, far, left, right):
        if k >= 0:
            for i in range(3):
                work[kept, i] = outline[k, i]
            kept += 1
    for k in range(kept):
        for i in range(3):
            outline[k, i] = work[k, i]
    return kept


@compiled(lean=True)
def _write_contact(row: Floats1, point: Vector, normal: Vector, gap: float) -> None:
    """Write a contact row, shape (7,), halfway between the surfaces, from a point on the second shape."""
    half = 0.5 * gap
    (x, y, z), (nx, ny, nz) = point, normal
    row[0], row[1], row[2] = x + half * nx, y + half * ny, z + half * nz
    row[3], row[4], row[5], row[6] = nx, ny, nz, gap


@compiled(lean=True)
def _on_plane(solid: PlacedShape, plane: PlacedShape, margin: float, rows: Floats2) -> int:
    """Write contacts of a shape with a half-space, shape (>= 4, 7); return their number."""
    x, y, z = plane.rotation[0, 2], plane.rotation[1, 2], plane.rotation[2, 2]
    height = plane.size[0] + x * plane.position[0] + y * plane.position[1] + z * plane.position[2]
    p = solid.position
    if x * p[0] + y * p[1] + z * p[2] - _extent(solid, x, y, z) - height > margin:
        return 0
    down, points = solid.work[3], solid.work[5:9]
    down[0], down[1], down[2] = -x, -y, -z
    count = _supporting_feature(solid, down, points)
    kept = 0
    for k in range(count):
        a, b, c = points[k, 0], points[k, 1], points[k, 2]
        gap = x * a + y * b + z * c - height
        if gap <= margin:
            _write_contact(rows[kept], (a - gap * x, b - gap * y, c - gap * z), (x, y, z), gap)
            kept += 1
    return kept


@compiled(lean=True)
def _across(u: Floats1, w: Floats1, normal: Floats1) -> None:
    """Write a unit vector perpendicular to two vectors, shape (3,) each, which may be parallel or zero."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        normal[i] = u[j] * w[k] - u[k] * w[j]
    size = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if size <= 1e-12:
        line = u if abs(u[0]) + abs(u[1]) + abs(u[2]) > abs(w[0]) + abs(w[1]) + abs(w[2]) else w
        x, y, z = abs(line[0]), abs(line[1]), abs(line[2])
        least = 0 if x <= y and x <= z else 1 if y <= z else 2
        j, k = (least + 1) % 3, (least + 2) % 3
        normal[least], normal[j], normal[k] = 0.0, line[k], -line[j]
        size = math.sqrt(normal[j] ** 2 + normal[k] ** 2)
    if size <= 1e-12:
        normal[0], normal[1], normal[2], size = 0.0, 0.0, 1.0, 1.0
    for i in range(3):
        normal[i] /= size


@compiled(lean=True)
def _of_round(solid: PlacedShape, other: PlacedShape, margin: float, rows: Floats2) -> int:
    """Write the contact, shape (>= 1, 7), of two spheres or capsules where their segments are nearest."""
    size, other_size = solid.size, other.size
    work = solid.work
    u, w, apart, normal = work[0], work[1], work[2], work[3]
    half = size[1] if solid.kind == CAPSULE else 0.0
    other_half = other_size[1] if other.kind == CAPSULE else 0.0
    uu, ww, uw, ud, wd = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        u[i], w[i] = half * solid.rotation[i, 2], other_half * other.rotation[i, 2]
        apart[i] = solid.position[i] - other.position[i]
        uu, ww, uw = uu + u[i] * u[i], ww + w[i] * w[i], uw + u[i] * w[i]
        ud, wd = ud + u[i] * apart[i], wd + w[i] * apart[i]
    # Minimize |apart + s u - t w| over s, t in [-1, 1]: without bounds, then clamp one after the other
    # (Ericson, Real-Time Collision Detection, 2005, 5.1.9)
    across = uu * ww - uw * uw
    s = 0.0
    if across > 1e-12 * uu * ww:
        s = min(1.0, max(-1.0, (uw * wd - ww * ud) / across))
    t = (uw * s + wd) / ww if ww > 0 else 0.0
    t = min(1.0, max(-1.0, t))
    if uu > 0:
        s = min(1.0, max(-1.0, (uw * t - ud) / uu))
    for i in range(3):
        normal[i] = apart[i] + s * u[i] - t * w[i]
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    gap = length - size[0] - other_size[0]
    if gap > margin:
        return 0
    if length <= 1e-12:  # the segments intersect: any perpendicular direction separates the two
        _across(u, w, normal)
        length = 1.0
    for i in range(3):
        normal[i] = normal[i] / length
        apart[i] = other.position[i] + t * w[i] + other_size[0] * normal[i]
    _write_contact(rows[0], (apart[0], apart[1], apart[2]), (normal[0], normal[1], normal[2]), gap)
    return 1


@compiled(lean=True)
def _best_face(solid: PlacedShape, box: PlacedShape) -> tuple[float, int, int]:
    """Return a shape's maximum height above a face of a box [m], and that face's axis and sign."""
    best, face, sign = -math.inf, 0, 1
    for k in range(3):
        x, y, z = box.rotation[0, k], box.rotation[1, k], box.rotation[2, k]
        way = x * (solid.position[0] - box.position[0])
        way += y * (solid.position[1] - box.position[1]) + z * (solid.position[2] - box.position[2])
        above = abs(way) - _extent(solid, x, y, z) - box.size[k]
        if above > best:
            best, face, sign = above, k, 1 if way >= 0.0 else -1
    return best, face, sign


@compiled(lean=True)
def _ball_on_corner(ball: PlacedShape, box: PlacedShape, margin: float, rows: Floats2) -> int:
    """Write the contact, shape (>= 1, 7), of a sphere, center outside, with the nearest point of a box."""
    center, box_size, box_rotation, box_center = ball.position, box.size, box.rotation, box.position
    nearest, normal = ball.work[0], ball.work[1]
    for i in range(3):
        nearest[i] = box_center[i]
    for k in range(3):
        along = 0.0
        for i in range(3):
            along += (center[i] - box_center[i]) * box_rotation[i, k]
        along = min(box_size[k], max(-box_size[k], along))
        for i in range(3):
            nearest[i] += along * box_rotation[i, k]
    for i in range(3):
        normal[i] = center[i] - nearest[i]
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    gap = length - ball.size[0]
    if gap > margin:
        return 0
    if length < 1e-12:
        return OPEN
    unit = (normal[0] / length, normal[1] / length, normal[2] / length)
    _write_contact(rows[0], (nearest[0], nearest[1], nearest[2]), unit, gap)
    return 1


class _Face(NamedTuple):
    """A face of a box, and the height of another shape above it [m]."""

    axis: int
    sign: int
    lowest: float


@compiled(lean=True)
def _on_face(
    solid: PlacedShape, box: PlacedShape, face: _Face, margin: float, sense: float, rows: Floats2
) -> int:
    """Write contacts of a shape with a face of a box to rows, shape (>= 4, 7); return their number or OPEN.

    `sense` is -1 if the box is the first of the two shapes.
    """
    box_size, box_rotation, box_center, k = box.size, box.rotation, box.position, face.axis
    first, second = (k + 1) % 3, (k + 2) % 3
    normal, down, points = solid.work[3], solid.work[4], solid.work[5:9]
    for i in range(3):
        normal[i] = face.sign * box_rotation[i, k]
        down[i] = -normal[i]
    count = _supporting_feature(solid, down, points)
    outline = solid.work[WORK_ROWS - 2 * OUTLINE_ROWS : WORK_ROWS - OUTLINE_ROWS]
    work = solid.work[WORK_ROWS - OUTLINE_ROWS :]
    for p in range(count):
        u, v, w = 0.0, 0.0, 0.0
        for i in range(3):
            apart = points[p, i] - box_center[i]
            u += apart * box_rotation[i, first]
            v += apart * box_rotation[i, second]
            w += apart * normal[i]
        outline[p, 0], outline[p, 1], outline[p, 2] = u, v, w - box_size[k]
    if solid.kind == BALL:
        u, v = abs(outline[0, 0]) - box_size[first], abs(outline[0, 1]) - box_size[second]
        if u > 0 or v > 0:
            return _ball_on_corner(solid, box, margin, rows)
    count = _clip_outline(outline, count, box_size[first], box_size[second], work)
    least, kept = math.inf, 0
    for p in range(count):
        least = min(least, outline[p, 2])
        if outline[p, 2] <= margin:
            for i in range(3):
                outline[kept, i] = outline[p, i]
            kept += 1
    if least > face.lowest + FACE_TOLERANCE:
        return OPEN
    kept = _reduce_outline(outline, kept, work)
    for p in range(kept):
        for i in range(3):
            rows[p, i] = (
                box_center[i]
                + outline[p, 0] * box_rotation[i, first]
                + outline[p, 1] * box_rotation[i, second]
                + (box_size[k] + 0.5 * outline[p, 2]) * normal[i]
            )
            rows[p, 3 + i] = sense * normal[i]
        rows[p, 6] = outline[p, 2]
    return kept


@compiled(lean=True)
def _on_box(solid: PlacedShape, box: PlacedShape, margin: float, rows: Floats2) -> int:
    """Write contacts of a shape with a box to rows, shape (>= 4, 7); return their number or OPEN.

    The distance from the box is at least the height above any face of either shape.  If the lowest point
    above the best face lies over that face, the distance is equal to it, and the contact normal is the
    face's.
    """
    gap, axis, sign = _best_face(solid, box)
    if gap > margin:
        return 0
    if solid.kind == BOX:
        other, other_axis, other_sign = _best_face(box, solid)
        if other > margin:
            return 0
        if other > gap + 1e-7:
            return _on_face(box, solid, _Face(other_axis, other_sign, other), margin, -1.0, rows)
    return _on_face(solid, box, _Face(axis, sign, gap), margin, 1.0, rows)
