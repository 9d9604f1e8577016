"""Kernels and the block of constants for one robot, scene and margins."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.collision.checker import LEVER, CollisionChecker
from pepper_kin.collision.fast import layout as at
from pepper_kin.collision.fast.expression import SLACK, pair_bounds, reaches, solid_poses, sphere_centers
from pepper_kin.collision.fast.options import LANES, ROOM
from pepper_kin.collision.fast.solids import OTHER, Array, Solid
from pepper_kin.collision.fast.structure import Structure, ball, coarse, group_spheres, structure_of
from pepper_kin.collision.fast.tables import pack_tables
from pepper_kin.collision.fast.world import OBJECT_SIZE
from pepper_kin.kernels import Kernel, compile_function

if TYPE_CHECKING:
    import casadi

NO_INNER = -1e3
"""Inner radius of a sphere that lies in nothing [m]."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What compiled checking needs.

    Attributes:
        structure: What is compared.
        sections: Constants and room, as `layout.pack` takes them.
        kernels: Kept alive for their addresses.
    """

    structure: Structure
    sections: dict[int, Array]
    kernels: tuple[Kernel, ...]


def prepare(checker: CollisionChecker) -> Prepared:
    """Compile or load the kernels of a checker's robot and pack its tables."""
    pepper, structure = checker.pepper, structure_of(checker)
    solids = structure.solids
    classes = [[(solids[i], solids[j]) for i, j in pairs] for pairs in structure.classes]
    members = [[solids[i] for i in group] for group in structure.groups]
    balls, spheres = [ball(group) for group in members], [group_spheres(group) for group in members]

    def compiled(dtype: str, what: object, make: Callable[[], casadi.Function]) -> Kernel:
        return compile_function(
            make, dtype=dtype, key=f"collision {what!r} of {_robot(pepper)} by {_source_digest()}"
        )

    by_class = [
        compiled(
            "float32", ("class", *map(_pair_key, pairs)), lambda pairs=pairs: pair_bounds(pepper, [pairs])
        )
        for pairs in classes
    ]
    near = [coarse(pairs) for pairs in classes]
    near_key = ("near", *(tuple(map(_pair_key, pairs)) for pairs in near))
    kernels = {
        at.NEAR_KERNEL: compiled("float32", near_key, lambda: pair_bounds(pepper, near, inner=False)) if near else None,
        at.CENTER_KERNEL: compiled(
            "float32",
            ("centers", *(tuple(map(_key, group)) for group in members)),
            lambda: sphere_centers(
                pepper,
                [*balls, *(group[0] for group in members)],
                [*([b.position] for b in balls), *(s.centers for s in spheres)],
            ),
        ) if members else None,
        at.POSE_KERNEL: compiled("float64", ("poses", *map(_key, solids)), lambda: solid_poses(pepper, solids)),
    }  # fmt: skip
    numbers = np.zeros(at.NUMBERS_SIZE)
    numbers[at.N], numbers[at.CLASSES], numbers[at.GROUPS] = pepper.n, len(classes), len(members)
    numbers[at.SPHERES] = sum(len(s.outer) for s in spheres)
    numbers[at.OBJECT_COUNT] = len(structure.objects)
    numbers[at.SELF_MARGIN], numbers[at.MARGIN] = checker.self_margin, checker.margin
    for place, kernel in kernels.items():
        if kernel is not None:
            numbers[place] = kernel.single_address if place == at.POSE_KERNEL else kernel.block_address
    outer = np.array([*(b.radius for b in balls), *(r for s in spheres for r in s.outer)])
    inner = np.array([*(NO_INNER for _ in balls), *(r for s in spheres for r in s.inner)])
    outer, inner = (
        outer + SLACK + checker.margin,
        np.where(inner > SLACK, inner - SLACK + checker.margin, NO_INNER),
    )
    heads, tables, cells = pack_tables(checker._ranges, checker.self_margin / LEVER)
    every = [*solids, *structure.objects]
    widest = max([k.work_size for k in by_class] + [k.work_size for k in kernels.values() if k is not None])
    width = 2 * len(classes) + 3 * len(outer) + pepper.n + 8
    sections: dict[int, Array] = {
        at.NUMBERS: numbers,
        at.CLASS_KERNELS: np.array([k.block_address for k in by_class], dtype=float),
        at.CLASS_ACTIVE: np.ones(len(classes)),
        at.CLASS_RADII: np.array(
            [[_radius(pairs), _radius(rough)] for pairs, rough in zip(classes, near, strict=True)]
        ),
        at.TABLE_HEADS: heads,
        at.TABLES: tables,
        at.TABLE_CELLS: cells,
        at.PAIR_FIRST: _firsts(classes),
        at.PAIRS: np.array([pair for pairs in structure.classes for pair in pairs], dtype=float),
        at.SOLIDS: np.array([[s.kind, s.radius, s.bounding_radius, s.filled] for s in every], dtype=float),
        at.SOLID_HALF: np.array([s.half for s in every]),
        at.GROUP_FIRST: _firsts([s.outer for s in spheres]),
        at.GROUP_SOLIDS: np.array(
            [(g, i) for g, group in enumerate(structure.groups) for i in group], dtype=float
        ),
        at.GROUP_RADII: np.array([s.outer.max() + SLACK for s in spheres]),
        at.REACH: _singles(np.repeat(np.concatenate([outer, inner]), LANES)),
        at.OBJECTS: np.array([_object_row(s, OBJECT_SIZE) for s in structure.objects]),
        at.OBJECT_BOXES: _singles(np.array([_world_box(s) for s in structure.objects]).ravel()),
        at.GROUP_OBJECTS: structure.compared.T.astype(float),
        at.VERTEX_FIRST: _firsts([s.vertices for s in every]),
        at.VERTICES: np.concatenate([np.zeros((0, 3)), *(s.vertices for s in every)]),
        at.POSES: np.concatenate([np.zeros(12 * len(solids)), *(_pose(s) for s in structure.objects)]),
        at.FROZEN: np.zeros(pepper.n),
        at.FREE: np.arange(pepper.n, dtype=float),
        at.EFFORT: np.full(pepper.n, np.inf),
        at.ROWS: np.zeros(ROOM * pepper.n),
        at.STATUS: np.zeros(ROOM),
        at.DOUBT_CLASSES: np.zeros(ROOM),
        at.DOUBT_GROUPS: np.zeros(ROOM),
        at.QUEUE: np.zeros(ROOM * (len(classes) + 1)),
        at.QUEUE_LENGTH: np.zeros(len(classes)),
        at.LANES_IN: np.zeros((pepper.n + 1) * LANES),
        at.LANES_OUT: np.zeros(width * LANES),
        at.LANES_WORK: np.zeros(widest),
        at.WORLD: np.zeros((len(outer) + 2) * LANES),
        at.SINGLE_WORK: np.zeros(widest),
    }
    kept = tuple(k for k in (*by_class, *kernels.values()) if k is not None)
    return Prepared(structure, sections, kept)


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
    """Return the least and the greatest corner of the box around a solid of the scene, along the world's axes."""
    half = np.where(np.isfinite(solid.half), solid.half, 1e6)
    reach = np.abs(solid.rotation) @ half + solid.radius
    return np.concatenate([solid.position - reach, solid.position + reach])


def _key(solid: Solid) -> tuple[object, ...]:
    return (
        solid.joint, solid.kind, solid.rotation.tolist(), solid.position.tolist(), solid.half.tolist(), solid.radius,
    )  # fmt: skip


def _pair_key(pair: tuple[Solid, Solid]) -> tuple[object, ...]:
    return _key(pair[0]), _key(pair[1])


def _robot(pepper: Any) -> str:
    return hashlib.sha256(pepper.urdf.encode()).hexdigest()


@lru_cache(maxsize=1)
def _source_digest() -> str:
    digest = hashlib.sha256()
    for room in ("symbolic", "model", "collision.fast"):
        for file in sorted(files(f"pepper_kin.{room}").iterdir(), key=lambda f: f.name):
            if file.name.endswith(".py"):
                digest.update(file.read_bytes())
    return digest.hexdigest()
