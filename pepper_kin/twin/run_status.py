"""How a run of the twin ended: on its reference, away from it, or in contact."""

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
"""Distance below which bodies with a force between them touch [m]: contacts act a little before they do."""
ARRIVING = 0.5
"""A joint that would reach its reference within this time at its present speed is late [s]."""


class RunStatus(ResultStatus):
    """How a run of the twin ended."""

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
    """What the status of a run that went to its end is found from.

    Attributes:
        time: Of its rows [s], shape (T,).
        position: [rad or m], shape (T, n).
        velocity: At the end [rad/s or m/s], shape (n,).
        reference: Position that was to be reached at the end [rad or m], shape (n,); NaN for joints that
            follow no position.
        wrench: From outside [N, N m], shape (T, 6), NaN where unknown; None for none.
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
    """Return the status of a run that went to its end, and why it is not `COMPLETED`, in words.

    Args:
        pepper: The robot.
        end: The run.
        world: What the robot met; contacts are those with a `World`.
        obstacles: Whether the robot was to touch nothing of that world.
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
    """Return where the robot was deepest in contact with a scene while outside forces act; "" for nowhere."""
    acting = np.zeros(0) if end.wrench is None else (end.wrench != 0.0).any(axis=1)  # NaN is not 0 either
    rows = np.flatnonzero(acting)
    if not rows.size:
        return ""
    nearest = least_clearance(pepper, end.position[rows], scene, start + end.time[rows], to="obstacles")
    if nearest.pair is None or nearest.distance > TOUCHING:
        return ""
    return f"{' touches '.join(nearest.pair.names)} at {end.time[rows[nearest.index]]:.3f} s"
