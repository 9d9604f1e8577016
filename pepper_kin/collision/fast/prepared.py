"""The block of constants for one robot, which names that of a scene and the margins."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.collision.checker import LEVER, CollisionChecker
from pepper_kin.collision.dependent_ranges import DependentRange
from pepper_kin.collision.fast.ball_cover import ball_cover
from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.collision.fast.levers import part_levers
from pepper_kin.collision.fast.rounding import Rounding
from pepper_kin.collision.fast.scene_block import (
    SceneBlock,
    firsts,
    scene_block,
    singles,
    solid_sections,
    words,
)
from pepper_kin.collision.fast.solids import Array, Solid
from pepper_kin.collision.fast.structure import (
    MovingParts,
    Structure,
    bounding_ball,
    roles,
    structure_of,
)
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
    POINT,
    RANGE_WORDS,
    SEGMENT,
    SIDE_WORDS,
)
from pepper_kin.core.collision.check import set_margins
from pepper_kin.core.collision.layout import CYLINDER, HULL, ROOM
from pepper_kin.core.collision.scene_rows import NO_INNER, ROW
from pepper_kin.kernels.lanes import LANES
from pepper_kin.model import PepperModel, RobotMemory
from pepper_kin.symbolic.tree import read_tree

MET, MOST_AXES = 16, 2048
"""Objects for each solid, and pairs of solids in all, of which the direction that parted them last is kept;
of more, some share theirs."""
MOST_ROBOTS = 64
"""Robots holding other things that are kept."""
POSE = 12
"""Numbers of a pose."""


@dataclass(frozen=True, eq=False)
class Limited:
    """A robot's blocks for motions of some of its joints; not to be written to.

    Attributes:
        still: Compares only what does not move, without tables of joint ranges.
        moving: Compares only what moves.
        moves: For each body 1 if it moves, the world last.
        local: The blocks of each thread, which all motions share, and whose motion they are ready for.
    """

    still: Array
    moving: Array
    moves: NDArray[np.int64]
    local: threading.local = field(default_factory=threading.local)


@dataclass(frozen=True, eq=False)
class Prepared:
    """What compiled checking needs.

    Attributes:
        structure: What is compared.
        block: The robot's block, of no margins and no scene yet; not to be written to.
        scene: The scene's block.
        margins: Distances to keep, from the scene and between two parts of the robot [m].
        limited: Blocks that compare only what stands, or only what moves, for each choice of free joints.
        local: The block of each thread, which all scenes and margins share, and whose scene it names.
        levers: See `part_levers`.
        carried: Which coordinates of the Pinocchio model carry each body, the world last, shape (bodies, nv).
        bodies_of_solids: Which body each solid of the robot belongs to, shape (solids,).
    """

    structure: Structure
    block: Array
    scene: SceneBlock
    margins: tuple[float, float]
    limited: dict[bytes, Limited]
    local: threading.local
    levers: Array
    carried: NDArray[np.bool_]
    bodies_of_solids: NDArray[np.int64]

    def memory(self) -> Array:
        """Return the block of this thread, which names this scene until another is asked for."""
        local = self.local
        try:
            if local.named is self:
                return np.asarray(local.memory)
        except AttributeError:
            local.memory = at.aligned_copy(self.block)
        local.named = self
        return self.named(local.memory, self.margins)

    def named(self, memory: Array, margins: tuple[float, float]) -> Array:
        """Write the scene and margins into a block; return it."""
        set_margins(memory, *margins, LEVER)
        numbers = at.section(memory, at.NUMBERS)
        numbers[at.SCENE], numbers[at.SCENE_SIZE] = self.scene.address, self.scene.block.size
        return memory


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
        return body, coarse, self._range_of[members[0]][0], self._range_of[members[-1]][1], 1

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


class _Robot:
    """A robot with what it holds, its solids in groups: what scenes share in which the groups are the same.

    Attributes:
        rounding: What single precision may be wrong by.
        carried: See `Prepared`.
        bodies_of_solids: See `Prepared`.
        block: See `Prepared`.
        limited: See `Prepared`.
        local: See `Prepared`.
        levers: See `Prepared`.
    """

    def __init__(self, pepper: PepperModel, structure: Structure, ranges: tuple[DependentRange, ...]) -> None:
        tables, self.rounding = _Tables(pepper, structure), Rounding(pepper, structure.solids)
        self.levers = part_levers(pepper, structure)
        self.block = at.pack(
            {
                **_gaps(self.levers[: len(structure.classes)]),
                **_constants(pepper, structure, tables, self.rounding),
                **_ranges(ranges),
                **_room(pepper, structure, tables),
            }
        )
        self.block.setflags(write=False)
        self.limited: dict[bytes, Limited] = {}
        self.local = threading.local()
        joints = np.array([solid.joint for solid in structure.solids], np.int64)
        self.carried = _carried(pepper)
        self.bodies_of_solids = np.where(joints > 0, joints - 1, len(tables.bodies) - 1)


def prepare(checker: CollisionChecker) -> Prepared:
    """Return the blocks of a checker; those of its scene are the same at all margins."""
    like = checker.shapes_of
    found = _shared.get(like)
    if found is None:
        structure = structure_of(like)
        robot = _robot_of(like.pepper, structure, like._ranges)
        found = _shared[like] = structure, robot, scene_block(structure, robot.rounding)
    structure, robot, scene = found
    margins = checker.margin, checker.self_margin
    own = robot.limited, robot.local, robot.levers, robot.carried, robot.bodies_of_solids
    return Prepared(structure, robot.block, scene, margins, *own)


_shared: WeakKeyDictionary[CollisionChecker, tuple[Structure, _Robot, SceneBlock]] = WeakKeyDictionary()
"""What checkers of the same shapes share, whatever their margins."""
_kept: RobotMemory[tuple[MovingParts, tuple[tuple[int, ...], ...], tuple[DependentRange, ...]], _Robot] = (
    RobotMemory()
)


def _robot_of(pepper: PepperModel, structure: Structure, ranges: tuple[DependentRange, ...]) -> _Robot:
    key, kept = (structure.moving, structure.groups, ranges), _kept.of(pepper)
    if key not in kept:
        if len(kept) >= MOST_ROBOTS:
            kept.pop(next(iter(kept)))
        kept[key] = _Robot(pepper, structure, ranges)
    return kept[key]


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


def _constants(
    pepper: PepperModel, structure: Structure, tables: _Tables, rounding: Rounding
) -> dict[int, Array]:
    """Return the sections of constants."""
    members = [(g, i) for g, group in enumerate(structure.groups) for i in group]
    rows = np.array([solid.row for solid in structure.solids]).reshape(-1, ROW)
    balls, axes = tables.balls.copy(), sum(map(len, structure.classes)) + MET * len(members) + 1
    balls[:, 3] += rounding.placed[tables.ball_bodies] + rounding.comparing()
    balls[:, 4] -= rounding.placed[tables.ball_bodies] + rounding.comparing()
    cores, links = tables.cores.copy(), tables.links.copy()
    cores[:, 1] += rounding.placed[tables.core_bodies]
    cores[:, 2] -= rounding.placed[tables.core_bodies]
    reach = balls[links[:, 1], 3] + balls[links[:, 3], 3] - rounding.comparing()
    links[:, 4] = (reach * (1.0 + 1e-6)).astype(np.float32).view(np.int32)
    numbers = np.zeros(at.NUMBERS_SIZE)
    numbers[at.N], numbers[at.CLASS_COUNT] = pepper.n, len(structure.classes)
    numbers[at.GROUP_COUNT], numbers[at.BODY_COUNT] = len(structure.groups), len(tables.bodies)
    numbers[at.LINK_COUNT] = len(tables.links)
    return {
        at.NUMBERS: numbers,
        at.LINKS: words(links),
        at.CORES: singles(cores),
        at.BODIES: words(tables.bodies),
        at.FRAMES: singles(tables.frames),
        at.GROUPS: words(tables.groups),
        at.BALLS: singles(balls),
        at.SIDES: words(tables.sides),
        at.RANGES: words(tables.ranges),
        at.JOINTS: joint_table(pepper).copy(),
        at.FULL: _full_rows(pepper),
        **solid_sections(rows, [solid.vertices for solid in structure.solids]),
        at.SOLID_PLACES: np.array([[s.joint, *s.row[8:]] for s in structure.solids]),
        at.PAIR_FIRST: firsts(structure.classes).astype(float),
        at.PAIRS: np.array([pair for pairs in structure.classes for pair in pairs], dtype=float),
        at.GROUP_SOLIDS: np.array(members, dtype=float),
        at.AXES: np.zeros(3 * min(axes, MOST_AXES)),
        at.FROZEN: np.zeros(pepper.n),
        at.FREE: np.arange(pepper.n, dtype=float),
        at.EFFORT: np.full(pepper.n, np.inf),
    }


def _gaps(levers: Array) -> dict[int, Array]:
    gaps = np.full(len(levers), -np.inf)
    return {at.LEVERS: levers, at.GAPS: gaps, at.GAP_STATES: np.zeros(levers.size)}


def _ranges(ranges: tuple[DependentRange, ...]) -> dict[int, Array]:
    return dict(zip((at.TABLE_HEADS, at.TABLES, at.TABLE_CELLS), pack_tables(ranges), strict=True))


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
        at.POSES: singles(identity),
        at.CENTERS: singles(centers),
        at.PLACED: np.zeros(len(tables.cores) * CORE_LANES * LANES // 2),
        at.CLASS_DOUBTS: np.zeros(len(structure.classes)),
        at.GROUP_DOUBTS: np.zeros(len(structure.groups)),
        at.DOUBTFUL: np.zeros(1),
        at.CLOUD_ROOM: np.zeros(4 * LANES // 2),
        at.RAMP: singles(np.arange(1, LANES + 1) / LANES),
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
