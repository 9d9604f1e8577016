"""Tipping: rotation about an edge of the wheels where the floor cannot hold the robot level."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.dynamics import total_mass
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import frame_pose
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_finite,
    as_joint_vectors,
    as_real,
    check_positive,
    check_whole,
    shown,
)
from pepper_kin.status import ResultStatus
from pepper_kin.twin.base.balance import BalanceMonitor, BalanceReport

pinocchio = lazy_module("pinocchio")


class TippingStatus(ResultStatus):
    """How a tilting robot ended."""

    STOOD = "stood", "All wheels stayed on the floor."
    ROCKED = "rocked", "It tilted and came back: slow the motion down, or time it with retime(balance=...)."
    TIPPED = "tipped", "It is still tilted at the end: go on from there, or slow the motion down."
    FALLEN = "fallen", "It fell: slow the motion down, or time it with retime(balance=...)."


@dataclass(frozen=True, eq=False)
class TippingRun(FrozenArrays):
    """How the robot tilted; arrays are read-only.

    Attributes:
        time: [s], shape (T,).
        angle: Of the tilt, 0 level, shape (T,) [rad].
        rate: shape (T,) [rad/s].
        edge: Number of the edge that it tilts about, -1 while level, shape (T,).
        status: How it ended.
        message: What happened, in words.
    """

    time: Array
    angle: Array
    rate: Array
    edge: NDArray[np.int64]
    status: TippingStatus
    message: str

    def __post_init__(self) -> None:
        for name in ("time", "angle", "rate"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class EdgeMoments:
    """The robot as a body that hinges on an edge, over a motion.

    Attributes:
        inertia: About the edge, shape (T,) [kg m^2].
        inside: Horizontal distance of the center of mass from the edge, towards the inside, shape (T,) [m].
        height: Of the center of mass above the floor, shape (T,) [m].
        drive: Moment of the joints' motion (and of external forces) about the edge, positive outward,
            shape (T,) [N m].
        weight: Of the robot, with what it carries [N].
    """

    inertia: Array
    inside: Array
    height: Array
    drive: Array
    weight: float


def edge_moments(monitor: BalanceMonitor, report: BalanceReport, q: ArrayLike, edge: int) -> EdgeMoments:
    """Return what `simulate_tipping` integrates for one edge.

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
    body = _whole_body(monitor.pepper, monitor.base_frame, rows, report.loads)
    return _edge_moments(monitor, report, rows, body, edge)


def _edge_moments(
    monitor: BalanceMonitor, report: BalanceReport, q: Array, body: tuple[Array, Array], edge: int
) -> EdgeMoments:
    """Return what `edge_moments` does.

    Args:
        monitor: The robot and its wheels.
        report: Balance over the motion.
        q: The same joint positions [rad or m], shape (T, n).
        body: Center of mass [m], shape (T, 3), and inertia about it [kg m^2], shape (T, 3, 3).
        edge: Number of the edge.
    """
    pepper, (center, about_center) = monitor.pepper, body
    mass = total_mass(pepper) + sum(load.mass for load in report.loads)
    weight = mass * float(np.linalg.norm(pepper.inner_model.gravity.linear))
    start = np.array([*monitor.contacts[edge], 0.0])
    side = np.array([*monitor.contacts[(edge + 1) % len(monitor.contacts)], 0.0]) - start
    along = side / np.linalg.norm(side)
    inside, height = (center - start) @ np.array([-along[1], along[0], 0.0]), center[:, 2]
    inertia = np.einsum("i,tij,j->t", along, about_center, along) + mass * (inside**2 + height**2)
    # Moment that the floor would have to give about the edge: f_z times how far inside the point is.
    poses = frame_pose(pepper, q, monitor.base_frame)
    force, moment = report.wrench[:, :3], report.wrench[:, 3:]
    world_start = poses[:, :3, 3] + poses[:, :3, :3] @ start
    needed = np.einsum("ti,ti->t", moment - np.cross(world_start, force), poses[:, :3, :3] @ along)
    return EdgeMoments(inertia, inside, height, weight * inside - needed, weight)


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
    """Follow a motion and let the robot tilt where the floor cannot hold it level.

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
        restitution: Share of the rate kept, reversed, when it comes back to level, 0 to less than 1.
        fallen_at: Tilt that counts as fallen and ends the simulation [rad].
        substep: Longest step of the integration (Runge-Kutta, fourth order) [s].

    Returns:
        The run, cut off where the robot has fallen.

    Raises:
        InvalidValueError: for a series of other length or of one state, an edge that there is not, or numbers
            out of range.
    """
    rows = _checked(monitor, report, q, start, restitution)
    check_positive("fallen_at", fallen_at, "rad")
    check_positive("substep", substep, "s")
    time, count = report.time, len(report.time)
    body = _whole_body(monitor.pepper, monitor.base_frame, rows, report.loads)
    moments = [_edge_moments(monitor, report, rows, body, k) for k in range(len(monitor.contacts))]
    angle, rate, edge = np.zeros(count), np.zeros(count), np.full(count, -1, dtype=np.int64)
    if start is not None:
        edge[0], angle[0], rate[0] = start
    for k in range(count - 1):
        if edge[k] < 0:
            edge[k] = _leaving(moments, k)
        if edge[k] < 0:
            continue
        turning = moments[edge[k]]
        angle[k + 1], rate[k + 1] = _advanced(turning, k, time[k + 1] - time[k], angle[k], rate[k], substep)
        edge[k + 1] = edge[k]
        if angle[k + 1] <= 0.0:
            angle[k + 1], rate[k + 1] = 0.0, -restitution * rate[k + 1]
            if rate[k + 1] < 1e-3:  # [rad/s] no noticeable bounce
                rate[k + 1], edge[k + 1] = 0.0, -1
        if angle[k + 1] >= fallen_at:
            part = slice(k + 2)
            names = " - ".join(monitor.edge(int(edge[k])))
            message = f"fell over the line {names}: {fallen_at:g} rad at {time[k + 1]:.3f} s"
            return TippingRun(time[part], angle[part], rate[part], edge[part], TippingStatus.FALLEN, message)
    return TippingRun(time, angle, rate, edge, *_verdict(monitor, time, angle, edge))


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


