"""How far any point of a part of the robot can move when the joints do."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.fast.solids import Array, Solid
from pepper_kin.collision.fast.structure import Structure
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.alignment import joint_axis


def part_levers(pepper: PepperModel, structure: Structure) -> Array:
    """Return for each class of pairs and each group to the scene how far it moves per unit of each joint.

    A point p of a body moves by at most |dq_j| l_j for each joint j on the way to it.  Of a revolute joint,
    l_j is the greatest distance of p from its axis, which is at most the distance of the next joint's origin
    from the axis, plus the lengths from joint to joint (with the travel of those that slide), plus the
    distance of p from the last joint's origin.  Of a prismatic joint it is 1.  Two bodies come nearer by at
    most the sum over the joints between them.

    Returns:
        Shape (classes + groups, n) [m/rad, or 1]; infinite where a joint that slides has no limits.
    """
    reaches = _Reaches(pepper)
    rows = []
    for pairs in structure.classes:
        row = np.zeros(reaches.count)
        for i, j in pairs:
            a, b = structure.solids[i], structure.solids[j]
            shared = set(reaches.path(a.joint)) & set(reaches.path(b.joint))
            row = np.maximum(row, reaches.of(a, shared) + reaches.of(b, shared))
        rows.append(row)
    for group in structure.groups:
        rows.append(np.max([reaches.of(structure.solids[i], set()) for i in group], axis=0))
    full = np.array(rows).reshape(-1, reaches.count)
    gains = np.abs(pepper.full_map)
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(
            np.where(full[:, :, None] > 0, full[:, :, None] * gains[None], 0.0), posinf=np.inf
        ).sum(axis=1)


def moved_by(pepper: PepperModel, structure: Structure) -> np.ndarray:
    """Return which joints move the two sides of a part against one another, shape (classes + groups, n)."""
    return part_levers(pepper, structure) > 0


class _Reaches:
    """Lengths along the tree of `pinocchio_model`."""

    def __init__(self, pepper: PepperModel) -> None:
        self._known: dict[Solid, Array] = {}
        model = self._model = pepper.pinocchio_model
        self.count = model.njoints - 1
        axes = [joint_axis(model.joints[j]) for j in range(1, model.njoints)]
        self._axes = [np.zeros(3), *(axis for axis, _ in axes)]
        self._slides = [False, *(slides for _, slides in axes)]
        widest = np.maximum(np.abs(model.lowerPositionLimit), np.abs(model.upperPositionLimit))
        self._travel = [0.0, *(float(w) if s else 0.0 for w, (_, s) in zip(widest, axes, strict=True))]

    def path(self, joint: int) -> list[int]:
        """Return the joints from the world to this one."""
        chain = []
        while joint > 0:
            chain.append(joint)
            joint = int(self._model.parents[joint])
        return chain[::-1]

    def of(self, solid: Solid, shared: set[int]) -> Array:
        """Return how far the solid moves per unit of each joint, but for those in `shared`."""
        if solid not in self._known:
            levers = self._known[solid] = np.zeros(self.count)
            path = self.path(solid.joint)
            for place, joint in enumerate(path):
                levers[joint - 1] = 1.0 if self._slides[joint] else self._lever(path[place:], solid)
        result = self._known[solid].copy()
        result[[joint - 1 for joint in shared]] = 0.0
        return result

    def _lever(self, path: list[int], solid: Solid) -> float:
        axis = self._axes[path[0]]
        if len(path) == 1:
            return self._from_axis(solid, axis)
        lever = 0.0
        for place, joint in enumerate(path[1:]):
            step = np.array(self._model.jointPlacements[joint].translation)
            lever += float(np.linalg.norm(np.cross(axis, step) if place == 0 else step)) + self._travel[joint]
        return lever + float(np.linalg.norm(_corners(solid), axis=1).max()) + solid.radius

    def _from_axis(self, solid: Solid, axis: Array) -> float:
        return float(np.linalg.norm(np.cross(axis, _corners(solid)), axis=1).max()) + solid.radius


def _corners(solid: Solid) -> Array:
    """Return the corners of the box around a solid's core, in the frame of its joint."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return np.asarray((signs * solid.half) @ solid.rotation.T + solid.position)
