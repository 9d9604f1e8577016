"""Motions that excite a robot's inertial parameters: finite Fourier series within the limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision import Scene
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.fast import FastChecker, fast_checker_for
from pepper_kin.collision.loads import loads_of
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.identification.base_parameters import BaseParameters, base_parameters, torque_columns
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vector,
    check_positive,
    check_whole,
    check_within_limits,
)
from pepper_kin.model.requirements import checked_share
from pepper_kin.trajectory import Certificate, Samples, Trajectory, check
from pepper_kin.trajectory.limits import LimitedQuantities, MotionLimits

RANGE_SHARE = 0.95
"""Maximum ratio of the distance from the posture to a position limit that is used."""

FACTORS = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
"""Factors by which a motion is scaled, in order, until it keeps torque, balance and clearance."""

STEP = 0.3
"""Standard deviation of a local step, relative to coefficients of 1."""

_PER_PERIOD = 20  # samples per shortest period; quintic pieces between them have a relative error of 1e-8
_ENDLESS = np.pi  # amplitude of a joint without position limits [rad or m]


@dataclass(frozen=True, eq=False)
class Excitation(BriefRepr):
    """A motion that excites joints.

    Attributes:
        trajectory: The motion; it begins and ends at rest in the same posture.
        joints: Names of the joints that move.
        condition: Condition number of the stacked regressor of the base parameters of bodies and rotors,
            with each joint's torques relative to its effort limit.
        parameters: Names of the base parameters; see `estimate_inertia`.
        certificate: Result of `trajectory.check`.
    """

    trajectory: Trajectory
    joints: tuple[str, ...]
    condition: float
    parameters: tuple[str, ...]
    certificate: Certificate


def excitation_motion(
    pepper: PepperModel,
    joints: str | Iterable[str] | None = None,
    *,
    duration: float = 10.0,
    harmonics: int = 5,
    posture: str | ArrayLike | None = None,
    draws: int = 200,
    seed: int = 0,
    limit_share: float = 0.8,
    clearance: float = 0.01,
    scene: Scene | None = None,
    collisions: bool = True,
) -> Excitation:
    """Return a motion whose torques are best suited to estimate the inertial parameters of a robot.

    Each joint moves by a finite Fourier series about a posture (Swevers et al., IEEE Trans. Robotics and
    Automation 13(5), 1997),

        q(t) = q_0 + sum_l a_l / (w l) sin(w l t) - b_l / (w l) cos(w l t),  w = 2 pi / duration,

    with sum a_l = sum b_l / l = sum b_l l = 0: it begins and ends in the posture, at rest and without
    acceleration.  The first half of the draws has random coefficients, the others are near the best so far;
    each draw is scaled as far as position, velocity, acceleration, torque, balance and clearance allow.  The
    motion with the minimum condition number of the regressor is returned.

    Args:
        pepper: The robot.
        joints: Joints and groups that move, see `PepperModel.resolve_joints`; all if omitted.
        duration: Duration of the motion, one period [s].
        harmonics: Number of terms, at least 3.
        posture: Name or positions [rad or m], shape (n,); the middle of all ranges, where Pepper's
            arms point ahead, if omitted.
        draws: Number of motions that are tried.
        seed: Seed of the draws: the same seed gives the same motion.
        limit_share: Ratio of the limits of velocity, acceleration and torque that is used, in (0, 1].
        clearance: Distance that bodies keep from each other and the scene at the samples of the search [m].
        scene: The world around the robot; None for none.  The mass of attached objects counts.
        collisions: Whether collisions are checked.

    Returns:
        The motion with its condition number and certificate.

    Raises:
        UnknownNameError: for a joint, group or posture that the robot lacks.
        InvalidValueError: naming the argument that is out of range.
        LimitError: for a posture outside the limits.
        InfeasibleError: if the limits, or the world around the robot, leave no motion, naming the joint.
    """
    names = pepper.resolve_joints(joints)
    check_positive("duration", duration, "s")
    check_whole("harmonics", harmonics, 3)
    check_whole("draws", draws)
    world, kept = checked_world(scene, collisions), check_positive("clearance", clearance, "m")
    share, balance = checked_share("limit_share", limit_share), checked_balance(pepper, 0.0, if_wheeled=True)
    chosen = MotionLimits(share, share, share, balance, loads_of(pepper, scene))
    limits = chosen.of(pepper, pepper.acceleration_limits, drives=True)
    rest = _rest(pepper, posture)
    base = base_parameters(pepper, names, rest)
    time, curves = _curves(duration, harmonics)
    problem = _ExcitationProblem(
        pepper,
        [pepper.joint_index(name) for name in names],
        rest,
        base,
        curves,
        (limits.velocity, limits.acceleration),
        LimitedQuantities(pepper, limits),
        None if world is None else fast_checker_for(pepper, world, kept, kept),
    )
    problem.refuse_hopeless(names)
    best, size = _search(problem, draws, np.random.default_rng(seed))
    for factor in (1.0, 0.97, 0.9, 0.8):
        state = problem.state(best, factor * size)
        trajectory = Samples(pepper.joint_names, time, *state, pepper.joint_units).to_trajectory()
        certificate = check(pepper, trajectory, scene=scene, collisions=collisions)
        if certificate.success:
            return Excitation(trajectory, names, problem.condition(state), base.names, certificate)
    raise InfeasibleError("excitation motion", certificate.report(), "give another posture, or more draws")


def _rest(pepper: PepperModel, posture: str | ArrayLike | None) -> Array:
    """Return the posture about which joints move, shape (n,)."""
    if isinstance(posture, str):
        return pepper.posture(posture)
    if posture is not None:
        q = as_joint_vector(pepper, posture, "posture")
        check_within_limits(pepper, q, "posture")
        return q
    middle = 0.5 * (pepper.lower_limits + pepper.upper_limits)
    return np.where(np.isfinite(middle), middle, pepper.neutral())


def _curves(duration: float, harmonics: int) -> tuple[Array, Array]:
    """Return times [s], shape (T,), and a basis of the series that begin and end at rest at zero.

    The basis is position, velocity and acceleration, shape (3, T, 2 harmonics - 3).
    """
    time = np.linspace(0.0, duration, _PER_PERIOD * harmonics + 1)
    order = np.arange(1, harmonics + 1)
    rate = 2.0 * np.pi / duration * order
    sine, cosine = np.sin(np.outer(time, rate)), np.cos(np.outer(time, rate))
    odd = np.stack([sine / rate, cosine, -rate * sine]) @ _null_space(np.ones((1, harmonics)))
    even = np.stack([-cosine / rate, sine, rate * cosine]) @ _null_space(np.stack([1.0 / order, order]))
    curves = np.concatenate([odd, even], axis=2)
    curves[:, [0, -1]] = 0.0  # zero except for rounding
    return time, curves


def _null_space(rows: Array) -> Array:
    return np.asarray(np.linalg.svd(rows)[2][len(rows) :].T)


class _ExcitationProblem(NamedTuple):
    """Limits of a motion, and the parameters that it should excite.

    Attributes:
        pepper: The robot.
        moving: Indices of the joints that move, k of them.
        rest: The posture, shape (n,).
        base: The base parameters.
        curves: Position, velocity and acceleration of the c basis series, shape (3, T, c).
        rates: Maximum velocity and acceleration, shape (n,) each.
        quantities: Other limited quantities, such as torque and balance.
        checker: Checker that finds bodies that are too near; None to ignore collisions.
    """

    pepper: PepperModel
    moving: list[int]
    rest: Array
    base: BaseParameters
    curves: Array
    rates: tuple[Array, Array]
    quantities: LimitedQuantities
    checker: FastChecker | None

    def room(self) -> tuple[Array, Array]:
        """Return the maximum displacements of joints down and up from the posture, shape (k,) each."""
        robot, q = self.pepper, self.rest[self.moving]
        down = RANGE_SHARE * (q - robot.lower_limits[self.moving])
        up = RANGE_SHARE * (robot.upper_limits[self.moving] - q)
        return np.where(np.isfinite(down), down, _ENDLESS), np.where(np.isfinite(up), up, _ENDLESS)

    def largest(self, coefficients: Array) -> Array:
        """Return coefficients, shape (c, k), each joint's scaled to its own position and rate limits."""
        q, v, a = self.curves @ coefficients
        down, up = self.room()
        uses = [q.max(axis=0) / up, -q.min(axis=0) / down]
        for size, limit in zip((v, a), self.rates, strict=True):
            uses.append(np.abs(size).max(axis=0) / limit[self.moving])
        return np.asarray(coefficients / np.max(uses, axis=0))

    def state(self, coefficients: Array, factor: float) -> tuple[Array, Array, Array]:
        """Return positions, velocities and accelerations of a motion, shape (T, n) each."""
        state = np.zeros((3, self.curves.shape[1], self.pepper.n))
        state[0] = self.rest
        state[:, :, self.moving] += factor * (self.curves @ coefficients)
        return state[0], state[1], state[2]

    def broken(self, state: tuple[Array, Array, Array]) -> str:
        """Return a text that names the limit a motion violates; empty for none."""
        effects = self.quantities.of(*state)
        over = (np.abs(effects.torque) > self.quantities.torque_limit).any(axis=0)
        if over.any():
            j = int(np.argmax(over))
            names = (*self.pepper.joint_names, *["a wheel"] * over.size)
            return f"{names[j]} needs more than its torque limit of {self.quantities.torque_limit[j]:.4g}"
        if (effects.moments < 0).any():
            return "the robot tips"
        if (effects.frame_speed > 1).any():
            return "the base is too fast"
        if self.checker is not None:
            touching = self.checker.in_collision(state[0])
            if touching.any():
                pair = self.checker.exact.closest_pair(state[0][np.argmax(touching)])
                return ("bodies" if pair is None else " and ".join(pair.names)) + " come too near"
        return ""

    def refuse_hopeless(self, names: tuple[str, ...]) -> None:
        """Refuse joints that cannot move, and a posture that cannot be held.

        Raises:
            InfeasibleError: naming the joint, or the obstacle.
        """
        down, up = self.room()
        for k, name in enumerate(names):
            for quantity, limit in zip(("velocity", "acceleration"), self.rates, strict=True):
                if limit[self.moving[k]] == 0:
                    raise InfeasibleError(
                        "excitation motion", f"the {quantity} limit of {name} is 0", "leave that joint out"
                    )
            if min(down[k], up[k]) <= 0:
                raise InfeasibleError(
                    "excitation motion",
                    f"{name} stands at an end of its range",
                    "give a posture inside the ranges, or leave that joint out",
                )
        rest = self.rest[None]
        reason = self.broken((rest, np.zeros_like(rest), np.zeros_like(rest)))
        if reason:
            raise InfeasibleError("excitation motion", f"in its posture {reason}", "give another posture")

    def condition(self, state: tuple[Array, Array, Array]) -> float:
        """Return the condition number of the stacked regressor."""
        effort = self.pepper.effort_limits[self.moving]
        rows = torque_columns(self.pepper, self.moving, *state)[:, :, self.base.columns]
        rows = rows / np.where(np.isfinite(effort) & (effort > 0), effort, 1.0)[:, None]
        return float(np.linalg.cond(rows.reshape(-1, rows.shape[2])))


def _search(problem: _ExcitationProblem, draws: int, random: np.random.Generator) -> tuple[Array, float]:
    """Return the best coefficients and the factor on them.

    Raises:
        InfeasibleError: if no draw keeps all limits, naming the limit that the last draw violates.
    """
    shape = (problem.curves.shape[2], len(problem.moving))
    best: tuple[float, NDArray[np.float64], float] | None = None
    reason = ""
    for k in range(draws):
        drawn = random.normal(size=shape)
        if best is not None and 2 * k >= draws:
            unit = best[1] / np.sqrt(np.mean(best[1] ** 2, axis=0))
            drawn = unit + STEP * drawn
        coefficients = problem.largest(drawn)
        for factor in FACTORS:
            state = problem.state(coefficients, factor)
            reason = problem.broken(state)
            if not reason:
                condition = problem.condition(state)
                if best is None or condition < best[0]:
                    best = condition, coefficients, factor
                break
    if best is None:
        raise InfeasibleError("excitation motion", reason, "give another posture, or other joints")
    return best[1], best[2]
