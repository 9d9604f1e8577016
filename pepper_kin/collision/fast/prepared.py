"""Block of constants of one robot, which refers to a scene's block and has the margins."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import RANGE_RADIUS, CollisionChecker
from pepper_kin.collision.dependent_ranges import DependentRange
from pepper_kin.collision.fast.body_tables import BodyTables, full_rows
from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.collision.fast.motion_bounds import part_motion_bounds
from pepper_kin.collision.fast.rounding import Rounding
from pepper_kin.collision.fast.scene_block import (
    SceneBlock,
    cloud_addresses,
    firsts,
    scene_block,
    singles,
    solid_sections,
    words,
)
from pepper_kin.collision.fast.structure import (
    ComparedParts,
    MovingParts,
    structure_of,
)
from pepper_kin.collision.fast.tables import pack_tables
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.check import set_margins
from pepper_kin.core.collision.clouds import POINT_WORKSPACE
from pepper_kin.core.collision.layout import STATES_AT_ONCE
from pepper_kin.core.collision.records import (
    BALL,
    BODY,
    CORE,
    HEAD,
    LANE_POSE,
    LINK,
    LINK_PART,
    PART,
    PLACED_BODY,
    PLACED_CORE,
    PLACED_PART,
    POSE,
)
from pepper_kin.kernels import Kernel
from pepper_kin.kernels.lanes import LANES
from pepper_kin.model import PepperModel, RobotMemory
from pepper_kin.model.moving_tree import moving_tree

MET, MOST_AXES = 16, 2048
"""Objects per solid, and maximum number of pairs of solids, for which the last separating direction is
stored; beyond, pairs share directions."""
MOST_ROBOTS = 64
"""Maximum number of robots with different attached objects that are cached."""


@dataclass(frozen=True, eq=False)
class Limited:
    """Blocks of a robot for motions of some of its joints, not to be written to.

    Attributes:
        still: Block that compares only bodies that stand still, without tables of joint ranges.
        moving: Block that compares only bodies that move.
        moves: 1 for each body that moves, else 0; the world last.
        placing: Kernel that places all bodies at once in `moving`; None if few move.
        held: `moving` with sections for loads, for each kind of `StaticLoads`.
        local: Blocks of each thread, shared by all motions, and the motion they are prepared for.
    """

    still: Array
    moving: Array
    moves: NDArray[np.int64]
    placing: Kernel | None
    held: dict[tuple[int, int, int], Array] = field(default_factory=dict)
    local: threading.local = field(default_factory=threading.local)


@dataclass(frozen=True, eq=False)
class Prepared:
    """Data of compiled collision checks.

    Attributes:
        structure: Bodies and pairs that are compared.
        block: The robot's block, without margins and scene; not to be written to.
        scene: The scene's block.
        margins: Margins to the scene and between two parts of the robot [m].
        limited: Blocks that compare only bodies that stand still, or only those that move, for each choice of
            free joints.
        local: Block of each thread, shared by all scenes and margins, and the scene it refers to.
        motion_bounds: Motion bounds of the parts, see `part_motion_bounds`.
        carried: Whether a coordinate of the Pinocchio model carries a body, world last, shape (bodies, nv).
        bodies_of_solids: Index of the body of each solid of the robot, shape (solids,).
    """

    structure: ComparedParts
    block: Array
    scene: SceneBlock
    margins: tuple[float, float]
    limited: dict[bytes, Limited]
    local: threading.local
    motion_bounds: Array
    carried: NDArray[np.bool_]
    bodies_of_solids: NDArray[np.int64]

    def memory(self) -> Array:
        """Return the block of this thread, which refers to this scene until another is requested."""
        local = self.local
        try:
            if local.named is self:
                return np.asarray(local.memory)
        except AttributeError:
            local.memory = at.aligned_copy(self.block)
        local.named = self
        return self.named(local.memory, self.margins)

    def named(self, memory: Array, margins: tuple[float, float]) -> Array:
        """Write the scene and margins [m] into a block, shape (s,); return it."""
        set_margins(memory, *margins, RANGE_RADIUS)
        head = at.head_of(memory)
        HEAD.set_scene(head, self.scene.address)
        HEAD.set_scene_size(head, self.scene.block.size)
        return memory


class _Robot:
    """A robot with attached objects, its solids in groups: shared by scenes with the same groups.

    Attributes:
        rounding: Errors of single precision.
        carried: See `Prepared`.
        bodies_of_solids: See `Prepared`.
        block: See `Prepared`.
        limited: See `Prepared`.
        local: See `Prepared`.
        motion_bounds: See `Prepared`.
    """

    def __init__(
        self, pepper: PepperModel, structure: ComparedParts, ranges: tuple[DependentRange, ...]
    ) -> None:
        tables, self.rounding = BodyTables(pepper, structure), Rounding(pepper, structure.solids)
        self.motion_bounds = part_motion_bounds(pepper, structure)
        self.block = at.pack(
            {
                **_gaps(self.motion_bounds, len(structure.classes)),
                **_constants(pepper, structure, tables, self.rounding),
                **_ranges(ranges),
                **_scratch(pepper, structure, tables),
            }
        )
        self.block.setflags(write=False)
        self.limited: dict[bytes, Limited] = {}
        self.local = threading.local()
        joints = np.array([solid.joint for solid in structure.solids], np.int64)
        self.carried = _carried(pepper)
        self.bodies_of_solids = np.where(joints > 0, joints - 1, len(tables.bodies) - 1)


def prepare(checker: CollisionChecker) -> Prepared:
    """Return the blocks of a checker; the block of its scene is shared by all margins."""
    like = checker.shapes_of
    found = _shared.get(like)
    if found is None:
        structure = structure_of(like)
        robot = _robot_of(like.pepper, structure, like.dependent_ranges)
        found = _shared[like] = structure, robot, scene_block(structure, robot.rounding)
    structure, robot, scene = found
    margins = checker.margin, checker.self_margin
    own = robot.limited, robot.local, robot.motion_bounds, robot.carried, robot.bodies_of_solids
    return Prepared(structure, robot.block, scene, margins, *own)


_shared: WeakKeyDictionary[CollisionChecker, tuple[ComparedParts, _Robot, SceneBlock]] = WeakKeyDictionary()
"""Data shared by checkers of the same shapes with different margins."""
_kept: RobotMemory[tuple[MovingParts, tuple[tuple[int, ...], ...], tuple[DependentRange, ...]], _Robot] = (
    RobotMemory()
)


def _robot_of(pepper: PepperModel, structure: ComparedParts, ranges: tuple[DependentRange, ...]) -> _Robot:
    """Return a robot's blocks for attached objects, groups and ranges, cached."""
    key, kept = (structure.moving, structure.groups, ranges), _kept.of(pepper)
    if key not in kept:
        if len(kept) >= MOST_ROBOTS:
            kept.pop(next(iter(kept)))
        kept[key] = _Robot(pepper, structure, ranges)
    return kept[key]


