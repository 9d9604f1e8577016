"""A robot on its wheels that is pushed, and must lean against the push."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.arrays import Array
from pepper_kin.dynamics.support_polygon import distances_inside, inward_normals
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.task import BANK, STEPS, RobotTask, Score, places_of, towards
from pepper_kin.learning.task import REACH as FAR
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.twin.base.balance import BalanceMonitor

if TYPE_CHECKING:
    from pepper_kin.learning.vector_env import PepperVectorEnv

PUSHED = "Neck"
_HARDEST = 60.0  # [N]
_RISE = 1.2  # [s] in which a push rises to its force
_AHEAD = 3  # steps that the oracle is ahead of the push
_TIPPING = 5  # steps with the point outside, after which a robot is taken to tip over
_SPARE, _DOOMED = 0.02, -0.01  # [m] of margin that leaning leaves at least, and standing still at most


@dataclass(frozen=True)
class BalanceTask(RobotTask):
    """A push at the neck that rises in 1.2 s and stays: a robot that does not lean against it tips over.

    What is led is the zero-moment point, to the middle of the wheels; to leave their triangle for 0.1 s is
    to fail.
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
        env.kept("velocity", env.pepper.n)[:] = env.twins.velocity
        return env.twins.step(q, STEPS, speed=env.speed, load=load, threads=env.threads)

    def places(self, env: PepperVectorEnv) -> Array:
        """Return the zero-moment points of the last step's mean acceleration [m], shape (N, 1, 3)."""
        point = self._points(env)
        return np.concatenate([point, np.zeros((env.num_envs, 1))], axis=1)[:, np.newaxis]

    def goals(self, env: PepperVectorEnv) -> Array:
        """Return the middle of the wheels [m], shape (N, 1, 3)."""
        middle = np.append(_monitor(env.pepper).contacts.mean(axis=0), 0.0)
        return np.tile(middle, (env.num_envs, 1, 1))

    def extra(self, env: PepperVectorEnv) -> Array:
        """Return the present push over 60 N, shape (N, 2)."""
        return self.force(env)[:, :2] / _HARDEST

    def score(self, env: PepperVectorEnv, places: Array, goals: Array) -> Score:
        """Return how far the points are from the middle, and which robots tip; see `RobotTask.score`."""
        contacts = _monitor(env.pepper).contacts
        inside = distances_inside(contacts, inward_normals(contacts), places[:, 0, :2])
        found, margin = super().score(env, places, goals), inside.min(axis=1)
        return found._replace(success=margin > 0.0, failed=env.lasting(margin < 0.0, _TIPPING))

    def wanted(self, env: PepperVectorEnv) -> Array:
        """Lean as the push rises; see `RobotTask.wanted`."""
        leaning, home = pushes_of(env.pepper, self, env.goal_seed)[1], env.pepper.neutral()
        share = _risen(env.time + _AHEAD * env.period)
        return towards(env, home + share * (leaning[env.episode[:, 2].astype(np.int64)] - home))

    def _points(self, env: PepperVectorEnv) -> Array:
        """Return zero-moment points [m], far away where the floor would have to pull, shape (N, 2)."""
        q, v = env.twins.position, env.twins.velocity
        a = np.where(
            env.elapsed[:, np.newaxis] > 0, (v - env.kept("velocity", env.pepper.n)) / env.period, 0.0
        )
        force = self.force(env)
        place = kinematics.frame_pose(env.pepper, q, PUSHED)[:, :3, 3]
        outer = np.concatenate([force, np.cross(place, force)], axis=1)
        report = _monitor(env.pepper).assess(np.arange(float(len(q))), q, v, a, outer)
        return np.where(np.isfinite(report.point), report.point, 1.0)


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
