"""Cost of a motion, and its terms for a trajectory."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.collision.loads import load_torque
from pepper_kin.core.kernel_batch import evaluate
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_real, shown
from pepper_kin.trajectory import Trajectory

JERK_STEP = 0.01
"""Time between accelerations whose differences give the jerk [s]."""


@dataclass(frozen=True)
class Cost:
    """Weights of the terms of a motion's cost.

        time T + jerk J + effort E + clearance C
        J = integral of sum_j (jerk_j / maximum acceleration_j)^2 dt   [1/s]
        E = integral of sum_j (torque_j / maximum torque_j)^2 dt       [s]
        C = integral of sum (1 - distance / INFLUENCE)^2 dt             [s], over the nearest pairs of bodies
                                                                        that are nearer than that

    Attributes:
        time: Weight of the duration [1/s].
        jerk: Weight of the jerk [s].  By default 100/s cost as much as 10 ms; motions of the whole body have
            50 to 500/s, time-optimal ones along a path up to 3000/s.  1e-3 makes motions smooth and a few
            percent longer; with 1e-6 only the duration matters.
        effort: Weight of the effort [1/s].
        clearance: Weight of closeness to bodies [1/s].
    """

    time: float = 1.0
    jerk: float = 1e-4
    effort: float = 0.0
    clearance: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not 0 <= as_real(value) < math.inf:
                weight = f"weight of {item.name}"
                raise InvalidValueError(weight, shown(value), "a finite number of 0 or more")
        if self.time == 0 and self.jerk == 0 and self.effort == 0 and self.clearance == 0:
            raise InvalidValueError("weights", "0 for all", "at least one above 0")


@dataclass(frozen=True)
class Figures:
    """Cost terms evaluated on a trajectory.

    Attributes:
        duration: Duration T [s].
        jerk: Jerk integral J [1/s], by differences of accelerations every `JERK_STEP`, including rest before
            and after: finite even if accelerations jump.
        effort: Effort integral E [s].
    """

    duration: float
    jerk: float
    effort: float

    def cost(self, cost: Cost) -> float:
        """Return the total cost of duration, jerk and effort."""
        return cost.time * self.duration + cost.jerk * self.jerk + cost.effort * self.effort


def jerk_scale(pepper: PepperModel) -> Array:
    """Return the jerk of each joint that counts as 1: its maximum acceleration per second, shape (n,)."""
    stated = np.isfinite(pepper.acceleration_limits) & (pepper.acceleration_limits > 0)
    return np.where(stated, pepper.acceleration_limits, 1.0)


def figures_of(pepper: PepperModel, trajectory: Trajectory, loads: Loads = ()) -> Figures:
    """Return the cost terms of a trajectory with carried loads."""
    steps = max(int(np.ceil(trajectory.duration / JERK_STEP)), 2)
    dt = trajectory.duration / steps
    state = trajectory(np.linspace(0.0, trajectory.duration, steps + 1))
    acceleration = np.zeros((steps + 3, pepper.n))
    acceleration[1:-1] = state.acceleration
    jerk = (acceleration[1:] - acceleration[:-1]) / (dt * jerk_scale(pepper))
    share = evaluate(kernel(pepper, "inverse_dynamics"), *map(np.ascontiguousarray, state))
    if loads:
        share += load_torque(pepper, loads, *state)
    share /= pepper.effort_limits
    effort = np.vdot(share, share) - (np.vdot(share[0], share[0]) + np.vdot(share[-1], share[-1])) / 2
    return Figures(trajectory.duration, float(np.vdot(jerk, jerk) * dt), float(effort * dt))
