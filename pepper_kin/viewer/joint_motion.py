"""Joint positions over time, for a viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.identification.replay import Replay, whole_body
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vector, as_joint_vectors
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.samples import refuse_other_joints
from pepper_kin.twin.base.tipping import TippingRun
from pepper_kin.viewer.drawable import rigid_transforms
from pepper_kin.viewer.motion_frames import Curve, limited_series

_TRAJECTORY_STEP = 0.005  # [s]


@dataclass(frozen=True)
class Note:
    """A caption for an interval of a motion.

    Attributes:
        start: Start of the interval [s].
        end: End of the interval [s].
        text: Text of the caption.
        curve: Name of the curve in whose plot the interval is shaded; none if omitted.
    """

    start: float
    end: float
    text: str
    curve: str | None = None


@dataclass(frozen=True, eq=False)
class Ghost(FrozenArrays):
    """A second robot, drawn translucent and in another color over the first.

    Attributes:
        name: Name on a page.
        positions: Joint positions at the times of the motion, shape (T, n) [rad or m].
        series: Lines in the plots of the motion's curves, by the curves' names, values of shape (T,).
        beside: Name of the first robot on a page.
    """

    name: str
    positions: NDArray[np.float64]
    series: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    beside: str = "motion"


@dataclass(frozen=True, eq=False)
class JointMotion(FrozenArrays):
    """Joint positions over time, with curves to plot.

    Attributes:
        times: Sample times, shape (T,), strictly increasing [s].
        positions: Joint positions at the sample times, shape (T, n) [rad or m].
        series: Name of a curve (with unit) -> values of shape (T,).
        limits: Largest allowed magnitude of a curve, by its name, in its unit.
        commands: Commanded values of a curve, by its name, shape (T,).
        ghost: A second robot, shown in recordings, images and videos, but not on the live page.
        notes: Captions of intervals, in recordings.
        tilts: Transforms in the world that tilt the robot, shape (T, 4, 4) [m], or None;
            shown in recordings, images and videos, without contacts with the scene.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    series: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    commands: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    ghost: Ghost | None = None
    notes: tuple[Note, ...] = ()
    tilts: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        times = read_only(as_finite(self.times, "times", (None,)))
        positions = read_only(as_finite(self.positions, "positions", (times.size, None)))
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "series", _lines(self.series, "series", times.size, None))
        object.__setattr__(self, "limits", MappingProxyType(dict(self.limits)))
        object.__setattr__(self, "commands", _lines(self.commands, "command", times.size, self.series))
        if self.ghost is not None:
            of = f"of {self.ghost.name!r}"
            there = read_only(as_finite(self.ghost.positions, f"positions {of}", positions.shape))
            lines = _lines(self.ghost.series, f"series {of}", times.size, self.series)
            object.__setattr__(self, "ghost", replace(self.ghost, positions=there, series=lines))
        object.__setattr__(self, "notes", tuple(self.notes))
        if self.tilts is not None:
            object.__setattr__(self, "tilts", rigid_transforms("tilts", self.tilts, (times.size, 4, 4)))

    @property
    def curves(self) -> dict[str, Curve]:
        """Curves by name, each with its limit, ghost and command."""
        there = {} if self.ghost is None else self.ghost.series
        return {
            name: replace(curve, ghost=there.get(name), command=self.commands.get(name))
            for name, curve in limited_series(self.series, self.limits).items()
        }


def _lines(
    lines: Mapping[str, ArrayLike], quantity: str, samples: int, curves: Mapping[str, object] | None
) -> Mapping[str, NDArray[np.float64]]:
    """Return copies of lines by name, values of shape (samples,); names must be in `curves`, if given."""
    for name in lines:
        if curves is not None and name not in curves:
            raise UnknownNameError(f"curve of a {quantity}", name, curves)
    return MappingProxyType(
        {
            name: read_only(as_finite(values, f"{quantity} {name!r}", (samples,)))
            for name, values in lines.items()
        }
    )


