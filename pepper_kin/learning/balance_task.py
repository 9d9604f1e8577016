"""Task of a robot on its wheels that is pushed and must lean against the push."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.arrays import Array
from pepper_kin.core.episodes import Score
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.task import BANK, STEPS, RobotTask, TaskState, joint_indices
from pepper_kin.learning.task import REACH as FAR
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.twin import TwinBatch
from pepper_kin.twin.base import BalanceMonitor, BatchTipping

PUSHED = "Neck"
_HARDEST = 60.0  # maximum force of a push [N]
_RISE = 1.2  # time in which a push rises to its force [s]
_AHEAD = 3  # number of steps by which the oracle is ahead of the push
_FALLEN = 0.25  # tilt that counts as a fall [rad]: the center of mass is over the edge
_SPARE, _DOOMED = 0.02, -0.01  # minimum margin when leaning, and maximum margin when standing still [m]


@dataclass(frozen=True)
class BalanceTask(RobotTask):
    """A push at the neck that rises in 1.2 s and stays: a robot that does not lean against it tips over.

    The achieved goal is the zero-moment point of the level robot, the desired goal the middle of the wheels;
    a tilt of 0.25 rad is a failure.
    """

    horizon: int = 100
    threshold: float = 0.2

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the indices of the joints of hip and knee, shape (3,)."""
        return joint_indices(pepper, ["HipRoll", "HipPitch", "KneePitch"])

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return pushes [N] and the index of the posture that withstands each, shape (m, 3)."""
        return pushes_of(pepper, self, seed)[0]

    def force(self, state: TaskState) -> Array:
        """Return the present pushes [N], shape (N, 3), along the floor."""
        return np.pad(_risen(state.time) * state.episode[:, :2], ((0, 0), (0, 1)))

    def base(self, pepper: PepperModel, count: int) -> TippingBase:
        """Return the wheels of N robots."""
        tipping = BatchTipping(_monitor(pepper), count, fallen_at=_FALLEN)
        return TippingBase(tipping, np.tile(_at_rest(pepper), (count, 1)))

    def measure(self, twins: TwinBatch, base: TippingBase) -> Tilt:
        """Return the tilts and zero-moment points of the robots."""
        tipping = base.tipping
        return Tilt(tipping.angle, tipping.rate, tipping.edge, tipping.fallen, base.point.copy())

    def simulate(self, state: TaskState, actions: Array, twins: TwinBatch, base: TippingBase) -> np.ndarray:
        """Simulate a step of actions while the robots are pushed; see `RobotTask.simulate`."""
        q, force = state.position.copy(), self.force(state)
        wrench = np.pad(force, ((0, 0), (0, 3)))
        load = dynamics.external_torque(state.pepper, q, {PUSHED: wrench})
        q[:, state.joints] += FAR * actions
        sound = twins.step(q, STEPS, speed=state.speed, load=load, threads=state.threads)
        q, v = twins.position, twins.velocity
        place = kinematics.frame_pose(state.pepper, q, PUSHED)[:, :3, 3]
        outer = np.concatenate([force, np.cross(place, force)], axis=1)
        acceleration = (v - state.velocity) / state.period
        report = base.tipping.step(q, v, acceleration, state.period, outer)
        base.point[:] = np.where(np.isfinite(report.point), report.point, 1.0)
        return sound

    def reset(self, state: TaskState, rows: np.ndarray, twins: TwinBatch, base: TippingBase) -> None:
        """Set robots to the start of their episodes, level; see `RobotTask.reset`."""
        super().reset(state, rows, twins, base)
        base.tipping.reset(rows)
        base.point[rows] = _at_rest(state.pepper)

    def achieved_goal(self, state: TaskState) -> Array:
        """Return the zero-moment points of the last step's mean acceleration [m], shape (N, 1, 3)."""
        return np.pad(state.measured.point, ((0, 0), (0, 1)))[:, np.newaxis]

    def desired_goal(self, state: TaskState) -> Array:
        """Return the middle of the wheels [m], shape (N, 1, 3)."""
        middle = np.append(_monitor(state.pepper).contacts.mean(axis=0), 0.0)
        return np.tile(middle, (len(state.position), 1, 1))

    def extra_observation(self, state: TaskState) -> Array:
        """Return the present push over 60 N, and axis, angle and rate of the tilt, shape (N, 6).

        The tilt is relative to 0.25 rad, its rate in rad/s.
        """
        tilt, contacts = state.measured, _monitor(state.pepper).contacts
        side = np.roll(contacts, -1, axis=0) - contacts
        axis = (side / np.linalg.norm(side, axis=1, keepdims=True))[tilt.edge]
        angle, rate = tilt.angle[:, np.newaxis] * axis, tilt.rate[:, np.newaxis] * axis
        return np.concatenate([self.force(state)[:, :2] / _HARDEST, angle / _FALLEN, rate], axis=1)

    def score(self, state: TaskState, achieved: Array, desired: Array) -> Score:
        """Return the scores, with robots that fall as failed; see `RobotTask.score`."""
        found, tilt = super().score(state, achieved, desired), state.measured
        return found._replace(success=tilt.edge < 0, failed=tilt.fallen)

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Lean as the push rises; see `RobotTask.expert_targets`."""
        leaning, home = pushes_of(state.pepper, self, state.goal_seed)[1], self.home(state.pepper)
        share = _risen(state.time + _AHEAD * state.period)
        return home + share * (leaning[state.episode[:, 2].astype(np.int64)] - home)


class TippingBase(NamedTuple):
    """Wheels of N robots: tilts about wheels, and zero-moment points [m], far away for none."""

    tipping: BatchTipping
    point: Array


class Tilt(NamedTuple):
    """Tilts and zero-moment points of N robots.

    Attributes:
        angle: Tilts [rad], shape (N,).
        rate: Rates of the tilts [rad/s], shape (N,).
        edge: Edges that the robots tilt about, -1 for none, shape (N,).
        fallen: Which robots have fallen, shape (N,).
        point: Zero-moment points [m], shape (N, 2).
    """

    angle: Array
    rate: Array
    edge: np.ndarray
    fallen: np.ndarray
    point: Array


@kept_for_robot(most=8)
def _at_rest(pepper: PepperModel) -> Array:
    """Return x and y of the center of mass in the neutral posture [m], shape (2,)."""
    return dynamics.center_of_mass(pepper, pepper.neutral())[:2]


@kept_for_robot(most=8)
def _monitor(pepper: PepperModel) -> BalanceMonitor:
    return BalanceMonitor(pepper)


def _risen(time: Array) -> Array:
    """Return the ratio of a push to its final force after a time [s], shape (N, 1)."""
    share = np.minimum(time / _RISE, 1.0)[:, np.newaxis]
    return share * share * (3.0 - 2.0 * share)


@kept_for_robot(most=8)
def pushes_of(pepper: PepperModel, task: BalanceTask, seed: int) -> tuple[Array, Array]:
    """Return episodes, shape (m, 3), and postures that withstand their pushes [rad], shape (m, n).

    Raises:
        InvalidValueError: if the robot withstands no push.
    """
    drawn = np.random.default_rng(seed)
    angle, size = drawn.uniform(-np.pi, np.pi, 4 * BANK), drawn.uniform(0.4, 1.0, 4 * BANK) * _HARDEST
    force = np.stack([size * np.cos(angle), size * np.sin(angle), 0.0 * size], axis=1)
    monitor, home = _monitor(pepper), np.tile(pepper.neutral(), (len(force), 1))
    rest = np.zeros_like(home)

    def margins(q: Array) -> Array:
        place = kinematics.frame_pose(pepper, q, PUSHED)[:, :3, 3]
        outer = np.concatenate([force, np.cross(place, force)], axis=1)
        return monitor.assess(np.arange(float(len(q))), q, rest, rest, outer).margin

    height = kinematics.frame_pose(pepper, pepper.neutral(), PUSHED)[2, 3]
    shift = force[:, :2] * height / (9.81 * dynamics.total_mass(pepper))
    task_ik = ik.CenterOfMass(monitor.contacts.mean(axis=0) - shift)
    names = [pepper.joint_names[j] for j in task.joints(pepper)]
    found = ik.solve_batch(pepper, task_ik, home, joints=names, restarts=0, collisions=False)
    good = (margins(found.q) > _SPARE) & (margins(home) < _DOOMED)
    good[good] &= ~collision.in_collision(pepper, found.q[good])
    rows = np.flatnonzero(good)[:BANK]
    if not rows.size:
        raise InvalidValueError("pepper", pepper.name, "a robot that can lean against a push")
    return np.column_stack([force[rows, :2], np.arange(len(rows))]), found.q[rows]
