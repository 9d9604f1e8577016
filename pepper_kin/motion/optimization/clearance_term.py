"""Barrier term of distances to the scene and of the robot to itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.collision import Scene, checker_for
from pepper_kin.collision.fast.near_table import among, movable, near_table
from pepper_kin.core.collision.distances import CARRIER, SCRATCH, NearTable, write_slopes
from pepper_kin.core.collision.layout import BOX, CLOUD, HULL
from pepper_kin.core.collision.nearest_pairs import NearestPairs, NearestWorkspace, find_nearest, place_axes
from pepper_kin.core.collision.scene_rows import BOUNDING, HALF, KIND, PLACE, RADIUS
from pepper_kin.core.kernel_batch import evaluate_batch
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at, words_at
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats4, Ints1
from pepper_kin.kernels.tables import TableMemory, table_reader, take
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.motion.optimization.floors import FlooredTerm, any_below_zero
from pepper_kin.motion.optimization.moving import Moving, whole_states
from pepper_kin.planners.optimization import KINDS, RAISED, ROWS, START, TIGHTEN, VALUES, add_row

INFLUENCE = 0.08
"""Distance beyond the margin above which a pair of bodies has no effect [m]."""
MOST_PAIRS = 8
"""Maximum number of pairs of bodies that act at one sample, the nearest ones."""
_SPARE = 2e-3  # [m]
_RISE = 1e-4  # rise of a floor that counts as a change [m]
_BLOCK = 80  # number of states whose distances are computed at once
_POSE = 16


class _ClearanceTable(NamedTuple):
    """Data of a clearance term for compiled functions.

    Attributes:
        near: Pairs of bodies that move against each other, and the distances to keep.
        joints: Indices of the joints that move, shape (k,).
        rest: A whole configuration with the other joints' positions [rad or m], shape (n,).
        columns: Derivatives of the coordinates of the tree by the joints that move, shape (njoints - 1, k).
        floor: Floors, see `FlooredTerm`.
        workspace: Memory of a call.
        known: Key of the results of the last call in the workspace, or 0, shape (1,).
        frames: Number of frames whose poses are computed.
        poses: Address of the `batch` function of the frame poses' kernel.
        work: Workspace size of that kernel.
        margin: Distance to keep [m].
        sign: -1 if values are 1 - slack, else 1.
    """

    near: NearTable
    joints: Ints1
    rest: Floats1
    columns: Floats2
    floor: Floats1
    workspace: Floats1
    known: Ints1
    frames: int
    poses: int
    work: int
    margin: float
    sign: float


_table_at = table_reader(_ClearanceTable)


class _Prepared(NamedTuple):
    """Shared data of all clearance terms of one robot, scene and set of moving joints.

    Attributes:
        table: Table of a term without its own values.
        rows_count: Number of rows of a sample.
        workspace_size: Workspace size for each sample, and for all samples together.
        keep_alive: Objects whose addresses the table contains.
    """

    table: TableMemory
    rows_count: int
    workspace_size: tuple[int, int]
    keep_alive: object


@kept_for_robot(most=16)
def _prepared(
    pepper: PepperModel, scene: Scene, margin: float, moving: bytes, only_moving: bool
) -> _Prepared:
    table, frames = _table_of(pepper, scene, margin), _frames(pepper)
    poses, moved = kernel(pepper, "frame_poses", frames) if frames else None, np.frombuffer(moving, np.int64)
    # d/dq = (d/dq_full) E, where mimic joints follow by q_full = E q + e.
    columns = np.ascontiguousarray(pepper.full_map[:, moved])
    if only_moving:
        carried = table.above[table.shapes[:, CARRIER].astype(int)]
        apart = carried[table.pairs[:, 0]] != carried[table.pairs[:, 1]]
        table = among(table, (apart & (columns != 0).any(axis=1)).any(axis=1))
    address, scratch = 0, 0
    if poses:
        scratch = poses.work_size
        address = poses.address_of("batch", inputs=pepper.n, outputs=_POSE * len(frames), work=scratch)
    made = TableMemory(
        _ClearanceTable,
        near=table,
        joints=moved,
        rest=np.zeros(pepper.n),
        columns=columns,
        floor=np.zeros(0),
        workspace=np.zeros(0),
        known=np.zeros(1, np.int64),
        frames=len(frames),
        poses=address,
        work=scratch,
        margin=margin,
        sign=1.0,
    )
    most, joints, count = min(MOST_PAIRS, len(table.pairs)), len(table.joints), len(table.shapes)
    # Poses twice, whole states, positions, cores, squares, rows; joints, words, a pair, work.
    each = (_POSE + 12) * len(frames) + pepper.n + moved.size + 12 * count + 11 * most + 4
    return _Prepared(made, most, (each, 16 * joints + 49 + SCRATCH + scratch), poses)


def _table_of(pepper: PepperModel, scene: Scene, margin: float) -> NearTable:
    """Return pairs that move against each other, and distances to keep; clouds and meshes as boxes."""
    table = near_table(checker_for(pepper, scene))
    shapes = table.shapes.copy()
    boxed = np.isin(shapes[:, KIND], (HULL, CLOUD))
    shapes[boxed, KIND] = BOX
    shapes[boxed, BOUNDING] = np.linalg.norm(shapes[boxed, HALF:PLACE], axis=1) + shapes[boxed, RADIUS]
    return movable(table._replace(shapes=shapes, keep=np.full(len(table.pairs), margin)))


@kept_for_robot(most=16)
def _frames(pepper: PepperModel) -> tuple[str, ...]:
    """Return for each joint of Pinocchio's model a frame that coincides with it."""
    model, found = pepper.inner_model, dict[int, str]()
    for name in pepper.frame_names:
        frame = model.frames[pepper.frame_id(name)]
        if frame.placement.isIdentity(1e-12):
            found.setdefault(frame.parentJoint, name)
    return tuple([found[joint] for joint in range(1, model.njoints)])