def _leaving(moments: list[EdgeMoments], k: int) -> int:
    """Return the edge about which the level robot begins to turn, the hardest driven; -1 if it does not."""
    pull = [(body.drive[k] - body.weight * body.inside[k]) / body.inertia[k] for body in moments]
    hardest = int(np.argmax(pull))
    return hardest if pull[hardest] > 0 else -1


def _advanced(
    body: EdgeMoments, k: int, duration: float, angle: float, rate: float, substep: float
) -> tuple[float, float]:
    """Integrate the tilt over one interval of the series, its numbers linear in between."""
    steps = max(int(np.ceil(duration / substep - 1e-9)), 1)
    h = duration / steps
    share = np.arange(2 * steps + 1) / (2 * steps)  # ends and middles of the steps
    series = (body.inertia, body.height, body.inside, body.drive)
    between = [(values[k] + share * (values[k + 1] - values[k])).tolist() for values in series]
    numbers = list(zip(*between, strict=True))

    def moment(tilt: float, at: tuple[float, ...]) -> float:
        return body.weight * (at[1] * math.sin(tilt) - at[2] * math.cos(tilt)) + at[3]

    tilt, momentum = float(angle), float(rate) * numbers[0][0]
    for step in range(steps):
        begin, middle, end = numbers[2 * step : 2 * step + 3]
        a1, m1 = momentum / begin[0], moment(tilt, begin)
        a2, m2 = (momentum + h / 2 * m1) / middle[0], moment(tilt + h / 2 * a1, middle)
        a3, m3 = (momentum + h / 2 * m2) / middle[0], moment(tilt + h / 2 * a2, middle)
        a4, m4 = (momentum + h * m3) / end[0], moment(tilt + h * a3, end)
        tilt += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        momentum += h / 6 * (m1 + 2 * m2 + 2 * m3 + m4)
        if tilt < 0.0:
            break
    return tilt, momentum / numbers[-1][0]


def _whole_body(pepper: PepperModel, base_frame: str, q: Array, loads: Loads) -> tuple[Array, Array]:
    """Return center of mass (T, 3) and inertia about it (T, 3, 3) of links and loads, in the base's frame.

    Args:
        pepper: The robot.
        base_frame: Frame of the base.
        q: Joint positions [rad or m], shape (T, n).
        loads: What the robot carries.
    """
    model, data = pepper.inner_model, pepper.pinocchio_data
    frame_id, rest = pepper.frame_id(base_frame), np.zeros(model.nv)
    center, inertia = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    still = model.inertias[0]
    held = [
        (pepper.frame_id(load.frame), pinocchio.Inertia(load.mass, np.array(load.center), load.tensor))
        for load in loads
    ]
    for row, joints in enumerate(q):
        pinocchio.ccrba(model, data, pepper.to_full(joints), rest)
        whole = pinocchio.Inertia(data.Ig.mass, data.com[0] + data.Ig.lever, np.array(data.Ig.inertia))
        if still.mass > 0:
            whole = whole + still
        for carrier, own in held:
            whole = whole + pinocchio.updateFramePlacement(model, data, carrier).act(own)
        whole = pinocchio.updateFramePlacement(model, data, frame_id).actInv(whole)
        center[row], inertia[row] = whole.lever, whole.inertia
    return center, inertia


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
        restitution: Share of the rate kept.
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
