"""The block of constants for one robot, scene and margins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.collision.checker import LEVER, CollisionChecker
from pepper_kin.collision.fast.ball_cover import ball_cover
from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.collision.fast.rounding import Rounding
from pepper_kin.collision.fast.solids import OTHER, Array, Solid
from pepper_kin.collision.fast.structure import Structure, bounding_ball, roles, structure_of
from pepper_kin.collision.fast.tables import pack_tables
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.ball_check import (
    BALL_SINGLES,
    BLOCK,
    BODY_WORDS,
    CORE_LANES,
    CORE_SINGLES,
    FRAME_SINGLES,
    GROUP_WORDS,
    LINK_WORDS,
    OBJECT_SINGLES,
    POINT,
    RANGE_WORDS,
    SEGMENT,
    SIDE_WORDS,
)
from pepper_kin.core.collision.layout import BOX, CYLINDER, HULL, ROOM
from pepper_kin.kernels.lanes import LANES
from pepper_kin.model import PepperModel, RobotMemory
from pepper_kin.symbolic.tree import read_tree

NO_INNER = -1e3
"""Inner radius of a ball that lies in nothing [m]."""
MOST_AXES = 8192
"""Pairs of solids of which the direction that parted them last is kept; of more, some share theirs."""
POSE = 12
"""Numbers of a pose."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What compiled checking needs.

    Attributes:
        structure: What is compared.
        sections: Constants and room, as `layout.pack` takes them.
        carried: Which coordinates of the Pinocchio model carry each body, the world last, shape (bodies, nv).
        bodies_of_solids: Which body each solid of the robot belongs to, shape (solids,).
    """

    structure: Structure
    sections: dict[int, Array]
    carried: NDArray[np.bool_]
    bodies_of_solids: NDArray[np.int64]


class _Tables:
    """The tables of bodies, groups, balls, cores and pairs; the world is the last body."""

    def __init__(self, pepper: PepperModel, structure: Structure) -> None:
        self._structure, self._tree = structure, read_tree(pepper, compact=True)
        tree, solids = self._tree, structure.solids
        count = len(tree.bodies)
        self.bodies = np.zeros((count + 1, BODY_WORDS), np.int64)
        self.frames = np.zeros((count + 1, FRAME_SINGLES))
        self._balls: list[Array] = []
        self._cores: list[list[float]] = []
        self._range_of: dict[int, tuple[int, int]] = {}
        self._cores_of: dict[int, tuple[int, int]] = {}
        groups_of: dict[int, list[int]] = {}
        for g, members in enumerate(structure.groups):
            groups_of.setdefault(solids[members[0]].joint, []).append(g)
        full_rows = _full_rows(pepper)
        for b in range(count + 1):
            joint = b + 1 if b < count else 0
            if b < count:
                body = tree.bodies[b]
                source, gain, offset = full_rows[b]
                self.bodies[b, :4] = body.parent + 1, body.slides, source, 1
                self.frames[b] = [
                    *np.array(body.rotation, dtype=float).ravel(),
                    *body.translation,
                    gain,
                    offset,
                ]
            self._add_body(b, [i for i, s in enumerate(solids) if s.joint == joint], groups_of.get(joint, []))
        self.groups = np.array([self._group(members) for members in structure.groups], np.int64).reshape(
            -1, GROUP_WORDS
        )
        place = 0
        for b in range(count + 1):
            joint = b + 1 if b < count else 0
            self.bodies[b, 4], place = place, place + len(groups_of.get(joint, []))
            self.bodies[b, 5] = place
        self.balls = np.array(self._balls).reshape(-1, BALL_SINGLES)
        self.cores = np.array(self._cores).reshape(-1, CORE_SINGLES)
        self.links, self.sides, self.ranges = self._pairs()
        every = np.arange(count + 1)
        of_bodies = np.repeat(every, self.bodies[:, 8] - self.bodies[:, 6])
        self.ball_bodies = np.concatenate([of_bodies, self.groups[:, 0]])
        self.core_bodies = np.repeat(every, self.bodies[:, 10] - self.bodies[:, 9])

    def _local(self, solid: Solid, points: Any) -> Array:
        """Return points of the frame of a solid's joint in the frame of its body."""
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        if solid.joint == 0:
            return points
        alignment = self._tree.alignments[solid.joint - 1]
        return np.asarray((points - alignment.origin) @ alignment.rotation)

    def _bounding(self, solids: list[Solid]) -> Array:
        center, radius = bounding_ball(solids)
        return np.array([*self._local(solids[0], center)[0], radius, NO_INNER])

    def _add_body(self, b: int, own: list[int], groups: list[int]) -> None:
        solids = self._structure.solids
        none = np.array([0.0, 0.0, 0.0, NO_INNER, NO_INNER])
        self.bodies[b, 6] = len(self._balls)
        self._balls.append(self._bounding([solids[i] for i in own]) if own else none)
        in_groups = [i for g in groups for i in self._structure.groups[g]]
        self.bodies[b, 7] = len(self._balls)
        for i in (*in_groups, *(i for i in own if i not in in_groups)):
            first, cover = len(self._balls), ball_cover(solids[i])
            inner = np.where(cover.inner > 0.0, cover.inner, NO_INNER)
            self._balls += list(np.column_stack([self._local(solids[i], cover.centers), cover.outer, inner]))
            self._range_of[i] = first, len(self._balls)
        self.bodies[b, 8] = len(self._balls)
        self.bodies[b, 9] = len(self._cores)
        for i in own:
            first = len(self._cores)
            self._cores += self._cores_of_solid(i)
            self._cores_of[i] = first, len(self._cores)
        self.bodies[b, 10] = len(self._cores)

    def _cores_of_solid(self, i: int) -> list[list[float]]:
        """Return the rows of a solid in CORES: a segment, a box, or its balls as points."""
        solid = self._structure.solids[i]
        if solid.kind in (HULL, CYLINDER):
            rows = self._balls[slice(*self._range_of[i])]
            return [[POINT, row[3], row[4], 0.0, 0.0, 0.0, *row[:3], *np.eye(3).ravel()] for row in rows]
        kind = BLOCK if not solid.segment else SEGMENT if solid.half[2] > 0.0 else POINT
        turn = np.eye(3) if solid.joint == 0 else self._tree.alignments[solid.joint - 1].rotation
        center = self._local(solid, solid.position)[0]
        radii = solid.radius, solid.radius if solid.filled else NO_INNER
        return [[kind, *radii, *solid.half, *center, *(turn.T @ solid.rotation).T.ravel()]]

    def _group(self, members: tuple[int, ...]) -> tuple[int, ...]:
        structure = self._structure
        joint = structure.solids[members[0]].joint
        body = joint - 1 if joint else len(self._tree.bodies)
        coarse = len(self._balls)
        self._balls.append(self._bounding([structure.solids[i] for i in members]))
        return body, coarse, self._range_of[members[0]][0], self._range_of[members[-1]][1], 0, 0

    def _pairs(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return the sections LINKS, SIDES and RANGES."""
        solids, world = self._structure.solids, len(self._tree.bodies)
        links: list[list[int]] = []
        sides: list[list[int]] = []
        ranges: list[list[int]] = []
        for c, pairs in enumerate(self._structure.classes):
            by_bodies: dict[tuple[int, int], dict[int, list[int]]] = {}
            for i, j in pairs:
                covered, exact = (i, j) if roles(solids[i], solids[j])[0] is solids[i] else (j, i)
                a, b = ((solids[k].joint - 1) % (world + 1) for k in (covered, exact))
                by_bodies.setdefault((a, b), {}).setdefault(exact, []).append(covered)
            for (a, b), by_exact in by_bodies.items():
                first_side = len(sides)
                for exact, all_covered in by_exact.items():
                    first = len(ranges)
                    for begin, end in sorted(self._range_of[k] for k in all_covered):
                        if len(ranges) > first and ranges[-1][1] == begin:
                            ranges[-1][1] = end
                        else:
                            ranges.append([begin, end])
                    sides += [[core, first, len(ranges)] for core in range(*self._cores_of[exact])]
                coarse = self.bodies[[a, b], 6]
                links.append([a, coarse[0], b, coarse[1], 0, c, first_side, len(sides)])
        shapes = (LINK_WORDS, SIDE_WORDS, RANGE_WORDS)
        return tuple(  # type: ignore[return-value]
            np.array(rows, np.int64).reshape(-1, width)
            for rows, width in zip((links, sides, ranges), shapes, strict=True)
        )


@dataclass(frozen=True, eq=False)
class _Robot:
    """What scenes share in which the same solids are compared in the same groups.

    Attributes:
        tables: Balls and cores.
        rounding: What single precision may be wrong by.
        sections: Constants and room that do not depend on the scene.
        carried: See `Prepared`.
        bodies_of_solids: See `Prepared`.
    """

    tables: _Tables
    rounding: Rounding
    sections: dict[int, Array]
    carried: NDArray[np.bool_]
    bodies_of_solids: NDArray[np.int64]


def prepare(checker: CollisionChecker) -> Prepared:
    """Pack the tables of a checker."""
    like = checker.shapes_of
    found = _shared.get(like)
    if found is None:
        structure = structure_of(like)
        robot = _robot_of(like.pepper, structure)
        slack = robot.rounding.comparing(structure)
        sections = {**robot.sections, **_of_scene(structure, robot, slack)}
        found = _shared[like] = structure, robot, slack, sections
    structure, robot, slack, sections = found
    sections = {**sections, **_of_margins(checker, structure, robot, slack)}
    return Prepared(structure, sections, robot.carried, robot.bodies_of_solids)


_shared: WeakKeyDictionary[CollisionChecker, tuple[Structure, _Robot, float, dict[int, Array]]] = (
    WeakKeyDictionary()
)
"""What checkers of the same shapes share, whatever their margins."""
_kept: RobotMemory[object, _Robot] = RobotMemory()


def _robot_of(pepper: PepperModel, structure: Structure) -> _Robot:
    key = (tuple(map(_key, structure.solids)), structure.classes, structure.groups)
    kept = _kept.of(pepper)
    if key not in kept:
        tables = _Tables(pepper, structure)
        sections = {**_of_robot(pepper, structure, tables), **_room(pepper, structure, tables)}
        joints = np.array([solid.joint for solid in structure.solids], np.int64)
        bodies = np.where(joints > 0, joints - 1, len(tables.bodies) - 1)
        kept[key] = _Robot(tables, Rounding(pepper, structure), sections, _carried(pepper), bodies)
    return kept[key]


def _key(solid: Solid) -> tuple[object, ...]:
    numbers = (solid.rotation, solid.position, solid.half, solid.vertices)
    return solid.joint, solid.kind, solid.radius, solid.filled, *(values.tobytes() for values in numbers)


def _full_rows(pepper: PepperModel) -> Array:
    """Return of each coordinate of the Pinocchio model the one of q on which it depends, gain and offset."""
    gains, rows = np.asarray(pepper.full_map), np.zeros((len(pepper.full_offset), 3))
    rows[:, 0] = np.abs(gains).argmax(axis=1)
    rows[:, 1] = gains[np.arange(len(gains)), rows[:, 0].astype(int)]
    rows[:, 2] = pepper.full_offset
    return rows


def _carried(pepper: PepperModel) -> NDArray[np.bool_]:
    model = pepper.inner_model
    carried = np.zeros((model.njoints, model.njoints - 1), dtype=bool)
    for joint in range(1, model.njoints):
        carried[joint - 1, [k - 1 for k in model.supports[joint].tolist() if k > 0]] = True
    return carried


def _of_margins(
    checker: CollisionChecker, structure: Structure, robot: _Robot, slack: float
) -> dict[int, Array]:
    """Return the sections that depend on margins."""
    tables = robot.tables
    numbers = np.zeros(at.NUMBERS_SIZE)
    numbers[at.N], numbers[at.CLASS_COUNT] = checker.pepper.n, len(structure.classes)
    numbers[at.GROUP_COUNT], numbers[at.OBJECT_COUNT] = len(structure.groups), len(structure.objects)
    numbers[at.BODY_COUNT], numbers[at.LINK_COUNT] = len(tables.bodies), len(tables.links)
    numbers[at.SELF_MARGIN], numbers[at.MARGIN] = checker.self_margin, checker.margin
    heads, ranges, cells = pack_tables(checker._ranges, checker.self_margin / LEVER)
    cores = tables.cores.copy()
    wrong = robot.rounding.placed[tables.core_bodies]
    cores[:, 1] += checker.self_margin + wrong
    cores[:, 2] += checker.self_margin - wrong
    return {
        at.NUMBERS: numbers,
        at.TABLE_HEADS: heads,
        at.TABLES: ranges,
        at.TABLE_CELLS: cells,
        at.OBJECTS: _singles(_object_rows(structure, checker.margin)),
        at.LINKS: _words(_links(robot, slack, checker.self_margin)),
        at.CORES: _singles(cores),
    }


def _links(robot: _Robot, slack: float, margin: float) -> NDArray[np.int64]:
    """Return the section LINKS with the squares of the distances at which coarse balls touch."""
    links = robot.tables.links.copy()
    radii = robot.tables.balls[:, 3] + robot.rounding.placed[robot.tables.ball_bodies] + slack
    reach = radii[links[:, 1]] + radii[links[:, 3]] + margin
    links[:, 4] = (np.maximum(reach, 0.0) ** 2 * (1.0 + 1e-6)).astype(np.float32).view(np.int32)
    return links


def _of_robot(pepper: PepperModel, structure: Structure, tables: _Tables) -> dict[int, Array]:
    """Return the sections of constants that do not depend on the scene."""
    members = [(g, i) for g, group in enumerate(structure.groups) for i in group]
    return {
        at.BODIES: _words(tables.bodies),
        at.FRAMES: _singles(tables.frames),
        at.SIDES: _words(tables.sides),
        at.RANGES: _words(tables.ranges),
        at.JOINTS: joint_table(pepper).copy(),
        at.FULL: _full_rows(pepper),
        at.SOLID_PLACES: np.array([[s.joint, *_pose(s)] for s in structure.solids]),
        at.PAIR_FIRST: _firsts(structure.classes).astype(float),
        at.PAIRS: np.array([pair for pairs in structure.classes for pair in pairs], dtype=float),
        at.GROUP_SOLIDS: np.array(members, dtype=float),
        at.FROZEN: np.zeros(pepper.n),
        at.FREE: np.arange(pepper.n, dtype=float),
        at.EFFORT: np.full(pepper.n, np.inf),
    }


def _of_scene(structure: Structure, robot: _Robot, slack: float) -> dict[int, Array]:
    """Return the sections that depend on the scene but not on margins."""
    tables = robot.tables
    every = [*structure.solids, *structure.objects]
    balls, groups = tables.balls.copy(), tables.groups.copy()
    wrong = robot.rounding.placed[tables.ball_bodies] + slack
    balls[:, 3] += wrong
    balls[:, 4] -= wrong
    lists = [np.flatnonzero(row) for row in structure.compared]
    groups[:, 4:6] = np.stack([_firsts(lists)[:-1], _firsts(lists)[1:]], axis=1)
    pairs, members = sum(map(len, structure.classes)), sum(map(len, structure.groups))
    axes = min(pairs + members * len(structure.objects) + 1, MOST_AXES)
    poses = [np.zeros(POSE * len(structure.solids)), *(_pose(s) for s in structure.objects)]
    return {
        at.GROUPS: _words(groups),
        at.BALLS: _singles(balls),
        at.OBJECT_LISTS: _words(np.concatenate([np.zeros(0, np.int64), *lists])),
        at.SOLIDS: np.array([[s.kind, s.radius, s.bounding_radius, s.filled] for s in every], dtype=float),
        at.SOLID_HALF: np.array([s.half for s in every]),
        at.VERTEX_FIRST: _firsts([s.vertices for s in every]).astype(float),
        at.VERTICES: np.concatenate([np.zeros(0), *(s.vertices.T.ravel() for s in every)]),
        at.GROUP_OBJECTS: structure.compared.T.astype(float),
        at.SOLID_POSES: np.concatenate(poses),
        at.AXES: np.zeros(3 * axes),
    }


def _room(pepper: PepperModel, structure: Structure, tables: _Tables) -> dict[int, Array]:
    n, joints, bodies = pepper.n, pepper.inner_model.njoints, len(tables.bodies)
    gravity = kernel(pepper, "gravity_torque").work_size  # compiled validity asks it too
    identity = np.zeros((bodies + 1, POSE, LANES), np.float32)
    identity[[[0], [bodies]], [0, 4, 8]] = 1.0
    centers = np.zeros((len(tables.balls), 3, LANES), np.float32)
    world = tables.bodies[-1, 6]  # all others are written where bodies are placed
    centers[world] = tables.balls[world, :3, None]
    return {
        at.FLAGS: np.zeros(bodies),
        at.COORDINATES: np.zeros(n * LANES // 2),
        at.POSES: _singles(identity),
        at.CENTERS: _singles(centers),
        at.PLACED: np.zeros(len(tables.cores) * CORE_LANES * LANES // 2),
        at.CLASS_DOUBTS: np.zeros(len(structure.classes)),
        at.GROUP_DOUBTS: np.zeros(len(structure.groups)),
        at.DOUBTFUL: np.zeros(1),
        at.RAMP: _singles(np.arange(1, LANES + 1) / LANES),
        at.ROWS: np.zeros(ROOM * n),
        at.STATUS: np.zeros(ROOM),
        at.QUEUE: np.zeros(ROOM),
        at.ROW_CLASSES: np.zeros(ROOM),
        at.ROW_GROUPS: np.zeros(ROOM),
        at.Q_FULL: np.zeros(joints - 1),
        at.JOINT_POSES: np.zeros(POSE * joints),
        at.JOINT_AXES: np.zeros(3 * joints),
        at.GRAVITY: np.zeros(n + gravity),
    }


def _firsts(parts: Any) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)


def _words(values: NDArray[np.int64]) -> Array:
    """Return integers in the room of doubles."""
    return np.ascontiguousarray(values, np.int64).ravel().view(np.float64)


def _singles(values: NDArray[Any]) -> Array:
    """Return floats in the room of doubles."""
    padded = np.zeros(values.size + values.size % 2, dtype=np.float32)
    padded[: values.size] = values.ravel()
    return padded.view(np.float64)


def _pose(solid: Solid) -> Array:
    """Return centre, x, y and z axis of a solid in the frame of its joint."""
    return np.concatenate([solid.position, solid.rotation.T.ravel()])


def _object_rows(structure: Structure, margin: float) -> Array:
    """Return the section OBJECTS; margins are part of the radii."""
    rows = np.zeros((len(structure.objects), OBJECT_SINGLES))
    for row, solid in zip(rows, structure.objects, strict=True):
        half = np.where(np.isfinite(solid.half), solid.half, 1e6) if solid.kind == OTHER else solid.half
        exact = solid.kind in (BOX, CYLINDER)
        around = min(float(np.linalg.norm(half)), 1e6)
        row[:] = [solid.kind, solid.radius + margin, exact, *half, *_pose(solid), around]
    return rows
