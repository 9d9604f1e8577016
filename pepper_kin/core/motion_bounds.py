"""Motion bounds: proven bounds on the motion of a body's points, from the tree of joints and their ranges.

Turning joint j by a small angle moves a point by that angle times the point's distance from the joint's axis.
The *lever* of the joint is the greatest such distance over all points that it carries and all positions of
the joints between, each within its range; no point of the body then moves by more than sum_j lever_j |dq_j|,
on any way within the ranges.  The lever of a joint that slides is 1.

A point is followed from the joint that carries it towards the root, as a ball that holds it at all positions
of the passed joints within their ranges.  Turning about an axis by angles within m - h .. m + h takes a point
at the distance s from the axis along an arc, which lies in the ball of radius s around the foot of the
perpendicular, for h < pi / 2 in the ball of radius s sin h around the middle of the arc's chord, and in a
ball around the joint's origin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Floats3, Ints1

_FOOT, _CHORD, _ORIGIN, _NEARER = range(4)  # which ball holds an arc; the last: the one that reaches less far
_WAYS = 4
_ROUNDING = 1.0 + 1e-9


class MotionTree(NamedTuple):
    """Joints, parents before children, and bodies, each within the convex hull of some balls.

    Attributes:
        parents: Parent of each joint, -1 for none, shape (J,).
        rotations: Rotation of each joint's frame in its parent's at zero, shape (J, 3, 3).
        offsets: Origin of each joint's frame in its parent's at zero [m], shape (J, 3).
        axes: Unit axis of each joint in its own frame, shape (J, 3).
        slides: Whether a joint slides, shape (J,).
        carriers: The joint that carries each body, -1 for the base, shape (B,).
        first: Number of the first ball of each body, and the number of balls, shape (B + 1,).
        centers: The balls, in the frames of the joints that carry them [m], shape (K, 3).
        radii: Their radii [m], shape (K,).
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
    """Write a vector turned about a unit axis, all of shape (3,), by Rodrigues' formula."""
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
    """Replace a ball in a joint's frame by one in the parent's that holds it at all positions of the joint.

    Args:
        tree: Joints and bodies.
        joint: The joint.
        low: Least position [rad or m].
        high: Greatest position.
        which: _FOOT, _CHORD, _ORIGIN or _NEARER.
        ball: Center and radius, overwritten, shape (4,) [m].
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
    """Return the greatest distance of a point of a ball, shape (4,), from a joint's axis [m]."""
    axis = tree.axes[joint]
    along = axis[0] * ball[0] + axis[1] * ball[1] + axis[2] * ball[2]
    square = 0.0
    for i in range(3):
        square += (ball[i] - along * axis[i]) ** 2
    return math.sqrt(square) + ball[3]


@compiled("void(MotionTree, float64[::1], float64[::1], float64[:, ::1])")
def body_motion_bounds(tree: MotionTree, lower: Floats1, upper: Floats1, motion_bounds: Floats2) -> None:
    """Write a bound of each joint's lever for each body.

    The distance from an axis is a convex function, so that it is greatest in one of the balls whose hull
    holds the body.  Of the ways to follow a ball, the one that bounds a lever best counts.

    Args:
        tree: Joints and bodies.
        lower: Lower ends of the joints' ranges, shape (J,) [rad or m]; may be infinite.
        upper: Upper ends, shape (J,).
        motion_bounds: Written, shape (B, J) [m/rad or 1]; 0 where a joint does not move a body, infinite
            where a joint between slides without limits.
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
