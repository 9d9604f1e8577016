"""Status of a run of the twin: on its reference at the end, away from it, or in contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import closest_pair, least_clearance
from pepper_kin.status import ResultStatus
from pepper_kin.twin.world.world import World

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.model import PepperModel


END_TOLERANCE = {"rad": 0.02, "m": 0.01}
"""Distance from the end of the reference up to which a run has completed [rad] or [m]."""
TOUCHING = 5e-4
"""Distance below which bodies with a force between them touch [m]: forces act slightly before contact."""
ARRIVING = 0.5
"""A joint that would reach its reference within this time at its present speed is late [s]."""


class RunStatus(ResultStatus):
    """Status of a run of the twin."""

    COMPLETED = "completed", "The run went to its end, and the robot is where its reference is."
    TOUCHED = (
        "touched",
        "The robot is where its reference is, but it touched something of the scene on its way: plan more "
        "clearly of it with plan(margin=0.01), or let the pair touch with Scene.allow().",
    )
    BLOCKED = (
        "blocked",
        "Something in the way keeps the robot from its reference: plan around it, or move it away.",
    )
    LATE = "late", "The robot is still on its way to its reference: use a hold_time, or a slower motion."
    OFF_REFERENCE = (
        "off_reference",
        "The robot does not reach its reference: leave its motors more torque with retime(torque_scale=0.7), "
        "and tell what it carries with retime(payload={}).",
    )
    STOPPED = "stopped", "The state diverged, or a contact could not be solved: use a smaller timestep."


class RunEnd(NamedTuple):
    """Data of a completed run from which its status follows.

    Attributes:
        time: Times of the rows [s], shape (T,).
        position: Joint positions [rad or m], shape (T, n).
        velocity: Joint velocities at the end [rad/s or m/s], shape (n,).
        reference: Reference position at the end [rad or m], shape (n,); NaN for joints without one.
        wrench: External wrench [N, N m], shape (T, 6), NaN if unknown; None for none.
    """

    time: Array
    position: Array
    velocity: Array
    reference: Array
    wrench: Array | None = None


def status_of(
    pepper: PepperModel,
    end: RunEnd,
    world: object = None,
    obstacles: bool = False,
    start: float = 0.0,
) -> tuple[RunStatus, str]:
    """Return the status of a run that reached its end, and the reason if it is not `COMPLETED`.

    Args:
        pepper: The robot.
        end: Data of the run.
        world: World around the robot; only contacts with a `World` count.
        obstacles: Whether the robot should touch nothing of the world.
        start: Time of the world at which the run begins [s].
    """
    error = end.reference - end.position[-1]
    ratio = np.nan_to_num(np.abs(error) / [END_TOLERANCE[unit] for unit in pepper.joint_units])
    j = int(np.argmax(ratio))
    touch = _touch(pepper, world.scene, end, start) if obstacles and isinstance(world, World) else ""
    if ratio[j] <= 1.0:
        return (RunStatus.TOUCHED, touch) if touch else (RunStatus.COMPLETED, "")
    unit = pepper.joint_units[j]
    off = f"{pepper.joint_names[j]} ends {abs(error[j]):.3g} {unit} from its reference"
    if isinstance(world, World):
        nearest = closest_pair(pepper, end.position[-1], world.snapshot(), to="obstacles")
        if nearest is not None and nearest.distance <= TOUCHING:
            return RunStatus.BLOCKED, f"{off}: {' touches '.join(nearest.names)}"
    if touch:
        return RunStatus.BLOCKED, f"{off}: {touch}"
    if end.velocity[j] * np.sign(error[j]) * ARRIVING >= abs(error[j]):
        return RunStatus.LATE, f"{off}, and still moves to it with {abs(end.velocity[j]):.3g} {unit}/s"
    return RunStatus.OFF_REFERENCE, off


def _touch(pepper: PepperModel, scene: Scene, end: RunEnd, start: float) -> str:
    """Return words on the deepest contact with a scene while external forces act; "" for none."""
    acting = np.zeros(0) if end.wrench is None else (end.wrench != 0.0).any(axis=1)  # NaN is not 0 either
    rows = np.flatnonzero(acting)
    if not rows.size:
        return ""
    nearest = least_clearance(pepper, end.position[rows], scene, start + end.time[rows], to="obstacles")
    if nearest.pair is None or nearest.distance > TOUCHING:
        return ""
    return f"{' touches '.join(nearest.pair.names)} at {end.time[rows[nearest.index]]:.3f} s"
