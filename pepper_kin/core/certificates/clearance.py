"""Bounds on the distances of pairs of bodies along configurations, and the search for the minimum.

Every body lies in a solid: a box, some edges of which may have no length, swept by a sphere (spheres,
capsules and boxes are such solids themselves).  For any unit vector n, the distance of two solids with
centers c, axes a_i, half edges h_i and radii r is at least

    n . (c_2 - c_1) - sum_i h_1i |a_1i . n| - r_1 - sum_i h_2i |a_2i . n| - r_2,

also where they overlap; a negative value is the depth.  n is taken from a point of one box to a point of the
other, each the nearest to the other; the choice of n decides how tight the bound is, not whether it holds.

From there to another configuration, the bodies of a pair come nearer by at most the sum over the joints of
their steps times the maximum distance of a point of the body from the axis (`Bodies.first`); the proof
is in `pepper_kin.collision.least_clearance`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Ints1, Ints2

PLACEMENT = 15
"""Size of a joint's placement: origin in its parent's frame, rotation there by rows, axis in its own
frame."""
SOLID = 17
"""Size of a solid: center and axes (12) in the joint's frame, half edges (3), radius, radius of a sphere
around all of it.  The center of a half-space is a point of its plane, and its third axis points out of it."""
_HALF, _RADIUS, _BALL = 12, 15, 16
DONE, MEASURE, GROW = 0, 1, 2
"""Results of `search_least`: the search is done; it needs measured distances of the first `TO_MEASURE` pairs
at the configuration `MIDDLE`; or `Search.kept` is too small."""
FIRST = 64
"""Number of configurations in each of the first intervals of the search."""
DEEPEST = 16
"""Number of intervals inside the first ones that can be queued: each level of halving queues one."""
ROUNDING = 2e-6
"""Maximum difference of two distances from coal that are mathematically equal [m]."""
_STILL = 1e-9  # [m] a pair that comes no nearer than this has a constant distance
_TIGHT = 1e-6  # [m] maximum gap between bounds at which a distance needs no measurement
_LOOSE = 0.25  # maximum gap between bounds without measurement, relative to how much nearer the pair may come
_STEPS = 12  # maximum iterations of the search for the nearest points
_HERE = 1e-12  # [m] boxes nearer than this count as meeting


class Bodies(NamedTuple):
    """J joints, parents before children, the B bodies on them, and P pairs of bodies.

    Attributes:
        parents: Parent of each joint, -1 for none, shape (J,).
        slides: Whether a joint is prismatic, shape (J,).
        placements: Placement of each joint, shape (J, PLACEMENT).
        carriers: Joint that carries each body, -1 for none, shape (B,).
        solids: Solid around each body, shape (B, SOLID).
        exact: Whether a body equals its solid, shape (B,).
        flat: Whether a body is a half-space, shape (B,).
        pairs: The two bodies of each pair, a half-space second, shape (P, 2).
        paddings: How far the bodies of each pair reach beyond their solids [m], shape (P,).
        growth: Rate at which the distance of each pair shrinks with time [m/s], shape (P,).
        first: Offset in `joints` of each pair's joints, which move one body against the other,
            shape (P + 1,).
        joints: Indices of the joints of all pairs.
        sides: Which body of the pair each entry of `joints` moves, 0 or 1.
    """

    parents: Ints1
    slides: Flags1
    placements: Floats2
    carriers: Ints1
    solids: Floats2
    exact: Flags1
    flat: Flags1
    pairs: Ints2
    paddings: Floats1
    growth: Floats1
    first: Ints1
    joints: Ints1
    sides: Ints1


class Poses(NamedTuple):
    """Poses of joints and bodies at one configuration.

    Attributes:
        joints: Origin, rotation by rows and axis of each joint in the world, shape (J, PLACEMENT).
        bodies: Center of each solid, then its three axes, in the world, shape (B, 12).
        motion_bounds: Maximum distance of a point of each body from the axis of each joint, shape (B, J).
        used: Whether a body belongs to an open pair, shape (B,).
    """

    joints: Floats2
    bodies: Floats2
    motion_bounds: Floats2
    used: Flags1


class ClearanceSearch(NamedTuple):
    """State of the search; an interval is a range of configurations.

    Attributes:
        at: Counters of the search, by the indices NEXT, START, ..., shape (PLACES,).
        best: The least distance measured so far [m], shape (1,).
        roots: Start, end, first kept pair and number of kept pairs (0 once searched) of the halves of the
            first intervals, shape (R, 4).
        root_bounds: Lower bounds of the distances in `roots` [m], shape (R,).
        waiting: Start, end, first kept pair and number of kept pairs of queued intervals inside one of
            `roots`, a stack, shape (DEEPEST, 4).
        waiting_bounds: Lower bounds of the distances in `waiting` [m], shape (DEEPEST,).
        kept: Pairs that are open in queued intervals, shape (K,).
        kept_bounds: Lower bounds of the distances of the kept pairs [m], shape (K,).
        pair: Open pairs of the current interval, the pairs to measure first, nearest first, shape (P,).
        low: Lower bounds of their distances in the interval's middle, or the distances [m], shape (P,).
        high: Upper bounds of their distances there [m], shape (P,).
        near: How much nearer they may come in each half of the interval [m], shape (P, 2).
        steps: Maximum distance that each joint moves in each half [rad or m], shape (2, J).
    """

    at: Ints1
    best: Floats1
    roots: Ints2
    root_bounds: Floats1
    waiting: Ints2
    waiting_bounds: Floats1
    kept: Ints1
    kept_bounds: Floats1
    pair: Ints1
    low: Floats1
    high: Floats1
    near: Floats2
    steps: Floats2


NEXT, START, MIDDLE, END, OPEN, TO_MEASURE, ROOTS, WAITING, TOP, PAUSED, IN_FIRST = range(11)
"""Indices in `Search.at`: start of the next first interval; start, middle and end of the current interval;
numbers of open pairs and of pairs to measure; number of roots; number of queued intervals; used size of
`kept`; whether measurements were requested; whether the current interval is one of the first."""
PLACES = 11


@compiled(lean=True)
def _place_joints(bodies: Bodies, q: Floats1, poses: Poses) -> None:
    """Write the joints' poses at coordinates q, shape (J,) [rad or m]."""
    for j in range(bodies.parents.size):
        own, pose, above = bodies.placements[j], poses.joints[j], bodies.parents[j]
        if above < 0:
            for i in range(12):
                pose[i] = own[i]
        else:
            up = poses.joints[above]
            for i in range(3):
                r0, r1, r2 = up[3 + 3 * i], up[4 + 3 * i], up[5 + 3 * i]
                pose[i] = up[i] + r0 * own[0] + r1 * own[1] + r2 * own[2]
                for k in range(3):
                    pose[3 + 3 * i + k] = r0 * own[3 + k] + r1 * own[6 + k] + r2 * own[9 + k]
        x, y, z = own[12], own[13], own[14]
        for i in range(3):
            pose[12 + i] = pose[3 + 3 * i] * x + pose[4 + 3 * i] * y + pose[5 + 3 * i] * z
        if bodies.slides[j]:
            for i in range(3):
                pose[i] += q[j] * pose[12 + i]
            continue
        # R exp([u] q) = R + sin q R [u] + (1 - cos q) R [u]^2, R [u]^2 = w u^T - R, row by row
        s, c = math.sin(q[j]), 1.0 - math.cos(q[j])
        for i in range(3):
            r0, r1, r2, w = pose[3 + 3 * i], pose[4 + 3 * i], pose[5 + 3 * i], pose[12 + i]
            pose[3 + 3 * i] = r0 + s * (r1 * z - r2 * y) + c * (w * x - r0)
            pose[4 + 3 * i] = r1 + s * (r2 * x - r0 * z) + c * (w * y - r1)
            pose[5 + 3 * i] = r2 + s * (r0 * y - r1 * x) + c * (w * z - r2)