class ClearanceTerm(FlooredTerm):
    """Slack (distance - margin - floor) / (influence - floor) of the nearest pairs at each sample.

    The floor is zero, except where the initial motion is nearer than the margin: there it lies a little below
    that motion's distance, until `tighten` finds that the margin is kept.

    Args:
        moving: The joints that move.
        scene: The world around the robot.
        margin: Distance to keep to the scene and between parts of the robot [m].
        per_interval: Samples in each interval of the spline.
        only_moving: Whether pairs that the moving joints do not move against each other are left out: a
            resting hand near the hip would lower the floor of the other hand's motion.
        closeness: Whether the values are 1 - slack, for a cost: max(1 - distance / influence, 0).
    """

    kinked = True

    def __init__(
        self, moving: Moving, scene: Scene, margin: float, per_interval: int, *, only_moving: bool = False,
        closeness: bool = False,
    ) -> None:  # fmt: skip
        made = _prepared(moving.pepper, scene, margin, moving.joints.tobytes(), only_moving)
        table = made.table.with_values(
            rest=moving.rest, known=np.zeros(1, np.int64), sign=-1.0 if closeness else 1.0
        )
        self._workspace_size, self._workspace = made.workspace_size, np.zeros(0)
        super().__init__(clearance_rows.address, table, made.rows_count, per_interval, keep_alive=made)

    def reserve(self, count: int) -> None:
        """Allocate memory for a number of samples."""
        size = count * self._workspace_size[0] + self._workspace_size[1]
        if size > self._workspace.size:
            self._workspace = np.empty(size)
            self.table.set(workspace=self._workspace, known=np.zeros(1, np.int64))

    def least_distance(self, q: Array) -> float:
        """Return the minimum distance beyond the margin at positions of the moving joints, shape (K, k) [m].

        Distances above `INFLUENCE` count as `INFLUENCE`.
        """
        least, q = INFLUENCE, np.ascontiguousarray(q)
        if self.rows_count:
            self.reserve(min(len(q), _BLOCK))
            for begin in range(0, len(q), _BLOCK):
                least = least_distance(self.table.address, q[begin : begin + _BLOCK], least)
        return least


@compiled
def _find_nearest(
    t: _ClearanceTable, q: Floats1, count: int, most: int, influence: float
) -> tuple[Floats4, NearestPairs, NearestWorkspace]:
    """Return the poses and the nearest pairs at positions of the moving joints, and the workspace used.

    Results for the positions of the last call are reused: a step begins where the last line search ended.
    """
    n, frames, table = t.rest.size, t.frames, t.near
    scratch, used = t.workspace, np.zeros(1, np.int64)
    size, joints = table.shapes.shape[0], table.joints.shape[0]
    poses = take(scratch, used, count * frames * _POSE)
    whole, work = take(scratch, used, count * n), take(scratch, used, t.work + 8)
    words = words_at(take(scratch, used, 8).ctypes.data, 8)
    last = take(scratch, used, q.size)
    near_workspace = NearestWorkspace(
        take(scratch, used, 12 * frames * count).reshape((frames, 12, count)),
        take(scratch, used, 12 * size * count).reshape((size, 12, count)),
        take(scratch, used, 3 * count).reshape((3, count)), take(scratch, used, 24).reshape((2, 12)),
        take(scratch, used, 9).reshape((3, 3)), take(scratch, used, SCRATCH),
        take(scratch, used, 12 * joints).reshape((joints, 12)),
        take(scratch, used, 3 * joints).reshape((joints, 3)), take(scratch, used, joints - 1),
    )  # fmt: skip
    near = NearestPairs(
        take(scratch, used, count * most).reshape((count, most)),
        words_at(take(scratch, used, count * most).ctypes.data, count * most).reshape((count, most)),
        take(scratch, used, 9 * count * most).reshape((count, most, 3, 3)),
        words_at(take(scratch, used, count).ctypes.data, count),
    )  # fmt: skip
    placed = poses.reshape((count, frames, 4, 4))
    if t.known[0] == count * (MOST_PAIRS + 1) + most and _are_equal(last, q):
        return placed, near, near_workspace
    if frames > 0:
        states = whole.reshape((count, n))
        whole_states(q, t.joints, t.rest, states)
        flat = poses.reshape((count, _POSE * frames))
        evaluate_batch(t.poses, states, states, states, flat, work, words)
    find_nearest(placed, table, influence, near, near_workspace)
    t.known[0] = count * (MOST_PAIRS + 1) + most
    for i in range(q.size):
        last[i] = q[i]
    return placed, near, near_workspace


