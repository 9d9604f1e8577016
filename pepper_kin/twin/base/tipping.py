"""Tipping: rotation about an edge of the wheels where the floor cannot hold the robot level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, BriefRepr, FrozenArrays, read_only
from pepper_kin.core.simulation.tipping import Hinges, Rules, Tilts, follow_tilts
from pepper_kin.dynamics import center_of_mass, centroidal_inertia, total_mass
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_finite,
    as_joint_vectors,
    as_real,
    check_positive,
    check_rows,
    check_whole,
    shown,
)
from pepper_kin.status import ResultStatus
from pepper_kin.twin.base.balance import BalanceMonitor, BalanceReport


class TippingStatus(ResultStatus):
    """Status of a tilting robot."""

    STOOD = "stood", "All wheels stayed on the floor."
    ROCKED = "rocked", "It tilted and came back: slow the motion down, or time it with retime(balance=...)."
    TIPPED = "tipped", "It is still tilted at the end: go on from there, or slow the motion down."
    FALLEN = "fallen", "It fell: slow the motion down, or time it with retime(balance=...)."


@dataclass(frozen=True, eq=False)
class TippingRun(FrozenArrays):
    """Tilt of the robot over a motion; arrays are read-only.

    Attributes:
        time: Times [s], shape (T,).
        angle: Tilt angle [rad], 0 if level, shape (T,).
        rate: Tilt rate [rad/s], shape (T,).
        edge: Index of the edge that the robot tilts about, -1 while level, shape (T,).
        status: Status at the end.
        message: What happened, in words.
        position: Joint positions, shape (T, n) [rad or m].
        tilt: Transforms in the world that take the level robot to the tilted one, shape (T, 4, 4) [m]: a
            link is at `tilt @ frame_pose(pepper, position, link)`.
    """

    time: Array
    angle: Array
    rate: Array
    edge: NDArray[np.int64]
    status: TippingStatus
    message: str
    position: Array
    tilt: Array

    def __post_init__(self) -> None:
        for name in ("time", "angle", "rate", "position", "tilt"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class EdgeMoments(BriefRepr):
    """The robot as a body that rotates about an edge, over a motion.

    Attributes:
        inertia: Moment of inertia about the edge [kg m^2], shape (T,).
        inside: Horizontal distance of the center of mass inside the edge [m], shape (T,).
        height: Height of the center of mass above the floor [m], shape (T,).
        drive: Moment of the joints' motion (and of external forces) about the edge, positive outward,
            shape (T,) [N m].
        weight: Weight of the robot with its loads [N].
    """

    inertia: Array
    inside: Array
    height: Array
    drive: Array
    weight: float


def edge_moments(monitor: BalanceMonitor, report: BalanceReport, q: ArrayLike, edge: int) -> EdgeMoments:
    """Return the moments about one edge that `simulate_tipping` integrates.

    Args:
        monitor: The robot and its wheels.
        report: Balance over the motion, by `monitor.assess`.
        q: The same joint positions [rad or m], shape (T, n).
        edge: Number of the edge, from wheel `edge` to the next.

    Raises:
        InvalidValueError: for joint positions of another shape than the report's, or an unknown edge.
    """
    rows = _checked_states(monitor, report, q)
    edge = check_whole("edge", edge, 0, len(monitor.contacts) - 1)
    of = _all_moments(monitor, report, rows)
    parts = (part[:, edge].copy() for part in (of.inertia, of.inside, of.height, of.drive))
    inertia, inside, height, drive = parts
    return EdgeMoments(inertia, inside, height, drive, of.weight)


def _all_moments(monitor: BalanceMonitor, report: BalanceReport, q: Array) -> EdgeMoments:
    """Return the moments of all k edges, of shape (T, k) each.

    Args:
        monitor: The robot and its wheels.
        report: Balance over the motion.
        q: The same joint positions [rad or m], shape (T, n).
    """
    pepper, poses = monitor.pepper, frame_pose(monitor.pepper, q, monitor.base_frame)
    turn, place = poses[:, :3, :3], poses[:, :3, 3]
    mass, center, about_center = _whole_body(pepper, q, report.loads)
    center = np.einsum("tji,tj->ti", turn, center - place)
    about_center = turn.transpose(0, 2, 1) @ about_center @ turn
    weight = mass * float(np.linalg.norm(pepper.inner_model.gravity.linear))
    start = np.column_stack([monitor.contacts, np.zeros(len(monitor.contacts))])
    side = np.roll(start, -1, axis=0) - start
    along = side / np.linalg.norm(side, axis=1, keepdims=True)
    inward = np.column_stack([-along[:, 1], along[:, 0], 0.0 * along[:, 0]])
    inside, height = np.einsum("tki,ki->tk", center[:, np.newaxis] - start, inward), center[:, 2:]
    inertia = np.einsum("ki,tij,kj->tk", along, about_center, along) + mass * (inside**2 + height**2)
    # Moment that the floor would have to give about the edge: f_z times how far inside the point is.
    force, moment = report.wrench[:, np.newaxis, :3], report.wrench[:, np.newaxis, 3:]
    world_start = place[:, np.newaxis] + start @ turn.transpose(0, 2, 1)
    needed = ((moment - np.cross(world_start, force)) * (along @ turn.transpose(0, 2, 1))).sum(axis=2)
    height = np.broadcast_to(height, inside.shape)
    return EdgeMoments(inertia, inside, height, weight * inside - needed, weight)


def _hinges(moments: EdgeMoments, shaped: Callable[[Array], Array], count: int) -> Hinges:
    """Return the moments of all edges for robots, each array with shape (N, T, k)."""
    parts = (moments.inertia, moments.inside, moments.height, moments.drive)
    inertia, inside, height, drive = (np.ascontiguousarray(shaped(part)) for part in parts)
    return Hinges(inertia, inside, height, drive, np.full(count, moments.weight))


def simulate_tipping(
    monitor: BalanceMonitor,
    report: BalanceReport,
    q: ArrayLike,
    *,
    start: tuple[int, float, float] | None = None,
    restitution: float = 0.0,
    fallen_at: float = 1.2,
    substep: float = 1e-3,
) -> TippingRun:
    """Simulate the tilt of the robot along a motion where the floor cannot hold it level.

    When the zero-moment point leaves the polygon, the whole robot turns about the edge that it left through,
    as one body with the mass distribution at that time, while the joints follow the motion.  With
    theta the tilt, I the inertia about the edge, b and h how far inside the edge and how high the center of
    mass is while level, and M the moment about the edge of the forces of inertia of the joints' motion,
        d/dt (I theta') = m g (h sin(theta) - b cos(theta)) + M,
    which is the balance of angular momentum about the edge.  It tips over when the center of mass has passed
    over the edge for good, and comes back otherwise.

    Assumed: joints follow their motion whatever happens (stiff servos); wheels are points that neither slide
    nor leave the edge; the moment of external forces, and of the acceleration of a moving base, is that of
    the level robot; coming back to level ends the tilt at once, except for the restitution.  Only one edge at
    a time.

    Args:
        monitor: The robot and its wheels.
        report: Balance over the motion, by `monitor.assess`.
        q: The same joint positions [rad or m], shape (T, n), T > 1.
        start: Edge, tilt [rad] and rate [rad/s] at the beginning, such as after a blow; level if omitted.
        restitution: Fraction of the rate kept, reversed, when the robot comes back to level, 0 to less than
            1.
        fallen_at: Tilt that counts as fallen and ends the simulation [rad].
        substep: Longest step of the integration (Runge-Kutta, fourth order) [s].

    Returns:
        The run, cut off where the robot has fallen.

    Raises:
        InvalidValueError: for a series of other length or of one state, an edge that there is not, or numbers
            out of range.
    """
    rows = _checked(monitor, report, q, start, restitution)
    rules = _rules(restitution, fallen_at, substep)
    time, count = np.ascontiguousarray(report.time), len(report.time)
    tilts = _level(1, count)
    if start is not None:
        tilts.edge[0, 0], tilts.angle[0, 0], tilts.rate[0, 0] = start
    moments = _all_moments(monitor, report, rows)
    follow_tilts(time, _hinges(moments, lambda part: part[np.newaxis], 1), rules, tilts)
    end = int(tilts.ends[0])
    part = slice(end + 1)
    found = tilts.angle[0, part], tilts.rate[0, part], tilts.edge[0, part]
    moved = rows[part], _turns(monitor, rows[part], found[0], found[2])
    if end < count:
        names = " - ".join(monitor.edge(int(found[2][-1])))
        message = f"fell over the line {names}: {fallen_at:g} rad at {time[end]:.3f} s"
        return TippingRun(time[part], *found, TippingStatus.FALLEN, message, *moved)
    return TippingRun(time, *found, *_verdict(monitor, time, found[0], found[2]), *moved)


def _turns(monitor: BalanceMonitor, q: Array, angle: Array, edge: NDArray[np.int64]) -> Array:
    """Return the transforms of tilts about edges, in the world, shape (T, 4, 4).

    R = I + sin(theta) K + (1 - cos(theta)) K^2, with K the cross product with the edge's direction, which has
    the inside on its left: a tilt turns the robot outward.

    Args:
        monitor: The robot and its wheels.
        q: Joint positions [rad or m], shape (T, n).
        angle: Tilts [rad], shape (T,).
        edge: Edges that it tilts about, -1 for none, shape (T,).
    """
    pose = frame_pose(monitor.pepper, q, monitor.base_frame)
    start = np.column_stack([monitor.contacts, np.zeros(len(monitor.contacts))])
    side = np.roll(start, -1, axis=0) - start
    place = pose[:, :3, 3] + np.einsum("tij,tj->ti", pose[:, :3, :3], start[edge])
    along = np.einsum("tij,tj->ti", pose[:, :3, :3], side[edge] / np.linalg.norm(side[edge], axis=1)[:, None])
    cross = np.cross(along[:, None], np.eye(3)).transpose(0, 2, 1)
    theta = np.where(edge < 0, 0.0, angle)[:, None, None]
    turns = np.tile(np.eye(4), (len(q), 1, 1))
    turns[:, :3, :3] += np.sin(theta) * cross + (1 - np.cos(theta)) * (cross @ cross)
    turns[:, :3, 3] = place - np.einsum("tij,tj->ti", turns[:, :3, :3], place)
    return turns


class BatchTipping:
    """Tilts of N robots about edges of their wheels, from step to step; see `simulate_tipping`.

    Args:
        monitor: The robot and its wheels.
        count: Number N of robots.
        loads: Loads that all robots carry: `pepper_kin.collision.loads_of(pepper, scene, payload)`.
        restitution: Fraction of the rate kept, reversed, when a robot comes back to level, 0 to less than 1.
        fallen_at: Tilt that counts as fallen [rad]; a fallen robot stays so until it is reset.
        substep: Longest step of the integration [s].

    Attributes:
        angle: Tilt angles [rad], shape (N,).
        rate: Tilt rates [rad/s], shape (N,).
        edge: Edges that the robots tilt about, -1 for none, shape (N,).

    Raises:
        InvalidValueError: for numbers out of range.
    """

    def __init__(
        self,
        monitor: BalanceMonitor,
        count: int,
        *,
        loads: Loads = (),
        restitution: float = 0.0,
        fallen_at: float = 1.2,
        substep: float = 1e-3,
    ) -> None:
        self.monitor, self.count, self._loads = monitor, check_whole("count", count, 1), loads
        if not 0 <= as_real(restitution) < 1:
            raise InvalidValueError("restitution", restitution, "a number from 0 to less than 1")
        self._rules = _rules(restitution, fallen_at, substep)
        self.angle, self.rate = np.zeros(count), np.zeros(count)
        self.edge = np.full(count, -1)
        self._before: Hinges | None = None
        self._new = np.ones(count, bool)

    @property
    def fallen(self) -> NDArray[np.bool_]:
        """Which robots have fallen, shape (N,)."""
        return np.asarray(self.angle >= self._rules.fallen_at)

    def reset(self, rows: ArrayLike | None = None) -> None:
        """Reset all robots to level, or robots with indices, shape (k,), or a mask, shape (N,).

        Raises:
            InvalidValueError: for rows that do not exist.
        """
        places = np.arange(self.count) if rows is None else check_rows(rows, self.count)
        self.angle, self.rate, self.edge = self.angle.copy(), self.rate.copy(), self.edge.copy()
        self.angle[places], self.rate[places], self.edge[places], self._new[places] = 0.0, 0.0, -1, True

    def step(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, duration: float, external: ArrayLike | None = None
    ) -> BalanceReport:
        """Advance the robots' tilts by a time, given their motion at its end.

        The moments change linearly during the step; in the first step after a reset they are constant.

        Args:
            q: Joint positions at the end [rad or m], shape (N, n).
            v: Joint velocities at the end [rad/s or m/s], shape (N, n).
            a: Joint accelerations at the end [rad/s^2 or m/s^2], shape (N, n).
            duration: Time [s].
            external: External force [N] and moment [N m], shape (N, 6); see `BalanceMonitor.assess`.

        Returns:
            Balance of the level robots, with one row for each.

        Raises:
            InvalidValueError: for wrong shapes, NaN or infinity, or a duration that is not above 0.
        """
        times = np.array([0.0, check_positive("duration", duration, "s")])
        report = self.monitor.assess(np.arange(float(self.count)), q, v, a, external, loads=self._loads)
        now = _all_moments(self.monitor, report, as_joint_vectors(self.monitor.pepper, q, "q"))
        end = _hinges(now, lambda part: part[:, np.newaxis], self.count)
        begin = end if self._before is None else self._before
        parts = (self._pair(*pair) for pair in zip(begin[:4], end[:4], strict=True))
        inertia, inside, height, drive = parts
        hinges = Hinges(inertia, inside, height, drive, end.weight)
        tilts = _level(self.count, 2)
        tilts.angle[:, 0], tilts.rate[:, 0], tilts.edge[:, 0] = self.angle, self.rate, self.edge
        follow_tilts(times, hinges, self._rules, tilts)
        self.angle, self.rate = tilts.angle[:, 1].copy(), tilts.rate[:, 1].copy()
        self.edge, self._before = tilts.edge[:, 1].copy(), end
        self._new[:] = False
        return report

    def _pair(self, begin: Array, end: Array) -> Array:
        """Return moments at the begin and the end of a step, shape (N, 2, k), of (N, 1, k) each."""
        return np.concatenate([np.where(self._new[:, np.newaxis, np.newaxis], end, begin), end], axis=1)


def _rules(restitution: float, fallen_at: float, substep: float) -> Rules:
    return Rules(
        float(restitution), check_positive("fallen_at", fallen_at, "rad"),
        check_positive("substep", substep, "s"),
    )  # fmt: skip


def _level(robots: int, times: int) -> Tilts:
    """Return arrays for the tilts of robots that begin level."""
    shape = (robots, times)
    return Tilts(np.zeros(shape), np.zeros(shape), np.full(shape, -1), np.full(robots, times))


def _verdict(
    monitor: BalanceMonitor, time: Array, angle: Array, edge: NDArray[np.int64]
) -> tuple[TippingStatus, str]:
    """Return how a motion ended that did not end in a fall, and a message.

    Args:
        monitor: The robot and its wheels.
        time: [s], shape (T,).
        angle: Tilt [rad], shape (T,).
        edge: Number of the edge that the robot turns about, -1 for none, shape (T,).
    """
    if not (edge >= 0).any():
        return TippingStatus.STOOD, "all wheels stayed on the floor"
    peak = int(np.argmax(angle))
    first = int(np.argmax(edge >= 0))
    names = " - ".join(monitor.edge(int(edge[first])))
    words = f"over the line {names} from {time[first]:.3f} s, at most {angle[peak]:.4f} rad"
    if edge[-1] >= 0 and angle[-1] > 0:
        return TippingStatus.TIPPED, f"tilted {words}, and is still tilted"
    return TippingStatus.ROCKED, f"tilted {words}, and came back"


def _whole_body(pepper: PepperModel, q: Array, loads: Loads) -> tuple[float, Array, Array]:
    """Return mass [kg], center (T, 3) and inertia about it (T, 3, 3) of links and loads, in the world.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (T, n).
        loads: Carried loads.
    """
    mass, center = total_mass(pepper), center_of_mass(pepper, q)
    inertia = centroidal_inertia(pepper, q)
    for load in loads:
        pose = frame_pose(pepper, q, load.frame)
        turn, share = pose[:, :3, :3], load.mass / (mass + load.mass)
        way = pose[:, :3, 3] + turn @ load.center - center
        spread = np.einsum("ti,ti->t", way, way)[:, np.newaxis, np.newaxis] * np.eye(3)
        spread -= way[:, :, np.newaxis] * way[:, np.newaxis]
        inertia = inertia + turn @ load.tensor @ turn.transpose(0, 2, 1) + share * mass * spread
        mass, center = mass + load.mass, center + share * way
    return mass, center, inertia


def _checked(
    monitor: BalanceMonitor,
    report: BalanceReport,
    q: ArrayLike,
    start: tuple[int, float, float] | None,
    restitution: float,
) -> Array:
    """Return joint positions; refuse arguments of `simulate_tipping` that are not allowed.

    Args:
        monitor: The robot and its wheels.
        report: Balance over the motion.
        q: Joint positions [rad or m], to be of shape (T, n), T > 1.
        start: Edge, tilt [rad] and rate [rad/s] at the beginning.
        restitution: Fraction of the rate kept.
    """
    rows = _checked_states(monitor, report, q)
    if len(rows) < 2:
        raise InvalidValueError("q", f"shape {rows.shape}", "two states or more")
    if not 0 <= as_real(restitution) < 1:
        raise InvalidValueError("restitution", restitution, "a number from 0 to less than 1")
    if start is None:
        return rows
    edges = len(monitor.contacts)
    try:
        edge, tilt, _ = as_finite(start, "start", (3,))
    except InvalidValueError:
        edge, tilt = -1.0, 0.0
    if edge not in range(edges) or tilt < 0:
        allowed = f"an edge from 0 to {edges - 1}, a tilt of 0 or more, a rate"
        raise InvalidValueError("start", shown(start), allowed)
    return rows


def _checked_states(monitor: BalanceMonitor, report: BalanceReport, q: ArrayLike) -> Array:
    """Return the joint positions of a report [rad or m], shape (T, n)."""
    rows, shape = as_joint_vectors(monitor.pepper, q, "q"), (len(report.time), monitor.pepper.n)
    if rows.shape != shape:
        raise InvalidValueError("q", f"shape {rows.shape}", f"shape {shape}, as the report")
    return rows
