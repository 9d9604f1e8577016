"""State of the twin, and its error when a step diverges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, kept_read_only
from pepper_kin.exceptions import PepperKinError


class DivergedError(PepperKinError):
    """A step of the twin gave a state that is not finite, or absurd.

    Attributes:
        joint: The joint to blame.
        step: Number of the step, from 1.
        time: When [s].
        cause: What was found.
    """

    def __init__(self, joint: str, step: int, time: float, cause: str) -> None:
        self.joint, self.step, self.time, self.cause = joint, step, time, cause
        super().__init__(f"twin stopped at step {step} ({time:.6g} s): {joint}: {cause}")


@dataclass(frozen=True, eq=False)
class TwinState(FrozenArrays):
    """State of the twin; arrays are read-only.

    Attributes:
        time: Since the last reset [s].
        position: [rad or m], shape (n,).
        velocity: [rad/s or m/s], shape (n,).
        torque: Of the actuators during the last step [N m or N], shape (n,).
        acceleration: Mean over the last step [rad/s^2 or m/s^2], shape (n,); zero after a reset.
    """

    time: float
    position: Array
    velocity: Array
    torque: Array
    acceleration: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not self.acceleration.size:
            object.__setattr__(self, "acceleration", np.zeros_like(self.position))
        for name in ("position", "velocity", "torque", "acceleration"):
            object.__setattr__(self, name, kept_read_only(getattr(self, name)))

    @classmethod
    def of_read_only(cls, time: float, *arrays: Array) -> TwinState:
        """Return the state of a time [s] with arrays that are kept as they are: nobody may write to them.

        Args:
            time: [s].
            arrays: Position, velocity, torque and acceleration, shape (n,) each.
        """
        state = object.__new__(cls)
        position, velocity, torque, acceleration = arrays
        state.__dict__.update(
            time=time, position=position, velocity=velocity, torque=torque, acceleration=acceleration
        )
        return state


def diverged(
    joint_names: Sequence[str],
    step: int,
    time: float,
    before: tuple[Array, Array],
    after: tuple[Array, Array, Array],
    wanted: Array | None = None,
) -> DivergedError:
    """Return the error that names joint, step and cause.

    Args:
        joint_names: The joints.
        step: Number of the step, from 1.
        time: At its end [s].
        before: Position and velocity before it, shape (n,) each.
        after: Position, velocity and torque after it, shape (n,) each.
        wanted: Torques that the actuators wanted [N m or N], shape (n,); one that is not finite is to blame.
    """
    (q0, v0), (q, v, tau) = before, after
    if wanted is not None and not np.isfinite(wanted).all():
        j = int(np.argmax(~np.isfinite(wanted)))
        return DivergedError(joint_names[j], step, time, f"its actuator demands a torque of {wanted[j]}")
    bad = ~(np.isfinite(q) & np.isfinite(v) & np.isfinite(tau))
    j = int(np.argmax(bad)) if bad.any() else int(np.argmax(np.abs(v)))
    cause = f"velocity became {v[j]:.3g} after {v0[j]:.3g}, position {q[j]:.3g} after {q0[j]:.3g}"
    advice = "; lower the timestep or the gains, or check masses and inertias of the links it moves"
    return DivergedError(joint_names[j], step, time, cause + advice)
