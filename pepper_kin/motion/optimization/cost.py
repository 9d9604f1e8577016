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
"""Time between the accelerations whose differences are taken as jerk [s]."""


@dataclass(frozen=True)
class Cost:
    """Weights of what makes a motion expensive.

        time T + jerk J + effort E + clearance C
        J = integral of sum_j (jerk_j / greatest acceleration_j)^2 dt   [1/s]
        E = integral of sum_j (torque_j / greatest torque_j)^2 dt       [s]
        C = integral of sum (1 - distance / INFLUENCE)^2 dt             [s], over the nearest pairs of bodies
                                                                        that are nearer than that

    Attributes:
        time: Weight of the duration [1/s].
        jerk: Weight of the jerk [s].  By default 100/s cost as much as 10 ms; motions of the whole body have
            50 to 500/s, along a path in the shortest time up to 3000/s.  1e-3 makes motions soft and some
            per cent longer, 1e-6 leaves it to the duration alone.
        effort: Weight of the effort [1/s].
        clearance: Weight of being near to things [1/s].
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
    """Measured on a trajectory.

    Attributes:
        duration: T [s].
        jerk: J [1/s], by differences of the accelerations every `JERK_STEP`, rest before and after included:
            finite also where accelerations jump.
        effort: E [s].
    """

    duration: float
    jerk: float
    effort: float

    def cost(self, cost: Cost) -> float:
        """Return what duration, jerk and effort cost together."""
        return cost.time * self.duration + cost.jerk * self.jerk + cost.effort * self.effort


def jerk_scale(pepper: PepperModel) -> Array:
    """Return the jerk of each joint that counts as 1: its greatest acceleration per second, shape (n,)."""
    stated = np.isfinite(pepper.acceleration_limits) & (pepper.acceleration_limits > 0)
    return np.where(stated, pepper.acceleration_limits, 1.0)


def figures_of(pepper: PepperModel, trajectory: Trajectory, loads: Loads = ()) -> Figures:
    """Measure a trajectory with what is carried."""
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
