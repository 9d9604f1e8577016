"""Which solids are compared with which, in classes and groups that share a bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.fast.ball_cover import ball_around, ball_cover
from pepper_kin.collision.fast.solids import HULL, OTHER, Array, Solid, parts_of, solid_of
from pepper_kin.collision.scene import Scene
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False)
class Structure:
    """What is compared.

    Attributes:
        solids: The robot's solids.
        objects: The scene's solids.
        classes: Pairs (places in `solids`) of the robot with itself, by parts of the robot.
        groups: Places in `solids` of what moves against the scene: solids of one joint that are compared with
            the same objects, joint by joint, those of the world last.
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
    in_order = sorted(groups, key=lambda group: group[0] or len(limbs))
    compared = np.zeros((len(groups), len(all_solids) - count), dtype=bool)
    for row, (_, together) in zip(compared, in_order, strict=True):
        row[list(together)] = True
    return Structure(
        all_solids[:count],
        all_solids[count:],
        tuple(tuple(pairs) for pairs in classes.values()),
        tuple(tuple(groups[group]) for group in in_order),
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


def roles(first: Solid, second: Solid) -> tuple[Solid, Solid]:
    """Return of a pair the solid of which the balls are compared and the one that is taken as it is."""
    order = sorted((first, second), key=lambda s: (not s.segment, len(ball_cover(s).outer)))
    return order[0], order[1]


def bounding_ball(solids: Sequence[Solid]) -> tuple[Array, float]:
    """Return centre, in the frame of their joint, and radius of a ball that holds solids of one joint [m]."""
    points, radii = [], []
    for solid in solids:
        corners = solid.vertices
        if solid.kind != HULL:
            corners = np.unique(solid.half * _SIGNS, axis=0)
        points.append(corners @ solid.rotation.T + solid.position)
        radii += [solid.radius] * len(corners)
    return ball_around(np.concatenate(points), np.array(radii))


_SIGNS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