@compiled(lean=True)
def _place_bodies(bodies: Bodies, poses: Poses) -> None:
    """Write poses of the solids that are used, and the motion bounds of the joints that move them."""
    for b in range(bodies.carriers.size):
        if not poses.used[b]:
            continue
        own, pose, j = bodies.solids[b], poses.bodies[b], bodies.carriers[b]
        if j < 0:
            for i in range(12):
                pose[i] = own[i]
            continue
        up = poses.joints[j]
        for i in range(3):
            r0, r1, r2 = up[3 + 3 * i], up[4 + 3 * i], up[5 + 3 * i]
            pose[i] = up[i] + r0 * own[0] + r1 * own[1] + r2 * own[2]
            for k in range(3):
                pose[3 + 3 * k + i] = r0 * own[3 + 3 * k] + r1 * own[4 + 3 * k] + r2 * own[5 + 3 * k]
        while j >= 0:
            if bodies.slides[j]:
                poses.motion_bounds[b, j] = 1.0
            else:
                up = poses.joints[j]
                x, y, z = pose[0] - up[0], pose[1] - up[1], pose[2] - up[2]
                x, y, z = up[13] * z - up[14] * y, up[14] * x - up[12] * z, up[12] * y - up[13] * x
                poses.motion_bounds[b, j] = math.sqrt(x * x + y * y + z * z) + own[_BALL]
            j = bodies.parents[j]