@compiled(lean=True)
def _are_equal(first: Floats1, second: Floats1) -> bool:
    same = True
    for k in range(first.size):
        same &= first[k] == second[k]
    return same


@compiled("float64(int64, float64[:, ::1], float64)")
def least_distance(table_address: int, q: Floats2, influence: float) -> float:
    """Return the minimum distance beyond the margin at positions, shape (K, k), at most `influence` [m]."""
    t = _table_at(table_address)
    t.known[0] = 0
    near, least = _find_nearest(t, q.reshape(q.size), q.shape[0], 1, influence)[1], influence
    for k in range(q.shape[0]):
        least = min(least, near.distance[k, 0])
    t.known[0] = 0
    return least


@compiled
def _move_floors(t: _ClearanceTable, distance: Floats2, what: int) -> int:
    """Lower the floors below a motion, or raise floors that it permits; return RAISED for a large rise."""
    floors, margin, found = t.floor, t.margin, 0
    for k in range(floors.size):
        apart = distance[k, 0] + margin
        # At most half of the bodies' distance may be used up: the floor must not let them touch.
        spare = min(2.0 * _SPARE, 0.5 * apart) if apart > 0.0 else 2.0 * _SPARE
        under = 0.0 if distance[k, 0] > _SPARE else distance[k, 0] - spare
        if what != START:
            under = max(floors[k], under)
            if under - floors[k] > _RISE:
                found = RAISED
        floors[k] = under
    return found


@compiled
def _write_slopes(
    t: _ClearanceTable, poses: Floats4, near: NearestPairs, scratch: NearestWorkspace, slopes: Floats1
) -> None:
    """Write the derivatives of the slacks by the moving joints, shape (K, MOST_PAIRS, n), flat."""
    floors, sign, columns = t.floor, t.sign, t.columns
    table, moving, gradient = t.near, t.joints.size, scratch.gradient
    most, origins, axes = near.distance.shape[1], scratch.poses, scratch.axes
    for k in range(near.found.size):
        floor = floors[k] if k < floors.size else 0.0
        scale = sign / (INFLUENCE - floor)
        if near.found[k] > 0:
            place_axes(poses, k, table, origins, axes)
        for r in range(most):
            begin = (k * most + r) * moving
            own = slopes[begin : begin + moving]
            for j in range(moving):
                own[j] = 0.0
            if r >= near.found[k]:
                continue
            ends, points = table.pairs[near.pair[k, r]], near.points[k, r]
            write_slopes(table, origins, axes, (ends[0], ends[1]), points, points[2], gradient)
            for c in range(gradient.size):
                if gradient[c] != 0.0:
                    add_row(own, scale * gradient[c], columns[c])


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def clearance_rows(states: int, result: int, asked: int, memory_address: int) -> int:
    """Evaluate a clearance term; see `CompiledTerm`."""
    what, count = asked % KINDS, asked // KINDS
    t = _table_at(memory_address)
    floors, moving = t.floor, t.joints.size
    if what == TIGHTEN and not any_below_zero(floors):
        return 0
    most = min(MOST_PAIRS, t.near.keep.size)
    poses, near, scratch = _find_nearest(t, floats_at(states, count * moving), count, most, INFLUENCE)
    if what != VALUES and what != ROWS:
        return _move_floors(t, near.distance, what)
    values, sign = floats_at(result, count * most), t.sign
    for k in range(count):
        floor = floors[k] if k < floors.size else 0.0
        for r in range(most):
            slack = (near.distance[k, r] - floor) / (INFLUENCE - floor)
            values[k * most + r] = slack if sign > 0.0 else 1.0 - slack
    if what == ROWS:
        size = count * most
        _write_slopes(t, poses, near, scratch, floats_at(result + 8 * size, size * moving))
    return 0
