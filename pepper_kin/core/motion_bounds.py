"""Motion bounds: proven bounds on the motion of a body's points, from the tree of joints and their ranges.

Rotating joint j by a small angle moves a point by that angle times the point's distance from the joint's
axis. The *motion bound* of the joint is the maximum of this distance over all points that it carries and all
positions of the joints between, each within its range; no point of the body then moves by more than
sum_j bound_j |dq_j|, on any path within the ranges.  The motion bound of a prismatic joint is 1.

A point is followed from the joint that carries it towards the root, as a sphere that contains it at all
positions of the passed joints within their ranges.  Rotating about an axis by angles within m - h .. m + h
moves a point at the distance s from the axis along an arc, which lies in the sphere of radius s around the
foot of the perpendicular, for h < pi / 2 in the sphere of radius s sin h around the middle of the arc's
chord, and in a sphere around the joint's origin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Floats3, Ints1

_FOOT, _CHORD, _ORIGIN, _NEARER = range(4)  # sphere that bounds an arc; _NEARER: the one that reaches least
_WAYS = 4
_ROUNDING = 1.0 + 1e-9


class MotionTree(NamedTuple):
    """Joints, parents before children, and bodies, each within the convex hull of some spheres.

    Attributes:
        parents: Parent of each joint, -1 for none, shape (J,).
        rotations: Rotation of each joint's frame in its parent's at zero, shape (J, 3, 3).
        offsets: Origin of each joint's frame in its parent's at zero [m], shape (J, 3).
        axes: Unit axis of each joint in its own frame, shape (J, 3).
        slides: Whether a joint is prismatic, shape (J,).
        carriers: Joint that carries each body, -1 for the base, shape (B,).
        first: Offset of each body's spheres, and the total number of spheres, shape (B + 1,).
        centers: Centers of the spheres, in the frames of the joints that carry them [m], shape (K, 3).
        radii: Radii of the spheres [m], shape (K,).
    """

    parents: Ints1
    rotations: Floats3
    offsets: Floats2
    axes: Floats2
    slides: Flags1
    carriers: Ints1
    first: Ints1
    centers: Floats2
    radii: Floats1


@compiled
def _turn(axis: Floats1, angle: float, v: Floats1, out: Floats1) -> None:
    """Write a vector rotated about a unit axis, all of shape (3,), by Rodrigues' formula."""
    c, s = math.cos(angle), math.sin(angle)
    along = (axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2]) * (1.0 - c)
    x = c * v[0] + s * (axis[1] * v[2] - axis[2] * v[1]) + along * axis[0]
    y = c * v[1] + s * (axis[2] * v[0] - axis[0] * v[2]) + along * axis[1]
    z = c * v[2] + s * (axis[0] * v[1] - axis[1] * v[0]) + along * axis[2]
    out[0], out[1], out[2] = x, y, z


@compiled
def _reach(tree: MotionTree, joint: int, along: float, share: float, aside: Floats1) -> float:
    """Return the distance of along * axis + share * aside, shape (3,), from the parent's origin [m]."""
    square = 0.0
    for i in range(3):
        value = tree.offsets[joint, i]
        for k in range(3):
            value += tree.rotations[joint, i, k] * (along * tree.axes[joint, k] + share * aside[k])
        square += value * value
    return math.sqrt(square)


