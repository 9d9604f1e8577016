"""Kernels and the block of constants for one robot, scene and margins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.collision.checker import LEVER, CollisionChecker
from pepper_kin.collision.fast.expression import SLACK, pair_bounds, reaches, solid_poses, sphere_centers
from pepper_kin.collision.fast.levers import moved_by
from pepper_kin.collision.fast.solids import OTHER, Array, Solid
from pepper_kin.collision.fast.structure import Structure, ball, coarse, group_spheres, structure_of
from pepper_kin.collision.fast.tables import pack_tables
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.broad_phase import OBJECT_SIZE
from pepper_kin.core.collision.layout import LANES, POSE_LANES, ROOM, VECTOR_BYTES
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, RobotMemory, robot_digest

if TYPE_CHECKING:
    import casadi

SOURCES = (
    "pepper_kin.symbolic",
    "pepper_kin.model",
    *(f"pepper_kin.collision.fast.{name}" for name in ("expression", "spheres", "structure")),
)
"""Modules on which the kernels depend, besides the solids."""
NO_INNER = -1e3
"""Inner radius of a sphere that lies in nothing [m]."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What compiled checking needs.

    Attributes:
        structure: What is compared.
        sections: Constants and room, as `layout.pack` takes them.
        kernels: Kept alive for their addresses.
        moved_by: Which joints move the two sides of a part against one another, shape (classes + groups, n).
    """

    structure: Structure
    sections: dict[int, Array]
    kernels: tuple[Kernel, ...]
    moved_by: NDArray[np.bool_]


class _Kernels:
    """Kernels of a structure.

    Args:
        pepper: The robot.
        structure: What is compared.
    """

    def __init__(self, pepper: PepperModel, structure: Structure) -> None:
        solids = structure.solids
        self._pepper, self._robot = pepper, robot_digest(pepper)
        self.classes = [[(solids[i], solids[j]) for i, j in pairs] for pairs in structure.classes]
        self.near = [coarse(pairs) for pairs in self.classes]
        members = [[solids[i] for i in group] for group in structure.groups]
        self.moved_by = moved_by(pepper, structure)
        self.balls, self.spheres = (
            [ball(tuple(group)) for group in members],
            [group_spheres(g) for g in members],
        )
        self.radii = [
            [_radius(fine), _radius(rough)] for fine, rough in zip(self.classes, self.near, strict=True)
        ]
        self.by_class = [self._class_kernel(pairs) for pairs in self.classes]
        centers = [*([b.position] for b in self.balls), *(s.centers for s in self.spheres)]
        carriers = [*self.balls, *(group[0] for group in members)]
        self.by_place: dict[int, Kernel] = {
            at.POSE_KERNEL: self._compiled(
                "float64", ("poses", *map(_key, solids)), lambda: solid_poses(pepper, solids)
            )
        }
        if self.near:
            key = ("near", *(tuple(map(_pair_key, pairs)) for pairs in self.near))
            self.by_place[at.NEAR_KERNEL] = self._compiled(
                "float32", key, lambda: pair_bounds(pepper, self.near, inner=False)
            )
        if members:
            key = ("centers", *(tuple(map(_key, group)) for group in members))
            self.by_place[at.CENTER_KERNEL] = self._compiled(
                "float32", key, lambda: sphere_centers(pepper, carriers, centers)
            )

    @property
    def all(self) -> tuple[Kernel, ...]:
        """All kernels."""
        return (*self.by_class, *self.by_place.values())

    def _class_kernel(self, pairs: list[tuple[Solid, Solid]]) -> Kernel:
        key = ("class", *map(_pair_key, pairs))
        return self._compiled("float32", key, lambda: pair_bounds(self._pepper, [pairs]))

    def _compiled(self, dtype: str, what: object, make: Callable[[], casadi.Function]) -> Kernel:
        return compile_function(
            make,
            dtype=dtype,
            key=f"collision {what!r} of {self._robot} by {source_digest(*SOURCES)}",
            vector_bytes=VECTOR_BYTES,
            batch=False,
        )


def prepare(checker: CollisionChecker) -> Prepared:
    """Compile or load the kernels of a checker's robot and pack its tables."""
    like = checker.shapes_of
    found = _shared.get(like)
    if found is None:
        structure = structure_of(like)
        kernels = _kernels_of(like.pepper, structure)
        sections = {**_constants(like, structure, kernels), **_room(like.pepper, structure, kernels)}
        found = _shared[like] = structure, kernels, sections
    structure, kernels, sections = found
    sections = {**sections, **_of_margins(checker, structure, kernels)}
    return Prepared(structure, sections, kernels.all, kernels.moved_by)


