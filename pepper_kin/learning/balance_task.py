"""A robot on its wheels that is pushed, and must lean against the push."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.arrays import Array
from pepper_kin.core.episodes import Score
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.task import BANK, STEPS, RobotTask, places_of, towards
from pepper_kin.learning.task import REACH as FAR
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.twin.base import BalanceMonitor, BatchTipping

if TYPE_CHECKING:
    from pepper_kin.learning.vector_env import PepperVectorEnv

PUSHED = "Neck"
_HARDEST = 60.0  # [N]
_RISE = 1.2  # [s] in which a push rises to its force
_AHEAD = 3  # steps that the oracle is ahead of the push
_FALLEN = 0.25  # [rad] of tilt: the center of mass is over the edge
_SPARE, _DOOMED = 0.02, -0.01  # [m] of margin that leaning leaves at least, and standing still at most


@dataclass(frozen=True)
class BalanceTask(RobotTask):
    """A push at the neck that rises in 1.2 s and stays: a robot that does not lean against it tips over.

    What is led is the zero-moment point of the level robot, to the middle of the wheels; to tilt by 0.25 rad
    is to fail.
    """

    horizon: int = 100
    threshold: float = 0.2

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the places of the joints of hip and knee, shape (3,)."""
        return places_of(pepper, ["HipRoll", "HipPitch", "KneePitch"])

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return pushes [N], shape (m, 2), and which posture withstands each, shape (m, 1)."""
        return pushes_of(pepper, self, seed)[0]

    def force(self, env: PepperVectorEnv) -> Array:
        """Return the present pushes [N], shape (N, 3), along the floor."""
        push = _risen(env.time) * env.episode[:, :2]
        return np.concatenate([push, np.zeros((env.num_envs, 1))], axis=1)

    def advance(self, env: PepperVectorEnv, moves: Array) -> np.ndarray:
        """Let the robots do actions while they are pushed; see `RobotTask.advance`."""
        q = env.twins.position
        wrench = np.concatenate([self.force(env), np.zeros((env.num_envs, 3))], axis=1)
        load = dynamics.external_torque(env.pepper, q, {PUSHED: wrench})
        q[:, env.joints] += FAR * moves
        before, state = env.twins.velocity, _state(env)
        sound = env.twins.step(q, STEPS, speed=env.speed, load=load, threads=env.threads)
        q, v = env.twins.position, env.twins.velocity
        acceleration = (v - before) / env.period
        report = state.tipping.step(q, v, acceleration, env.period, self._outer(env, q))
        state.point[:] = np.where(np.isfinite(report.point), report.point, 1.0)
        return sound

    def begin(self, env: PepperVectorEnv, rows: np.ndarray) -> None:
        """Put robots to where episodes begin, level; see `RobotTask.begin`."""
        env.twins.reset(rows=rows)
        state = _state(env)
        state.tipping.reset(rows)
        state.point[rows] = _at_rest(env.pepper)

    def places(self, env: PepperVectorEnv) -> Array:
        """Return the zero-moment points of the last step's mean acceleration [m], shape (N, 1, 3)."""
        return np.pad(_state(env).point, ((0, 0), (0, 1)))[:, np.newaxis]

    def goals(self, env: PepperVectorEnv) -> Array:
        """Return the middle of the wheels [m], shape (N, 1, 3)."""
        middle = np.append(_monitor(env.pepper).contacts.mean(axis=0), 0.0)
        return np.tile(middle, (env.num_envs, 1, 1))

    def extra(self, env: PepperVectorEnv) -> Array:
        """Return the present push over 60 N, and about which axis the robots tilt and how fast, shape (N, 6).

        The tilt is in shares of 0.25 rad, its rate in rad/s.
        """
        tipping, contacts = _state(env).tipping, _monitor(env.pepper).contacts
        side = np.roll(contacts, -1, axis=0) - contacts
        axis = (side / np.linalg.norm(side, axis=1, keepdims=True))[tipping.edge]
        tilt, rate = tipping.angle[:, np.newaxis] * axis, tipping.rate[:, np.newaxis] * axis
        return np.concatenate([self.force(env)[:, :2] / _HARDEST, tilt / _FALLEN, rate], axis=1)

    def score(self, env: PepperVectorEnv, places: Array, goals: Array) -> Score:
        """Return how far the points are from the middle, and which robots fall; see `RobotTask.score`."""
        found, tipping = super().score(env, places, goals), _state(env).tipping
        return found._replace(success=tipping.edge < 0, failed=tipping.fallen)

    def wanted(self, env: PepperVectorEnv) -> Array:
        """Lean as the push rises; see `RobotTask.wanted`."""
        leaning, home = pushes_of(env.pepper, self, env.goal_seed)[1], env.pepper.neutral()
        share = _risen(env.time + _AHEAD * env.period)
        return towards(env, home + share * (leaning[env.episode[:, 2].astype(np.int64)] - home))

    def _outer(self, env: PepperVectorEnv, q: Array) -> Array:
        """Return force and moment of the pushes about the world's origin, shape (N, 6)."""
        force, place = self.force(env), kinematics.frame_pose(env.pepper, q, PUSHED)[:, :3, 3]
        return np.concatenate([force, np.cross(place, force)], axis=1)


class _State(NamedTuple):
    """How N robots stand: their tilts, and zero-moment points [m], shape (N, 2), far away for none."""

    tipping: BatchTipping
    point: Array


def _state(env: PepperVectorEnv) -> _State:
    def new() -> _State:
        tipping = BatchTipping(_monitor(env.pepper), env.num_envs, fallen_at=_FALLEN)
        return _State(tipping, np.tile(_at_rest(env.pepper), (env.num_envs, 1)))

    return env.made("balance", new)


@kept_for_robot(most=8)
def _at_rest(pepper: PepperModel) -> Array:
    return dynamics.center_of_mass(pepper, pepper.neutral())[:2]


@kept_for_robot(most=8)
def _monitor(pepper: PepperModel) -> BalanceMonitor:
    return BalanceMonitor(pepper)


def _risen(time: Array) -> Array:
    """Return the share of a push after a time [s], shape (N, 1)."""
    share = np.minimum(time / _RISE, 1.0)[:, np.newaxis]
    return share * share * (3.0 - 2.0 * share)


@kept_for_robot(most=8)
def pushes_of(pepper: PepperModel, task: BalanceTask, seed: int) -> tuple[Array, Array]:
    """Return episodes, shape (m, 3), and postures that withstand their pushes [rad], shape (m, n).

    Raises:
        InvalidValueError: where the robot withstands none.
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
