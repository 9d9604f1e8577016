"""Moving joints and their frames: the values of `pinocchio_model`, without loading Pinocchio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.model.digest import kept_for_robot
from pepper_kin.model.kinematic_tree import placed_joints
from pepper_kin.model.tree_order import depth_first

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pepper_kin.model.pepper_model import PepperModel

Rows = list[list[float]]

_NOWHERE: tuple[Rows, list[float]] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0, 0.0, 0.0]


@dataclass(frozen=True, eq=False)
class MovingTree(FrozenArrays):
    """Moving joints, parents before children, in the order of `pinocchio_model`; joint 0 is the world.

    Attributes:
        parents: Index of each joint's parent; the world is its own parent.
        rotations: Rotation from each joint's frame at q = 0 to its parent's frame, shape (joints, 3, 3).
        positions: Origin of each joint's frame in its parent's frame [m], shape (joints, 3).
        axes: Unit axis of each joint in its own frame, shape (joints, 3).
        slides: Whether each joint is prismatic, shape (joints,).
        frame_joints: Index of the joint that carries each frame, by frame name.
        frame_poses: Pose of each frame in its joint's frame [m], shape (4, 4), by frame name.
    """

    parents: tuple[int, ...]
    rotations: NDArray[np.float64]
    positions: NDArray[np.float64]
    axes: NDArray[np.float64]
    slides: NDArray[np.bool_]
    frame_joints: dict[str, int]
    frame_poses: dict[str, NDArray[np.float64]]

    @property
    def count(self) -> int:
        """Number of joints, the world included."""
        return len(self.parents)

    def path(self, joint: int) -> list[int]:
        """Return the indices of the joints from the world, excluded, to a joint, included."""
        found = []
        while joint > 0:
            found.append(joint)
            joint = self.parents[joint]
        return found[::-1]

    def below(self, joint: int) -> list[int]:
        """Return the indices of a joint and all its descendants."""
        return [other for other in range(self.count) if other == joint or joint in self.path(other)]

    def carried(self) -> NDArray[np.bool_]:
        """Return whether each joint, the world included, is moved by each moving joint, shape (joints, n)."""
        carried = np.zeros((self.count, self.count - 1), dtype=bool)
        for joint in range(1, self.count):
            carried[joint, [above - 1 for above in self.path(joint)]] = True
        return carried


@kept_for_robot(most=1)
def moving_tree(pepper: PepperModel) -> MovingTree:
    """Return the moving joints of a robot, from its `with_pinocchio_model` if it has one."""
    changed = pepper.dynamics_model.changed()
    return _of_document(pepper) if changed is None else _of_pinocchio(pepper, changed)


def _of_document(pepper: PepperModel) -> MovingTree:
    """Read the URDF: a joint's placement is the product of the fixed joints' before it and its own."""
    placed, root = placed_joints(pepper.document), pepper.document.root
    frames: dict[str, tuple[int, tuple[Rows, list[float]]]] = {root: (0, _NOWHERE)}
    parents, places, axes, slides = [0], [_NOWHERE], [[0.0, 0.0, 0.0]], [False]
    for joint in depth_first(pepper.document):
        own = placed[joint.child]
        carrier, before = frames[joint.parent]
        place = _product(before, (_rotation(own.rpy.tolist()), own.position.tolist()))
        if joint.type == "fixed":
            frames[joint.child] = carrier, place
        else:
            frames[joint.child] = len(parents), _NOWHERE
            parents.append(carrier)
            places.append(place)
            axes.append(own.axis.tolist())
            slides.append(joint.type == "prismatic")
    return MovingTree(
        tuple(parents),
        read_only([rotation for rotation, _ in places]),
        read_only([position for _, position in places]),
        read_only(axes),
        read_only(slides, bool),
        {name: frames[name][0] for name in pepper.frame_names},
        {name: _pose(*frames[name][1]) for name in pepper.frame_names},
    )


def _of_pinocchio(pepper: PepperModel, model: Any) -> MovingTree:
    """Read placements, axes and frames from a Pinocchio model."""
    frames = {name: model.frames[pepper.frame_id(name)] for name in pepper.frame_names}
    subspaces = [np.zeros(6)]
    for joint in list(model.joints)[1:]:
        subspaces.append(np.asarray(joint.S if hasattr(joint, "S") else joint.createData().S).reshape(6))
    slides = [bool(np.linalg.norm(subspace[:3]) > 0.5) for subspace in subspaces]
    return MovingTree(
        tuple(int(parent) for parent in model.parents),
        read_only([place.rotation for place in model.jointPlacements]),
        read_only([place.translation for place in model.jointPlacements]),
        read_only([s[:3] if slide else s[3:] for s, slide in zip(subspaces, slides, strict=True)]),
        read_only(slides, bool),
        {name: int(frame.parentJoint) for name, frame in frames.items()},
        {name: read_only(frame.placement.homogeneous) for name, frame in frames.items()},
    )


def _pose(rotation: Rows, position: Sequence[float]) -> NDArray[np.float64]:
    """Return a pose [m], shape (4, 4), from a rotation and a position."""
    return read_only([[*row, x] for row, x in zip(rotation, position, strict=True)] + [[0.0, 0.0, 0.0, 1.0]])


def _product(first: tuple[Rows, list[float]], second: tuple[Rows, list[float]]) -> tuple[Rows, list[float]]:
    """Return the product of two placements, summed from left to right on every machine, as in Pinocchio."""
    (a, p), (b, q) = first, second
    rotation = [[r[0] * b[0][j] + r[1] * b[1][j] + r[2] * b[2][j] for j in range(3)] for r in a]
    return rotation, [x + (r[0] * q[0] + r[1] * q[1] + r[2] * q[2]) for x, r in zip(p, a, strict=True)]


def _rotation(rpy: Sequence[float]) -> Rows:
    """Return Rz(yaw) Ry(pitch) Rx(roll) by way of the unit quaternion, as URDF's reader and Eigen do."""
    (sr, cr), (sp, cp), (sy, cy) = [(math.sin(angle / 2.0), math.cos(angle / 2.0)) for angle in rpy]
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    z, w = cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy
    length = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / length, y / length, z / length, w / length
    tx, ty, tz = 2.0 * x, 2.0 * y, 2.0 * z
    xx, xy, xz, xw = tx * x, ty * x, tz * x, tx * w
    yy, yz, yw, zz, zw = ty * y, tz * y, ty * w, tz * z, tz * w
    return [
        [1.0 - (yy + zz), xy - zw, xz + yw],
        [xy + zw, 1.0 - (xx + zz), yz - xw],
        [xz - yw, yz + xw, 1.0 - (xx + yy)],
    ]
