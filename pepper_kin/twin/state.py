"""State of the twin, and the error of a step that diverges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, kept_read_only
from pepper_kin.exceptions import PepperKinError


class DivergedError(PepperKinError):
    """Error if a step of the twin results in a state that is not finite or not plausible.

    Attributes:
        joint: Name of the joint at fault.
        step: Index of the step, from 1.
        time: Time of the step [s].
        cause: Cause of the error.
    """

    def __init__(self, joint: str, step: int, time: float, cause: str) -> None:
        self.joint, self.step, self.time, self.cause = joint, step, time, cause
        super().__init__(f"twin stopped at step {step} ({time:.6g} s): {joint}: {cause}")


@dataclass(frozen=True, eq=False)
class TwinState(FrozenArrays):
    """State of the twin; arrays are read-only.

    Attributes:
        time: Time since the last reset [s].
        position: Joint positions [rad or m], shape (n,).
        velocity: Joint velocities [rad/s or m/s], shape (n,).
        torque: Torques of the actuators during the last step [N m or N], shape (n,).
        acceleration: Mean accelerations over the last step [rad/s^2 or m/s^2], shape (n,); zero after a
            reset.
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
        """Return the state at a time with arrays that are not copied, and must not be changed.

        Args:
            time: Time since the last reset [s].
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
    """Return the error of a diverged step, naming joint, step and cause.

    Args:
        joint_names: Names of the joints.
        step: Index of the step, from 1.
        time: Time at the end of the step [s].
        before: Position and velocity before the step, shape (n,) each.
        after: Position, velocity and torque after the step, shape (n,) each.
        wanted: Torques demanded by the actuators [N m or N], shape (n,); the first one that is not finite is
            the cause.
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