def _carried(pepper: PepperModel) -> NDArray[np.bool_]:
    """Return whether each coordinate carries a body, the world last, shape (bodies, nv)."""
    return np.roll(moving_tree(pepper).carried(), -1, axis=0)  # the world last


def _constants(
    pepper: PepperModel, structure: ComparedParts, tables: BodyTables, rounding: Rounding
) -> dict[int, Array]:
    """Return the sections of constants."""
    members = [(g, i) for g, group in enumerate(structure.groups) for i in group]
    rows = structure.moving.rows
    balls, axes = tables.balls.copy(), sum(map(len, structure.classes)) + MET * len(members) + 1
    balls[:, BALL.columns.outer] += rounding.placed[tables.ball_bodies] + rounding.comparing()
    balls[:, BALL.columns.inner] -= rounding.placed[tables.ball_bodies] + rounding.comparing()
    cores, links = tables.cores.copy(), tables.links.copy()
    cores[:, CORE.columns.outer] += rounding.placed[tables.core_bodies]
    cores[:, CORE.columns.inner] -= rounding.placed[tables.core_bodies]
    link_parts = tables.link_parts.copy()
    coarse, own, of_parts = tables.parts[:, PART.columns.coarse], LINK.columns, LINK_PART.columns
    links[:, own.touching] = _touching(
        balls, links[:, own.covered_coarse], links[:, own.exact_coarse], rounding
    )
    covered, exact = coarse[link_parts[:, of_parts.covered]], coarse[link_parts[:, of_parts.exact]]
    link_parts[:, of_parts.touching] = _touching(balls, covered, exact, rounding)
    head = dict.fromkeys(HEAD.fields, 0) | {
        "joints": pepper.n,
        "classes": len(structure.classes),
        "groups": len(structure.groups),
        "bodies": len(tables.bodies),
        "links": len(tables.links),
    }
    return {
        at.NUMBERS: words(np.array(HEAD.row(**head))),
        at.LINKS: words(links),
        at.LINK_PARTS: words(link_parts),
        at.CORES: singles(cores),
        at.BODIES: words(tables.bodies),
        at.FRAMES: singles(tables.frames),
        at.GROUPS: words(tables.groups),
        at.PARTS: words(tables.parts),
        at.BALLS: singles(balls),
        at.SIDES: words(tables.sides),
        at.RANGES: words(tables.ranges),
        at.JOINTS: joint_table(pepper).copy(),
        at.FULL: full_rows(pepper),
        **solid_sections(rows, [solid.vertices for solid in structure.solids]),
        at.CLOUDS: cloud_addresses(structure.solids),
        at.SOLID_PLACES: np.array([[s.joint, *s.row[8:]] for s in structure.solids]),
        at.PAIR_FIRST: firsts(structure.classes).astype(float),
        at.PAIRS: np.array([pair for pairs in structure.classes for pair in pairs], dtype=float),
        at.GROUP_SOLIDS: np.array(members, dtype=float),
        at.AXES: np.zeros(3 * min(axes, MOST_AXES)),
        at.FROZEN: np.zeros(pepper.n),
        at.FREE: np.arange(pepper.n, dtype=float),
    }


