"""Which solids are compared with which, in classes and groups that share a bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.fast.solids import BOX, OTHER, Solid, parts_of, solid_of
from pepper_kin.collision.fast.spheres import Spheres, spheres_of
from pepper_kin.collision.scene import Scene
from pepper_kin.model import PepperModel
from pepper_kin.model.shapes import read_only

Pair = tuple[Solid, Solid]


@dataclass(frozen=True, eq=False)
class Structure:
    """What is compared.

    Attributes:
        solids: The robot's solids.
        objects: The scene's solids.
        classes: Pairs (places in `solids`) of the robot with itself, by parts of the robot.
        groups: Places in `solids` of what moves against the scene: solids of one joint that are compared with
            the same objects.
        compared: For each group, which objects it is compared with, shape (groups, objects).
        resting: Numbers of the checker's pairs that never move against one another.
    """

    solids: tuple[Solid, ...]
    objects: tuple[Solid, ...]
    classes: tuple[tuple[tuple[int, int], ...], ...]
    groups: tuple[tuple[int, ...], ...]
    compared: np.ndarray
    resting: tuple[int, ...]

    @property
    def supported(self) -> bool:
        """Whether all solids of the robot have bounds."""
        return all(solid.kind != OTHER for solid in self.solids)


def structure_of(checker: CollisionChecker) -> Structure:
    """Sort the pairs that a checker compares: at all margins the same, which planners try several of."""
    return _structure(checker.pepper, checker.scene)


@lru_cache(maxsize=32)
def _structure(pepper: PepperModel, scene: Scene) -> Structure:
    checker = checker_for(pepper, scene)
    parts = parts_of(checker)
    all_solids = tuple(solid_of(part) for part in parts)
    count = sum(not part.in_world for part in parts)
    limbs = _limbs(checker.pepper)
    classes: dict[tuple[int, int], list[tuple[int, int]]] = {}
    met: dict[int, set[int]] = {}
    resting = []
    for number, (i, j) in enumerate(zip(*checker._pairs, strict=True)):
        a, b = all_solids[i].joint, all_solids[j].joint
        if a == b:
            resting.append(number)
        elif j < count:
            classes.setdefault((limbs[a], limbs[b]), []).append((int(i), int(j)))
        else:
            met.setdefault(int(i), set()).add(int(j) - count)
    groups: dict[tuple[int, frozenset[int]], list[int]] = {}
    for i, objects in met.items():
        groups.setdefault((all_solids[i].joint, frozenset(objects)), []).append(i)
    compared = np.zeros((len(groups), len(all_solids) - count), dtype=bool)
    for row, (_, together) in zip(compared, groups, strict=True):
        row[list(together)] = True
    return Structure(
        all_solids[:count],
        all_solids[count:],
        tuple(tuple(pairs) for pairs in classes.values()),
        tuple(tuple(group) for group in groups.values()),
        compared,
        tuple(resting),
    )


def _limbs(pepper: PepperModel) -> list[int]:
    """Return for each joint the limb to which it belongs.

    From the world to the first joint that carries several, each joint is a limb; beyond, all that hangs on
    one of those is.
    """
    parents = list(pepper.inner_model.parents)
    children = [[c for c in range(1, len(parents)) if parents[c] == j] for j in range(len(parents))]
    limbs = [-1] * len(parents)
    joint = limbs[0] = 0
    while len(children[joint]) == 1:
        joint = children[joint][0]
        limbs[joint] = joint
    for j in range(1, len(parents)):
        if limbs[j] < 0:
            limbs[j] = j if parents[j] == joint else limbs[parents[j]]
    return limbs


def coarse(pairs: Sequence[Pair]) -> list[Pair]:
    """Return fewer pairs, which are near one another wherever any of the pairs given is.

    Solids of one joint become a ball, unless they are few and would fill it badly.
    """
    sides: dict[tuple[int, int], tuple[dict[Solid, None], dict[Solid, None]]] = {}
    for a, b in pairs:
        first, second = sides.setdefault((a.joint, b.joint), ({}, {}))
        first[a] = second[b] = None
    result: dict[tuple[object, ...], Pair] = {}
    for first, second in sides.values():
        small, large = sorted((list(first), list(second)), key=_spheres_needed)
        if not all(solid.segment for solid in large):
            small, large = large, small
        if all(solid.segment for solid in small) and len(small) > 3:
            small = [ball(tuple(small))]
        whole = ball(tuple(large)) if all(solid.segment for solid in large) else None
        for solid in small:
            for other in [whole] if whole is not None else large:
                key = tuple((s.joint, s.kind, *s.position, *s.half, s.radius) for s in (solid, other))
                result[key] = (solid, other)
    return list(result.values())


def _spheres_needed(solids: Sequence[Solid]) -> tuple[bool, int]:
    return all(s.segment for s in solids), sum(len(spheres_of(s).outer) for s in solids)


@lru_cache(maxsize=1024)
def ball(solids: tuple[Solid, ...]) -> Solid:
    """Return a sphere that holds solids of one joint, nearly the smallest (Badoiu and Clarkson, 2003)."""
    points, radii = [], []
    for solid in solids:
        corners = solid.half * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        points.append(np.unique(corners, axis=0) @ solid.rotation.T + solid.position)
        radii += [solid.radius] * len(points[-1])
    corners, reaches = np.concatenate(points), np.array(radii)
    center = corners.mean(axis=0)
    for k in range(60):
        furthest = np.argmax(np.linalg.norm(corners - center, axis=1) + reaches)
        center = center + (corners[furthest] - center) / (k + 2)
    radius = float((np.linalg.norm(corners - center, axis=1) + reaches).max())
    return Solid(
        "", solids[0].joint, read_only(np.eye(3)), read_only(center), BOX, read_only(np.zeros(3)), radius,
        read_only(np.zeros((0, 3))),
    )  # fmt: skip


def group_spheres(solids: Sequence[Solid]) -> Spheres:
    """Return the spheres of several solids together."""
    parts = [spheres_of(solid) for solid in solids]
    return Spheres(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