@compiled(lean=True, inline=True)
def _nearest(pose: Floats1, solid: Floats1, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the point of a box nearest to (x, y, z), both relative to its center, in the world's axes [m].

    `pose` has shape (12,), `solid` shape (SOLID,).
    """
    u = v = w = 0.0
    for i in range(3):
        h, k = solid[_HALF + i], 3 + 3 * i
        if h > 0.0:
            along = min(max(x * pose[k] + y * pose[k + 1] + z * pose[k + 2], -h), h)
            u, v, w = u + along * pose[k], v + along * pose[k + 1], w + along * pose[k + 2]
    return u, v, w


@compiled(lean=True, inline=True)
def _extent(pose: Floats1, solid: Floats1, x: float, y: float, z: float) -> float:
    """Return sum_i h_i |a_i . n| of a box [m], n = (x, y, z); pose shape (12,), solid shape (SOLID,)."""
    total = 0.0
    for i in range(3):
        h, k = solid[_HALF + i], 3 + 3 * i
        if h > 0.0:
            total += h * abs(x * pose[k] + y * pose[k + 1] + z * pose[k + 2])
    return total


@compiled(lean=True, inline=True)
def _of_balls(bodies: Bodies, poses: Poses, pair: int) -> float:
    """Return a lower bound of the distance of a pair [m], from the bounding spheres of its bodies."""
    a, b = bodies.pairs[pair, 0], bodies.pairs[pair, 1]
    here, there = poses.bodies[a], poses.bodies[b]
    x, y, z = here[0] - there[0], here[1] - there[1], here[2] - there[2]
    if bodies.flat[b]:
        apart = x * there[9] + y * there[10] + z * there[11]
    else:
        apart = math.sqrt(x * x + y * y + z * z) - bodies.solids[b, _BALL]
    return apart - bodies.solids[a, _BALL] - bodies.paddings[pair]


@compiled(lean=True)
def _of_solids(bodies: Bodies, poses: Poses, pair: int, known: float, enough: float) -> tuple[float, float]:
    """Return a lower and an upper bound of the distance of a pair [m], from its solids.

    Args:
        bodies: The bodies.
        poses: Their poses.
        pair: Index of the pair.
        known: A lower bound that is known [m].
        enough: A lower bound that suffices, at which the search ends [m].

    Returns:
        The bounds; the upper one is infinite for bodies that are not their solids.
    """
    a, b = bodies.pairs[pair, 0], bodies.pairs[pair, 1]
    here, there, first, second = poses.bodies[a], poses.bodies[b], bodies.solids[a], bodies.solids[b]
    exact, padding = bodies.exact[a] and bodies.exact[b], bodies.paddings[pair]
    x, y, z = there[0] - here[0], there[1] - here[1], there[2] - here[2]
    if bodies.flat[b]:
        low = -(x * there[9] + y * there[10] + z * there[11]) - first[_RADIUS] - padding
        low = max(known, low - _extent(here, first, there[9], there[10], there[11]))
        return low, low if exact else math.inf
    radii = first[_RADIUS] + second[_RADIUS] + padding
    low, high = known, math.inf
    px = py = pz = 0.0
    for _ in range(_STEPS):
        qx, qy, qz = _nearest(there, second, px - x, py - y, pz - z)
        qx, qy, qz = qx + x, qy + y, qz + z
        px, py, pz = _nearest(here, first, qx, qy, qz)
        nx, ny, nz = qx - px, qy - py, qz - pz
        apart = math.sqrt(nx * nx + ny * ny + nz * nz)
        if apart < _HERE:
            break
        extents = _extent(here, first, nx, ny, nz) + _extent(there, second, nx, ny, nz)
        low = max(low, (x * nx + y * ny + z * nz - extents) / apart - radii)
        if exact:
            high = apart - radii
        if low >= enough or apart - radii - low < _TIGHT:
            break
    return low, high


@compiled(lean=True, inline=True)
def _approach(bodies: Bodies, motion_bounds: Floats2, steps: Floats2, pair: int) -> tuple[float, float]:
    """Return how much nearer a pair may come [m] in two sets of maximum joint steps, shape (2, J)."""
    one = two = 0.0
    for e in range(bodies.first[pair], bodies.first[pair + 1]):
        j = bodies.joints[e]
        bound = motion_bounds[bodies.pairs[pair, bodies.sides[e]], j]
        one, two = one + bound * steps[0, j], two + bound * steps[1, j]
    return one, two


@compiled(lean=True)
def _steps(path: Floats2, start: int, end: int, middle: int, steps: Floats1) -> None:
    """Write the maximum distance of each joint from its middle, shape (J,) [rad or m]; path: shape (T, J)."""
    for j in range(steps.size):
        steps[j] = 0.0
    for i in range(start, end):
        for j in range(steps.size):
            steps[j] = max(steps[j], abs(path[i, j] - path[middle, j]))


@compiled(lean=True)
def _later(times: Floats1, start: int, end: int, middle: int) -> float:
    """Return the maximum time after the middle configuration's [s]; times: shape (T,)."""
    later = 0.0
    for i in range(start, end):
        later = max(later, times[i] - times[middle])
    return later


@compiled(lean=True)
def _place(bodies: Bodies, path: Floats2, poses: Poses, search: ClearanceSearch) -> None:
    """Place the open pairs at the middle of an interval, and write the steps to its halves; path: (T, J)."""
    at = search.at
    middle = at[MIDDLE]
    for b in range(poses.used.size):
        poses.used[b] = False
    for i in range(at[OPEN]):
        for side in range(2):
            poses.used[bodies.pairs[search.pair[i], side]] = True
    _place_joints(bodies, path[middle], poses)
    _place_bodies(bodies, poses)
    _steps(path, at[START], middle, middle, search.steps[0])
    _steps(path, middle + 1, at[END], middle, search.steps[1])


@compiled(lean=True)
def _close(search: ClearanceSearch, limit: float) -> None:
    """Remove open pairs that stay farther apart than a limit in the whole interval."""
    at, count = search.at, 0
    for i in range(at[OPEN]):
        if search.low[i] - max(search.near[i, 0], search.near[i, 1]) < limit:
            _move(search, i, count)
            count += 1
    at[OPEN] = count


@compiled(lean=True, inline=True)
def _move(search: ClearanceSearch, i: int, k: int) -> None:
    """Exchange two open pairs."""
    search.pair[i], search.pair[k] = search.pair[k], search.pair[i]
    search.low[i], search.low[k] = search.low[k], search.low[i]
    search.high[i], search.high[k] = search.high[k], search.high[i]
    for half in range(2):
        search.near[i, half], search.near[k, half] = search.near[k, half], search.near[i, half]


@compiled(lean=True)
def _look(bodies: Bodies, path: Floats2, times: Floats1, poses: Poses, search: ClearanceSearch) -> None:
    """Bound the distances of the open pairs in the middle of an interval, and select the pairs to measure.

    A pair is closed if it stays farther apart than the least distance found, or than the upper bound of
    another pair's distance in this middle.  `path` has shape (T, J), `times` shape (T,).
    """
    at, count = search.at, 0
    middle = at[MIDDLE]
    least, time = search.best[0], times[middle]
    before = _later(times, at[START], middle, middle)
    after = _later(times, middle + 1, at[END], middle)
    for i in range(at[OPEN]):
        pair = search.pair[i]
        lost = time * bodies.growth[pair]
        one, two = _approach(bodies, poses.motion_bounds, search.steps, pair)
        one, two = one + before * bodies.growth[pair], two + after * bodies.growth[pair]
        enough = least + ROUNDING + max(one, two) + lost
        low, high = _of_balls(bodies, poses, pair), math.inf
        if low < enough:
            low, high = _of_solids(bodies, poses, pair, low, enough)
        if low < enough:
            search.pair[count], search.low[count], search.high[count] = pair, low - lost, high - lost
            search.near[count, 0], search.near[count, 1] = one, two
            least = min(least, high - lost)
            count += 1
    at[OPEN] = count
    _close(search, least + ROUNDING)
    at[TO_MEASURE] = 0
    for i in range(at[OPEN]):
        most = max(search.near[i, 0], search.near[i, 1])
        if search.low[i] < least + ROUNDING or search.high[i] - search.low[i] > max(_TIGHT, _LOOSE * most):
            k = at[TO_MEASURE]
            _move(search, i, k)
            at[TO_MEASURE] += 1
            while k > 0 and search.low[k] < search.low[k - 1]:
                _move(search, k, k - 1)
                k -= 1


@compiled(lean=True)
def _take(search: ClearanceSearch, count: int) -> bool:
    """Select the next interval of `count` configurations and its open pairs; False if none is left."""
    at, limit = search.at, search.best[0] + ROUNDING
    if at[NEXT] < count:
        at[START], at[END] = at[NEXT], min(at[NEXT] + FIRST, count)
        at[NEXT], at[OPEN], at[IN_FIRST] = at[END], search.pair.size, 1
        for i in range(search.pair.size):
            search.pair[i] = i
        return True
    at[IN_FIRST] = 0
    which, stretch = -1, search.roots[0]
    while at[WAITING] and which < 0:
        at[WAITING] -= 1
        stretch = search.waiting[at[WAITING]]
        at[TOP] = stretch[2]
        if search.waiting_bounds[at[WAITING]] < limit:
            which = at[WAITING]
    if which < 0:
        bound = limit
        for i in range(at[ROOTS]):
            if search.roots[i, 3] > 0 and search.root_bounds[i] < bound:
                which, bound = i, search.root_bounds[i]
        if which < 0:
            return False
        stretch = search.roots[which]
    at[START], at[END], at[OPEN] = stretch[0], stretch[1], 0
    for k in range(stretch[2], stretch[2] + stretch[3]):
        if search.kept_bounds[k] < limit:
            search.pair[at[OPEN]] = search.kept[k]
            at[OPEN] += 1
    stretch[3] = 0
    return True


@compiled(lean=True)
def _bound(search: ClearanceSearch, half: int) -> float:
    """Return a lower bound of the distances of the pairs that are open in a half interval [m]."""
    bound = math.inf
    for i in range(search.at[OPEN]):
        if search.near[i, half] > _STILL:
            bound = min(bound, search.low[i] - search.near[i, half])
    return bound


@compiled(lean=True)
def _keep(search: ClearanceSearch, half: int, bound: float) -> None:
    """Queue a half of the current interval, with the pairs that are open there."""
    at, limit = search.at, search.best[0] + ROUNDING
    start, end = (at[START], at[MIDDLE]) if half == 0 else (at[MIDDLE] + 1, at[END])
    if bound >= limit or start >= end:
        return
    stretch = search.waiting[at[WAITING]]
    if at[IN_FIRST]:
        stretch = search.roots[at[ROOTS]]
        search.root_bounds[at[ROOTS]] = bound
        at[ROOTS] += 1
    else:
        search.waiting_bounds[at[WAITING]] = bound
        at[WAITING] += 1
    stretch[0], stretch[1], stretch[2] = start, end, at[TOP]
    for i in range(at[OPEN]):
        own = search.low[i] - search.near[i, half]
        if own < limit and search.near[i, half] > _STILL:
            search.kept[at[TOP]], search.kept_bounds[at[TOP]] = search.pair[i], own
            at[TOP] += 1
    stretch[3] = at[TOP] - stretch[2]


@compiled("int64(Bodies, float64[:, ::1], float64[::1], Poses, ClearanceSearch)")
def search_least(bodies: Bodies, path: Floats2, times: Floats1, poses: Poses, search: ClearanceSearch) -> int:
    """Search for the minimum distance along a path until distances have to be measured.

    Intervals of the path are halved, each with its open pairs, the lowest bound first, until no bound is
    below the least distance found by more than `ROUNDING`.

    Args:
        bodies: The bodies and pairs.
        path: Coordinates of the joints, shape (T, J) [rad or m].
        times: Times of the configurations [s], shape (T,).
        poses: Workspace.
        search: State of the search, changed.  Before it continues, the caller writes the measured distances
            to `low` (distances above the minimum may be left out), and the minimum to `best`.

    Returns:
        DONE, MEASURE or GROW.
    """
    at = search.at
    while True:
        if at[PAUSED]:
            at[PAUSED] = 0
        else:
            if at[TOP] + 2 * search.pair.size > search.kept.size:
                return GROW
            if not _take(search, path.shape[0]):
                return DONE
            at[MIDDLE] = (at[START] + at[END]) // 2
            _place(bodies, path, poses, search)
            _look(bodies, path, times, poses, search)
            if at[TO_MEASURE]:
                at[PAUSED] = 1
                return MEASURE
        first, second = _bound(search, 0), _bound(search, 1)
        nearer = 0 if first < second else 1
        _keep(search, 1 - nearer, max(first, second))
        _keep(search, nearer, min(first, second))  # the next