def _touching(
    balls: Array, some: NDArray[np.int64], others: NDArray[np.int64], rounding: Rounding
) -> NDArray[np.int32]:
    """Return the distances at which coarse spheres touch [m], as the bits of float32, shape (k,).

    Args:
        balls: Center, outer and inner radius of each sphere [m], shape (b, 5).
        some: Row of the first sphere of each pair, shape (k,).
        others: Row of the second sphere of each pair, shape (k,).
        rounding: Errors of single precision.
    """
    outer = balls[:, BALL.columns.outer]
    reach = outer[some] + outer[others] - rounding.comparing()
    return (reach * (1.0 + 1e-6)).astype(np.float32).view(np.int32)


def _gaps(motion_bounds: Array, classes: int) -> dict[int, Array]:
    """Return the sections from LEVERS on; motion bounds have shape (classes + groups, n) [m/rad, or 1]."""
    states = np.zeros((classes, motion_bounds.shape[1]))
    return {
        at.LEVERS: motion_bounds,
        at.ALLOWANCES: np.zeros(len(motion_bounds)),
        at.GAPS: np.full(classes, -np.inf),
        at.GAP_STATES: states,
    }


def _ranges(ranges: tuple[DependentRange, ...]) -> dict[int, Array]:
    """Return the sections of the tables of dependent joint ranges."""
    return dict(zip((at.TABLE_HEADS, at.TABLES, at.TABLE_CELLS), pack_tables(ranges), strict=True))


def _scratch(pepper: PepperModel, structure: ComparedParts, tables: BodyTables) -> dict[int, Array]:
    """Return the sections of workspace."""
    n, joints, bodies = pepper.n, moving_tree(pepper).count, len(tables.bodies)
    pose = LANE_POSE.row(rotation=np.repeat(np.eye(3).ravel(), LANES), origin=np.zeros(3 * LANES))
    poses = np.zeros((bodies + 1, LANE_POSE.width), np.float32)
    poses[[0, bodies]] = pose
    centers = np.zeros((len(tables.balls), 3, LANES), np.float32)
    world = tables.bodies[-1, BODY.columns.coarse]  # all others are written when bodies are placed
    centers[world] = tables.balls[world, BALL.columns.center, None]
    return {
        at.PLACED_AT: words(np.tile(PLACED_BODY.row(count=1, parts=0), bodies)),
        at.PARTS_AT: np.zeros(PLACED_PART.width * len(tables.parts)),
        at.COORDINATES: np.zeros(n * LANES // 2),
        at.POSES: singles(poses),
        at.CENTERS: singles(centers),
        at.PLACED: np.zeros(len(tables.cores) * PLACED_CORE.width // 2),
        at.CLASS_DOUBTS: np.zeros(len(structure.classes)),
        at.GROUP_DOUBTS: np.zeros(len(structure.groups)),
        at.DOUBTFUL: np.zeros(1),
        at.ORDER: words(np.arange(len(structure.groups))),
        at.CLOUD_WORKSPACE: np.zeros(4 * LANES // 2),
        at.PAIR_WORKSPACE: np.zeros(POINT_WORKSPACE.width),
        at.RAMP: singles(np.arange(1, LANES + 1) / LANES),
        at.ROWS: np.zeros(STATES_AT_ONCE * n),
        at.STATUS: np.zeros(STATES_AT_ONCE),
        at.QUEUE: np.zeros(STATES_AT_ONCE),
        at.ROW_CLASSES: np.zeros(STATES_AT_ONCE),
        at.ROW_GROUPS: np.zeros(STATES_AT_ONCE),
        at.Q_FULL: np.zeros(joints - 1),
        at.JOINT_POSES: np.zeros(POSE.width * joints),
        at.JOINT_AXES: np.zeros(3 * joints),
    }
