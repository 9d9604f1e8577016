"""Motion bounds of the parts of a robot, and of pairs of parts."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.fast.solids import Solid
from pepper_kin.collision.fast.structure import ComparedParts
from pepper_kin.collision.motion_tree import Hull, motion_bounds_of
from pepper_kin.model import PepperModel
from pepper_kin.model.moving_tree import moving_tree


def part_motion_bounds(pepper: PepperModel, structure: ComparedParts) -> Array:
    """Return the motion bounds of each class of pairs and of each group to the scene, by joint.

    Two bodies come nearer by at most the sum over the joints that carry one of them and not the other; how
    far a joint moves a body is bounded by `pepper_kin.core.motion_bounds`.

    Returns:
        Bounds, shape (classes + groups, n) [m/rad, or 1]; infinite if a prismatic joint has no limits.
    """
    motion_bounds = motion_bounds_of(pepper, [Hull(s.joint, _corners(s), s.radius) for s in structure.solids])
    carried = moving_tree(pepper).carried()[[solid.joint for solid in structure.solids]]
    rows = []
    for pairs in structure.classes:
        one, other = np.array(pairs).T
        apart = np.where(carried[one] & carried[other], 0.0, motion_bounds[one] + motion_bounds[other])
        rows.append(apart.max(axis=0))
    rows += [motion_bounds[list(group)].max(axis=0) for group in structure.groups]
    full = np.array(rows).reshape(-1, motion_bounds.shape[1])
    gains = np.abs(pepper.full_map)
    return np.where(gains > 0, np.where(gains > 0, full[:, :, None], 0.0) * gains, 0.0).sum(axis=1)


def _corners(solid: Solid) -> Array:
    """Return the corners of the box around a solid's core, in the frame of its joint."""
    return np.asarray((_SIGNS * solid.half) @ solid.rotation.T + solid.position)


_SIGNS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
