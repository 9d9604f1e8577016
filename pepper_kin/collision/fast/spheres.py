"""Spheres that cover a solid, and spheres inside it."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pepper_kin.collision.fast.solids import BOX, Array, Solid
from pepper_kin.model.shapes import read_only

WASTE = 0.008
"""How much a covering sphere may be larger than the capsule that it helps to cover [m]."""
CELL = 0.11
"""Boxes are cut into cells no longer than this, each of which gets a sphere [m]."""


class Spheres(NamedTuple):
    """Spheres of one solid.

    Attributes:
        centers: (k, 3), in the frame of the joint that carries the solid [m].
        outer: (k,), radii; the spheres together cover the solid [m].
        inner: (k,), radii; each of these spheres lies inside the solid; below zero where none does [m].
    """

    centers: Array
    outer: Array
    inner: Array


@lru_cache(maxsize=4096)  # the solids of a robot are asked for some twenty times each
def spheres_of(solid: Solid, waste: float = WASTE, cell: float = CELL) -> Spheres:
    """Cover a solid by spheres.

    A capsule of radius r gets k spheres with centres on its axis, from one end to the other.  At spacing s
    they cover it if their radius is sqrt(r^2 + (s / 2)^2), while those of radius r about the same centres lie
    inside.  A box is cut into cells, each with the sphere around it; the largest sphere about the cell's
    centre that stays in the box is the inner one.

    Args:
        solid: A solid with bounds.
        waste: Greatest difference of outer and inner radius of a capsule [m].
        cell: Greatest length of a box's cell [m].
    """
    if solid.segment:
        length = 2.0 * float(solid.half[2])
        count, outer = 1, solid.radius + length / 2
        while outer - solid.radius > waste:
            count += 1
            outer = math.hypot(solid.radius, length / (count - 1) / 2)
        along = np.zeros(1) if count == 1 else np.linspace(-length / 2, length / 2, count)
        local = along[:, None] * np.array([0.0, 0.0, 1.0])
        outers, inners = np.full(count, outer), np.full(count, solid.radius)
    else:
        counts = np.maximum(1, np.ceil(2 * solid.half / cell)).astype(int)
        steps = [h / n * np.arange(1 - n, n, 2) for h, n in zip(solid.half, counts, strict=True)]
        local = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        outers = np.full(len(local), float(np.linalg.norm(solid.half / counts)) + solid.radius)
        inside = (solid.half - np.abs(local)).min(axis=1) + solid.radius
        inners = inside if solid.kind == BOX else np.full(len(local), -1.0)
    centers = local @ solid.rotation.T + solid.position
    return Spheres(read_only(centers), read_only(outers), read_only(inners))