@compiled
def _pass_joint(
    tree: MotionTree, joint: int, low: float, high: float, which: int, ball: Floats1, scratch: Floats2
) -> None:
    """Replace a sphere in a joint's frame by one in the parent's that contains it at all joint positions.

    Args:
        tree: Joints and bodies.
        joint: Index of the joint.
        low: Minimum position [rad or m].
        high: Maximum position [rad or m].
        which: _FOOT, _CHORD, _ORIGIN or _NEARER.
        ball: Center and radius of the sphere, overwritten, shape (4,) [m].
        scratch: Workspace, shape (2, 3).
    """
    axis, shift, aside = tree.axes[joint], scratch[0], scratch[1]
    half = 0.5 * (high - low)
    middle = 0.5 * (low + high) if math.isfinite(half) else 0.0
    if tree.slides[joint]:
        for i in range(3):
            shift[i] = ball[i] + middle * axis[i]
        ball[3] += half
    else:
        along = axis[0] * ball[0] + axis[1] * ball[1] + axis[2] * ball[2]
        square = 0.0
        for i in range(3):
            aside[i] = ball[i] - along * axis[i]
            square += aside[i] * aside[i]
        distance, share = math.sqrt(square), 0.0
        radius, kept = distance, along
        if which in (_CHORD, _NEARER) and half < 0.5 * math.pi:
            _turn(axis, middle, aside, aside)
            at_chord = _reach(tree, joint, along, math.cos(half), aside) + distance * math.sin(half)
            if which == _CHORD or at_chord < _reach(tree, joint, along, 0.0, aside) + distance:
                share, radius = math.cos(half), distance * math.sin(half)
        if which in (_ORIGIN, _NEARER):
            around = math.sqrt(square + along * along)
            least = _reach(tree, joint, along, share, aside) + radius
            if which == _ORIGIN or _reach(tree, joint, 0.0, 0.0, aside) + around < least:
                share, radius, kept = 0.0, around, 0.0
        for i in range(3):
            shift[i] = kept * axis[i] + share * aside[i]
        ball[3] += radius
    for i in range(3):
        ball[i] = tree.offsets[joint, i]
        for k in range(3):
            ball[i] += tree.rotations[joint, i, k] * shift[k]


@compiled
def _from_axis(tree: MotionTree, joint: int, ball: Floats1) -> float:
    """Return the maximum distance of a point of a sphere, shape (4,), from a joint's axis [m]."""
    axis = tree.axes[joint]
    along = axis[0] * ball[0] + axis[1] * ball[1] + axis[2] * ball[2]
    square = 0.0
    for i in range(3):
        square += (ball[i] - along * axis[i]) ** 2
    return math.sqrt(square) + ball[3]


@compiled("void(MotionTree, float64[::1], float64[::1], float64[:, ::1])")
def body_motion_bounds(tree: MotionTree, lower: Floats1, upper: Floats1, motion_bounds: Floats2) -> None:
    """Write the motion bound of each joint for each body.

    The distance from an axis is a convex function, so that its maximum is in one of the spheres whose hull
    contains the body.  A sphere is followed in several ways, and the smallest bound of each joint is used.

    Args:
        tree: Joints and bodies.
        lower: Lower limits of the joints, shape (J,) [rad or m]; may be infinite.
        upper: Upper limits of the joints, shape (J,) [rad or m]; may be infinite.
        motion_bounds: Output, shape (B, J) [m/rad or 1]; 0 if a joint does not move a body, infinite if a
            prismatic joint between them has no limits.
    """
    scratch, ball = np.empty((2, 3)), np.empty(4)
    least = np.empty(tree.parents.size)
    for body in range(tree.carriers.size):
        for j in range(tree.parents.size):
            motion_bounds[body, j] = 0.0
        for b in range(tree.first[body], tree.first[body + 1]):
            for which in range(_WAYS):
                for i in range(3):
                    ball[i] = tree.centers[b, i]
                ball[3] = tree.radii[b]
                j = tree.carriers[body]
                while j >= 0:
                    lever = 1.0 if tree.slides[j] else _from_axis(tree, j, ball) * _ROUNDING
                    least[j] = lever if which == 0 else min(least[j], lever)
                    _pass_joint(tree, j, lower[j], upper[j], which, ball, scratch)
                    j = tree.parents[j]
            j = tree.carriers[body]
            while j >= 0:
                motion_bounds[body, j] = max(motion_bounds[body, j], least[j])
                j = tree.parents[j]