_shared: WeakKeyDictionary[CollisionChecker, tuple[Structure, _Kernels, dict[int, Array]]] = (
    WeakKeyDictionary()
)
"""What checkers of the same shapes share, whatever their margins."""
_kept: RobotMemory[object, _Kernels] = RobotMemory()


def _kernels_of(pepper: PepperModel, structure: Structure) -> _Kernels:
    """Return the kernels of a structure; scenes with the same things in the robot's hands share them."""
    key = (tuple(map(_key, structure.solids)), structure.classes, structure.groups)
    kept = _kept.of(pepper)
    if key not in kept:
        kept[key] = _Kernels(pepper, structure)
    return kept[key]


def _numbers(checker: CollisionChecker, structure: Structure, kernels: _Kernels) -> Array:
    numbers = np.zeros(at.NUMBERS_SIZE)
    numbers[at.N], numbers[at.CLASSES] = checker.pepper.n, len(structure.classes)
    numbers[at.GROUPS], numbers[at.OBJECT_COUNT] = len(structure.groups), len(structure.objects)
    numbers[at.SPHERES] = sum(len(s.outer) for s in kernels.spheres)
    numbers[at.SELF_MARGIN], numbers[at.MARGIN] = checker.self_margin, checker.margin
    for place, one in kernels.by_place.items():
        numbers[place] = one.single_address if place == at.POSE_KERNEL else one.block_address
    numbers[at.POSE_LANES_KERNEL] = kernels.by_place[at.POSE_KERNEL].block_address
    return numbers


def _of_margins(checker: CollisionChecker, structure: Structure, kernels: _Kernels) -> dict[int, Array]:
    """Return the sections that depend on margins."""
    balls, spheres, margin = kernels.balls, kernels.spheres, checker.margin
    outer = np.array([*(b.radius for b in balls), *(r for s in spheres for r in s.outer)]) + SLACK + margin
    inner = np.array([*(NO_INNER for _ in balls), *(r for s in spheres for r in s.inner)])
    inner = np.where(inner > SLACK, inner - SLACK + margin, NO_INNER)
    heads, tables, cells = pack_tables(checker._ranges, checker.self_margin / LEVER)
    return {
        at.NUMBERS: _numbers(checker, structure, kernels),
        at.TABLE_HEADS: heads,
        at.TABLES: tables,
        at.TABLE_CELLS: cells,
        at.REACH: _singles(np.repeat(np.concatenate([outer, inner]), LANES)),
    }


def _constants(checker: CollisionChecker, structure: Structure, kernels: _Kernels) -> dict[int, Array]:
    """Return the sections that do not change, whatever the margins."""
    spheres = kernels.spheres
    every = [*structure.solids, *structure.objects]
    members = [(g, i) for g, group in enumerate(structure.groups) for i in group]
    return {
        at.CLASS_KERNELS: np.array([k.block_address for k in kernels.by_class], dtype=float),
        at.CLASS_ACTIVE: np.ones(len(structure.classes)),
        at.CLASS_RADII: np.array(kernels.radii, dtype=float),
        at.PAIR_FIRST: _firsts(structure.classes),
        at.PAIRS: np.array([pair for pairs in structure.classes for pair in pairs], dtype=float),
        at.SOLIDS: np.array([[s.kind, s.radius, s.bounding_radius, s.filled] for s in every], dtype=float),
        at.SOLID_HALF: np.array([s.half for s in every]),
        at.GROUP_FIRST: _firsts([s.outer for s in spheres]),
        at.GROUP_SOLIDS: np.array(members, dtype=float),
        at.GROUP_RADII: np.array([s.outer.max() + SLACK for s in spheres]),
        at.OBJECTS: np.array([_object_row(s, OBJECT_SIZE) for s in structure.objects]),
        at.OBJECT_BOXES: _singles(np.array([_world_box(s) for s in structure.objects]).ravel()),
        at.GROUP_OBJECTS: structure.compared.T.astype(float),
        at.VERTEX_FIRST: _firsts([s.vertices for s in every]),
        at.VERTICES: np.concatenate([np.zeros((0, 3)), *(s.vertices for s in every)]),
        at.FROZEN: np.zeros(checker.pepper.n),
        at.FREE: np.arange(checker.pepper.n, dtype=float),
        at.EFFORT: np.full(checker.pepper.n, np.inf),
    }