class ExecutedMotion(Protocol):
    """The part of a run of the twin that the viewer reads.

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


Playable: TypeAlias = (
    JointMotion | Trajectory | ExecutedMotion | TippingRun | Replay | NDArray[np.float64] | Sequence[float]
)
"""Types that a viewer can play; an array of shape (n,) is a static posture."""


def still(pepper: PepperModel, q: ArrayLike) -> JointMotion:
    """Return a motion of one sample at joint positions q, shape (n,) [rad or m].

    Raises:
        InvalidValueError: for a q of wrong shape, or with NaN or infinity.
    """
    positions = as_joint_vector(pepper, q, "q")
    return JointMotion(np.zeros(1), positions[None])


def joint_motion(pepper: PepperModel, motion: Playable) -> JointMotion:
    """Convert anything playable to joint positions over time.

    Args:
        pepper: Model of the robot.
        motion: A `JointMotion`, a trajectory (its velocities become curves), a run of the twin (its torques
            become curves), a run that tilts or falls, the replay of a robot's log (the robot becomes the
            ghost), or joint positions of shape (n,).

    Returns:
        The motion.

    Raises:
        InvalidValueError: for a motion of another robot, with NaN or infinity, or of another type.
    """
    if isinstance(motion, JointMotion):
        as_joint_vectors(pepper, motion.positions, "positions")
        return motion
    if isinstance(motion, Trajectory):
        return _of_trajectory(pepper, motion)
    if isinstance(motion, Replay):
        return _of_replay(pepper, motion)
    if isinstance(motion, TippingRun):
        return _of_tipping(pepper, motion)
    if isinstance(motion, np.ndarray | Sequence):
        return still(pepper, motion)
    return _of_run(pepper, motion)


def _of_trajectory(pepper: PepperModel, trajectory: Trajectory) -> JointMotion:
    refuse_other_joints(pepper, trajectory.joint_names)
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


def _of_tipping(pepper: PepperModel, run: TippingRun) -> JointMotion:
    positions = as_joint_vectors(pepper, run.position, "positions of the run")
    tilting = np.flatnonzero(run.angle > 0)
    notes: tuple[Note, ...] = ()
    if tilting.size:
        notes = (Note(float(run.time[tilting[0]]), float(run.time[-1]), run.message, "tilt [rad]"),)
    return JointMotion(run.time, positions, {"tilt [rad]": run.angle}, notes=notes, tilts=run.tilt)


def _of_replay(pepper: PepperModel, found: Replay) -> JointMotion:
    """Return the twin with the robot as its ghost; lost readings are interpolated."""
    log, arrived = found.log, found.log.arrived()
    robot = np.column_stack(
        [np.interp(log.time, log.time[here], log.measured[here, j]) for j, here in enumerate(arrived.T)]
    )
    names = [f"{joint} [{pepper.joint_units[pepper.joint_index(joint)]}]" for joint in log.joint_names]
    twin, ghost, commands = (
        dict(zip(names, angles.T, strict=True)) for angles in (found.twin, robot, log.commands_at(log.time))
    )
    notes = tuple(
        Note(
            stretch.begin,
            stretch.end,
            f"{stretch.joint}: up to {1e3 * stretch.size:.0f} mrad apart ({stretch.kind})",
            names[log.index(stretch.joint)],
        )
        for stretch in found.stretches
    )
    return JointMotion(
        log.time,
        whole_body(pepper, log, found.twin),
        twin,
        commands=commands,
        ghost=Ghost("robot", whole_body(pepper, log, robot), ghost, beside="twin"),
        notes=notes,
    )


def _curves(
    pepper: PepperModel, quantity: str, units: tuple[str, str], values: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return one curve, shape (T,), per joint, of values of shape (T, n).

    `units` are the units of a revolute and of a prismatic joint.
    """
    return {
        f"{joint} {quantity} [{units[unit == 'm']}]": values[:, index]
        for index, (joint, unit) in enumerate(zip(pepper.joint_names, pepper.joint_units, strict=True))
    }


def _limits(curves: Mapping[str, object], limits: NDArray[np.float64]) -> dict[str, float]:
    """Return the limits, shape (n,), by the names of one curve per joint; infinite ones are left out."""
    return {
        name: float(limit)
        for name, limit in zip(curves, limits, strict=True)
        if np.isfinite(limit) and limit > 0
    }
