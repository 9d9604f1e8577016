"""Body frames for short expressions: z along the joint's axis, origins that make translations sparse.

A frame that is fixed to a moving body may be chosen freely.  With z along the joint's axis a rotation by the
joint costs six operations instead of fifteen; with the origin moved along the axis to the point nearest to
the neighboring axis, most components of the translations between joints are zero (Denavit and Hartenberg,
1955).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model.moving_tree import MovingTree
from pepper_kin.model.shapes import cross_product, product

SNAP = 1e-11
"""Distance from 0 or 1 below which entries of constant rotations are rounded: URDFs round pi / 2."""


class Alignment(NamedTuple):
    """A body's frame relative to the joint frame of `PepperModel.pinocchio_model`.

    Attributes:
        rotation: (3, 3), columns are the axes of the body's frame in the joint's frame.
        origin: (3,), origin of the body's frame in the joint's frame [m].
    """

    rotation: Array
    origin: Array

    def place(self, rotation: Array, translation: Array) -> tuple[Array, Array]:
        """Convert a placement in the joint's frame to one in the body's frame.

        Args:
            rotation: Rotation matrix to the joint's frame, shape (3, 3).
            translation: Origin in the joint's frame [m], shape (3,).

        Returns:
            Rotation matrix, shape (3, 3), and origin [m], shape (3,), in the body's frame.
        """
        return product(self.rotation.T, rotation), product(self.rotation.T, translation - self.origin)


def snapped(rotation: Array, tolerance: float = SNAP) -> Array:
    """Return an array, shape (3, 3) or (3,), with entries near 0, 1 or -1 rounded to these values.

    Args:
        rotation: Rotation matrix, or a unit vector.
        tolerance: Maximum distance of an entry that is rounded.
    """
    nearest = np.round(rotation)
    return np.where(np.abs(rotation - nearest) < tolerance, nearest, rotation) + 0.0


def align(tree: MovingTree, shift_origins: bool) -> list[Alignment]:
    """Return the frames of all bodies, chosen for short expressions.

    Args:
        tree: Moving joints of the robot.
        shift_origins: Whether origins may move along the joints' axes.

    Returns:
        Alignment of each joint, without the world.
    """
    rotations = [np.eye(3)]
    for i in range(1, tree.count):
        rotations.append(_rotation(tree, i, rotations[tree.parents[i]]))
    origins = np.zeros((tree.count, 3))
    if shift_origins:
        _shift(tree, rotations, origins)
    return [Alignment(r, o) for r, o in zip(rotations, origins, strict=True)][1:]


def _rotation(tree: MovingTree, i: int, parent: Array) -> Array:
    """Return the axes of body i: z along the joint, x such that the constant rotations have most zeros.

    Args:
        tree: Moving joints of the robot.
        i: Index of the joint.
        parent: Axes of the parent body in its joint's frame, as columns, shape (3, 3).

    Returns:
        The axes in the joint's frame, as columns, shape (3, 3).
    """
    axis = snapped(tree.axes[i])
    placed = product(parent.T, tree.rotations[i])
    children = [c for c in range(1, tree.count) if tree.parents[c] == i]
    turns = [product(tree.rotations[c], tree.axes[c]) for c in children]
    guides = [np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], *placed, cross_product(placed[2], axis), *turns]
    best, most = np.eye(3), -1
    for guide in guides:
        x = guide - axis * _along(axis, guide)
        length = math.sqrt(_along(x, x))
        if length < 1e-3:
            continue
        x = snapped(x / length)
        axes = np.array([x, cross_product(axis, x), axis]).T.copy()
        zeros = np.sum(snapped(product(placed, axes)) == 0)
        zeros += sum(np.sum(np.abs(product(axes.T, turn)) < SNAP) for turn in turns)
        if zeros > most:
            best, most = axes, zeros
    return best


def _along(first: Array, second: Array) -> float:
    """Return the scalar product of two vectors, shape (3,), rounded alike on every processor."""
    return float(first[0] * second[0] + first[1] * second[1] + first[2] * second[2])


def _shift(tree: MovingTree, rotations: list[Array], origins: Array) -> None:
    """Move origins along their axes, one at a time, where it makes translations sparser.

    Args:
        tree: Moving joints of the robot.
        rotations: Axes of each body in its joint's frame, as columns, shape (3, 3) each.
        origins: Origin of each body in its joint's frame [m], shape (njoints, 3); changed in place.
    """

    def translation(child: int) -> Array:
        parent = tree.parents[child]
        inside = product(tree.rotations[child], origins[child]) + tree.positions[child] - origins[parent]
        return product(rotations[parent].T, inside)

    def fills(joints: list[int]) -> int:
        return sum(int(np.sum(np.abs(translation(j)) > 1e-12)) for j in joints)

    for _ in range(3):
        for i in range(1, tree.count):
            if tree.slides[i]:
                continue
            axis = tree.axes[i]
            edges = [i, *(c for c in range(1, tree.count) if tree.parents[c] == i)]
            start = origins[i].copy()
            along = product(rotations[tree.parents[i]].T, product(tree.rotations[i], axis))
            here = translation(i)
            steps = [-here[k] / along[k] for k in range(3) if abs(along[k]) > 1e-3]
            own = product(rotations[i].T, rotations[i])
            steps += [float(product(own, translation(c))[2]) for c in edges[1:]]
            best, fewest = start, fills(edges)
            for step in steps:
                origins[i] = start + step * axis
                if fills(edges) < fewest:
                    best, fewest = origins[i].copy(), fills(edges)
            origins[i] = best