def _room(pepper: PepperModel, structure: Structure, kernels: _Kernels) -> dict[int, Array]:
    n = pepper.n
    classes, work = len(structure.classes), max(one.work_size for one in kernels.all)
    gravity_work = kernel(pepper, "gravity_torque").work_size  # compiled validity asks it too
    points = len(kernels.balls) + sum(len(s.outer) for s in kernels.spheres)
    posed = 12 * len(structure.solids) * POSE_LANES
    poses = [np.zeros(12 * len(structure.solids)), *(_pose(s) for s in structure.objects)]
    return {
        at.POSES: np.concatenate(poses),
        at.ROWS: np.zeros(ROOM * n),
        at.STATUS: np.zeros(ROOM),
        at.DOUBT_CLASSES: np.zeros(ROOM),
        at.DOUBT_GROUPS: np.zeros(ROOM),
        at.QUEUE: np.zeros(ROOM * (classes + 1)),
        at.QUEUE_LENGTH: np.zeros(classes),
        at.LANES_IN: np.zeros((n + 1) * LANES),
        at.LANES_OUT: np.zeros(max((2 * classes + 3 * points + n) * LANES, posed)),
        at.LANES_WORK: np.zeros(work),
        at.WORLD: np.zeros((points + 2) * LANES),
        at.SINGLE_WORK: np.zeros(max(work, gravity_work)),
    }


def _radius(pairs: list[tuple[Solid, Solid]]) -> float:
    """Return the greatest sum of radii that a bound of these pairs subtracts [m]."""
    return max(reach for pair in pairs for reach in reaches(*pair)) + SLACK


def _firsts(parts: Any) -> Array:
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(float)


def _singles(values: Array) -> Array:
    """Return floats in the room of doubles."""
    padded = np.zeros(values.size + values.size % 2, dtype=np.float32)
    padded[: values.size] = values
    return padded.view(np.float64)


def _pose(solid: Solid) -> Array:
    """Return centre, x, y and z axis of a solid of the scene."""
    return np.concatenate([solid.position, solid.rotation.T.ravel()])


def _object_row(solid: Solid, size: int) -> Array:
    row = np.zeros(size)
    half = np.where(np.isfinite(solid.half), solid.half, 1e6) if solid.kind == OTHER else solid.half
    exact = solid.kind not in (OTHER,) and solid.vertices.size == 0
    row[:18] = [solid.kind, solid.radius, exact, *half, *_pose(solid)]
    return row


def _world_box(solid: Solid) -> Array:
    """Return the least and the greatest corner of the box along the world's axes around a solid."""
    half = np.where(np.isfinite(solid.half), solid.half, 1e6)
    reach = np.abs(solid.rotation) @ half + solid.radius
    return np.concatenate([solid.position - reach, solid.position + reach])


def _key(solid: Solid) -> tuple[object, ...]:
    return (
        solid.joint, solid.kind, tuple(map(tuple, solid.rotation.tolist())), tuple(solid.position.tolist()),
        tuple(solid.half.tolist()), solid.radius, solid.vertices.tobytes(),
    )  # fmt: skip


def _pair_key(pair: tuple[Solid, Solid]) -> tuple[object, ...]:
    return _key(pair[0]), _key(pair[1])
