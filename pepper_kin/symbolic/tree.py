"""Kinematic tree as Python floats: frames, translations and inertias."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.moving_tree import moving_tree
from pepper_kin.model.shapes import product
from pepper_kin.symbolic.alignment import Alignment, align, snapped
from pepper_kin.symbolic.bodies import Inertia, SymbolicBody, clean, numbers
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.regrouping import regroup
from pepper_kin.symbolic.vectors import Matrix, Vector


@dataclass(frozen=True, eq=False)
class Tree:
    """The kinematic tree from which expressions are built.

    Attributes:
        bodies: Parents before children; body i is moved by coordinate i of `pinocchio_model`.
        ground: Inertia of moving bodies that base parameters assign to the world (see `regrouping.py`).
        still: Inertia of links fixed to the world.
        alignments: Frame of each body relative to its joint's frame in `pinocchio_model`.
        gravity: Gravity vector [m/s^2].
        armature: Reflected rotor inertia of each coordinate [kg m^2].
        full_map: E of q_full = E q + e, shape (n_full, n).
        full_offset: e, shape (n_full,).
        anchors: Frame name -> body that carries it (-1: the world), rotation and origin in its frame.
    """

    bodies: tuple[SymbolicBody, ...]
    ground: Inertia
    still: Inertia
    alignments: tuple[Alignment, ...]
    gravity: Vector
    armature: tuple[float, ...]
    full_map: Array
    full_offset: Array
    anchors: dict[str, tuple[int, Matrix, Vector]]

    def anchor(self, frame: str) -> tuple[int, Matrix, Vector]:
        """Return the body that carries a frame, and the frame's rotation and origin in that body's frame.

        Raises:
            UnknownNameError: listing all frames.
        """
        try:
            return self.anchors[frame]
        except KeyError:
            raise UnknownNameError("frame", frame, self.anchors) from None

    def path(self, body: int) -> list[int]:
        """Return the bodies from the world to `body`, itself included."""
        chain = []
        while body >= 0:
            chain.append(body)
            body = self.bodies[body].parent
        return chain[::-1]

    @cached_property
    def moving_mass(self) -> float:
        """Mass of all moving bodies [kg]."""
        return self.ground.mass + sum(body.inertia.mass for body in self.bodies)


class BodyFrame(NamedTuple):
    """Frame of a body relative to its parent's.

    Attributes:
        parent: Index of the parent in the tree, -1 for the world.
        slides: Whether the joint is prismatic; both kinds act along the body's z axis.
        rotation: Constant rotation of the frame at q = 0 to the parent's.
        translation: Origin in the parent's frame at q = 0 [m].
    """

    parent: int
    slides: bool
    rotation: Matrix
    translation: Vector


class BodyFrames(NamedTuple):
    """Kinematic tree without masses, read without loading Pinocchio.

    Attributes:
        bodies: Frames of the bodies, parents before children.
        alignments: Frame of each body relative to its joint's frame in `pinocchio_model`.
    """

    bodies: tuple[BodyFrame, ...]
    alignments: tuple[Alignment, ...]


@remembered
def read_frames(pepper: PepperModel, *, compact: bool) -> BodyFrames:
    """Return the frames of the bodies; see `read_tree`."""
    tree = moving_tree(pepper)
    alignments, bodies = align(tree, shift_origins=compact), []
    for i, alignment in enumerate(alignments, start=1):
        parent = tree.parents[i] - 1
        rotation = product(tree.rotations[i], alignment.rotation)
        translation = product(tree.rotations[i], alignment.origin) + tree.positions[i]
        if parent >= 0:
            rotation, translation = alignments[parent].place(rotation, translation)
        translation = np.where(np.abs(translation) < 1e-14, 0.0, translation)
        slides = bool(tree.slides[i])
        bodies.append(BodyFrame(parent, slides, numbers(snapped(rotation)), numbers(translation)))
    return BodyFrames(tuple(bodies), tuple(alignments))


@remembered
def read_tree(pepper: PepperModel, *, compact: bool) -> Tree:
    """Read the kinematic tree of a robot.

    Args:
        pepper: The robot.
        compact: Whether origins may move along joint axes and masses on joint axes move to the parent, for
            the shortest expressions of dynamics; otherwise each body keeps its joint's origin and its mass.
    """
    model, frames = pepper.inner_model, read_frames(pepper, compact=compact)
    bodies = [
        SymbolicBody(*frame, _inertia(inertia, alignment))
        for frame, alignment, inertia in zip(
            frames.bodies, frames.alignments, list(model.inertias)[1:], strict=True
        )
    ]
    nothing = Inertia(0.0, (0.0,) * 3, ((0.0,) * 3,) * 3)
    grouped, ground = regroup(bodies, nothing) if compact else (bodies, nothing)
    return Tree(
        bodies=tuple(grouped),
        ground=ground,
        still=_inertia(model.inertias[0], Alignment(np.eye(3), np.zeros(3))),
        alignments=frames.alignments,
        gravity=numbers(np.array(model.gravity.linear)),
        armature=numbers(np.array(model.armature)),
        full_map=pepper.full_map,
        full_offset=pepper.full_offset,
        anchors=_anchors(pepper, frames.alignments),
    )


def _anchors(pepper: PepperModel, alignments: Sequence[Alignment]) -> dict[str, tuple[int, Matrix, Vector]]:
    """Return each frame as a body and the frame's rotation and origin in that body's frame."""
    tree = moving_tree(pepper)
    anchors: dict[str, tuple[int, Matrix, Vector]] = {}
    for name, pose in tree.frame_poses.items():
        body, rotation, translation = tree.frame_joints[name] - 1, pose[:3, :3], pose[:3, 3]
        if body >= 0:
            rotation, translation = alignments[body].place(rotation, translation)
        anchors[name] = body, numbers(snapped(rotation, 1e-15)), numbers(clean(translation))
    return anchors


def _inertia(inertia: Any, alignment: Alignment) -> Inertia:
    """Return a Pinocchio inertia about the origin and in the axes of a body's frame."""
    mass = float(inertia.mass)
    turn = alignment.rotation
    tensor = product(product(turn.T, np.array(inertia.inertia)), turn)
    lever = product(turn.T, np.array(inertia.lever) - alignment.origin)
    second = (
        (tensor[0, 0] + tensor[1, 1] + tensor[2, 2]) / 2 * np.eye(3) - tensor + mass * np.outer(lever, lever)
    )
    return Inertia(mass, numbers(clean(mass * lever)), numbers(clean(second)))
