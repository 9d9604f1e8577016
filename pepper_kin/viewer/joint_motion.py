"""Joint positions over time, as a viewer plays them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vector, as_joint_vectors
from pepper_kin.trajectory import Trajectory

_TRAJECTORY_STEP = 0.005  # [s]


@dataclass(frozen=True, eq=False)
class JointMotion(FrozenArrays):
    """Joint positions over time, with curves to plot beside them.

    Attributes:
        times: Sample times, shape (T,), strictly increasing [s].
        positions: Joint positions at those times, shape (T, n) [rad or m].
        series: Curves, name (with unit) to values of shape (T,).
        limits: Largest magnitude that a curve may have, by its name, in its unit.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    series: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = read_only(as_finite(self.times, "times", (None,)))
        positions = read_only(as_finite(self.positions, "positions", (times.size, None)))
        curves = {
            name: read_only(as_finite(values, f"series {name!r}", (times.size,)))
            for name, values in self.series.items()
        }
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "series", MappingProxyType(curves))
        object.__setattr__(self, "limits", MappingProxyType(dict(self.limits)))


class ExecutedMotion(Protocol):
    """What the viewer reads of a run of the twin.

    Attributes:
        time: Sample times, shape (T,) [s].
        position: Joint positions, shape (T, n) [rad or m].
        torque: Joint torques or forces, shape (T, n) [N m or N].
    """

    @property
    def time(self) -> NDArray[np.float64]:
        """Sample times."""

    @property
    def position(self) -> NDArray[np.float64]:
        """Joint positions."""

    @property
    def torque(self) -> NDArray[np.float64]:
        """Joint torques."""


Playable: TypeAlias = JointMotion | Trajectory | ExecutedMotion | NDArray[np.float64] | Sequence[float]
"""What a viewer can play; an array of shape (n,) is a posture held still."""


def still(pepper: PepperModel, q: ArrayLike) -> JointMotion:
    """Return the motion that stays at joint positions q, shape (n,) [rad or m].

    Raises:
        InvalidValueError: for a q of wrong shape, or with NaN or infinity.
    """
    positions = as_joint_vector(pepper, q, "q")
    return JointMotion(np.zeros(1), positions[None])


def joint_motion(pepper: PepperModel, motion: Playable) -> JointMotion:
    """Return anything that can be played as joint positions over time.

    Args:
        pepper: The robot.
        motion: A `JointMotion`, a trajectory (its velocities become curves), a run of the twin (its torques
            become curves), or joint positions of shape (n,).

    Returns:
        The motion.

    Raises:
        InvalidValueError: for a motion of another robot, with NaN or infinity, or for something else.
    """
    if isinstance(motion, JointMotion):
        as_joint_vectors(pepper, motion.positions, "positions")
        return motion
    if isinstance(motion, Trajectory):
        return _of_trajectory(pepper, motion)
    if isinstance(motion, np.ndarray | Sequence):
        return still(pepper, motion)
    return _of_run(pepper, motion)


def _of_trajectory(pepper: PepperModel, trajectory: Trajectory) -> JointMotion:
    if trajectory.joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the trajectory", ", ".join(trajectory.joint_names), ", ".join(pepper.joint_names)
        )
    samples = trajectory.sample(_TRAJECTORY_STEP)
    curves = _curves(pepper, "velocity", ("rad/s", "m/s"), samples.velocity)
    return JointMotion(samples.time, samples.position, curves, _limits(curves, pepper.velocity_limits))


def _of_run(pepper: PepperModel, run: ExecutedMotion) -> JointMotion:
    try:
        times, positions, torques = run.time, run.position, run.torque
    except AttributeError as error:
        allowed = "a run, a trajectory, a JointMotion or joint positions"
        raise InvalidValueError("motion", type(run).__name__, allowed) from error
    positions = as_joint_vectors(pepper, positions, "positions of the run")
    torques = as_joint_vectors(pepper, torques, "torques of the run")
    curves = _curves(pepper, "torque", ("N m", "N"), torques)
    return JointMotion(times, positions, curves, _limits(curves, pepper.effort_limits))


def _curves(
    pepper: PepperModel, quantity: str, units: tuple[str, str], values: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return one curve, shape (T,), per joint, of values of shape (T, n).

    `units` are those of a turning and of a sliding joint.
    """
    return {
        f"{joint} {quantity} [{units[unit == 'm']}]": values[:, index]
        for index, (joint, unit) in enumerate(zip(pepper.joint_names, pepper.joint_units, strict=True))
    }


def _limits(curves: Mapping[str, object], limits: NDArray[np.float64]) -> dict[str, float]:
    """Return the limits, shape (n,), of one curve per joint, where a joint has one."""
    return {
        name: float(limit)
        for name, limit in zip(curves, limits, strict=True)
        if np.isfinite(limit) and limit > 0
    }
