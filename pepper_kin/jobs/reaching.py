"""Main job: reach with a hand and look at a point, without collisions and within all limits."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import BriefRepr, read_only
from pepper_kin.collision import Scene, clearance_along
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.ik import HandPosition, IKResult, IKStatus, LookAt, solve
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.motion import Plan, PlanStatus, plan
from pepper_kin.trajectory import Certificate, Trajectory, retime
from pepper_kin.twin import Run, Twin

CAMERA = "CameraTop_frame"
_FAR = 1e4  # distance from which messages give few digits [m]
HOLD_TIME = 0.5  # time that the twin continues after the end of the motion [s]


@dataclass(frozen=True, eq=False)
class ReachOutcome(BriefRepr):
    """Outcome of one reach.

    Attributes:
        hand: "left" or "right".
        target: Target of the palm [m], shape (3,).
        gaze: Target of the camera's gaze [m], shape (3,), or None.
        scene: The world.
        plan: Plan with IK and path, which may be unsuccessful.
        trajectory: The timed motion, or None.
        certificate: The check of the motion by code other than the planner's, or None.
        run: Run of the twin, or None.
        figures: Numbers of the report by name, in SI units.
        message: Result in one sentence.
    """

    hand: str
    target: NDArray[np.float64]
    gaze: NDArray[np.float64] | None
    scene: Scene
    plan: Plan
    trajectory: Trajectory | None
    certificate: Certificate | None
    run: Run | None
    figures: dict[str, Any]
    message: str

    @property
    def success(self) -> bool:
        """Whether the twin completed the motion and its certificate passed."""
        return (
            self.run is not None
            and self.run.success
            and self.certificate is not None
            and self.certificate.success
        )


def reach(
    pepper: PepperModel,
    hand: str,
    at: ArrayLike,
    look_at: ArrayLike | None = None,
    scene: Scene | None = None,
    *,
    start: ArrayLike | None = None,
    seed: int = 0,
    timeout: float = 10.0,
    timestep: float = 0.001,
    on_stage: Callable[[str], None] = lambda stage: None,
) -> ReachOutcome:
    """Reach with a hand and look at a point, without collisions and within all limits.

    Targets -> whole-body IK -> collision-free path -> TOPP-RA within velocity, acceleration and torque limits
    -> executed by the twin -> numbers.

    Args:
        pepper: The robot.
        hand: "left" or "right".
        at: Target of the palm in the world [m], shape (3,).
        look_at: Target of the top camera's gaze [m], shape (3,); None leaves the gaze free.
        scene: The world around the robot.
        start: Start configuration [rad or m], shape (n,); None for `pepper.default_posture()`.
        seed: Seed of all random choices.
        timeout: Time budget of IK and planning [s].
        timestep: Timestep of the twin [s].
        on_stage: Function that is called with the name of each stage when it begins.

    Returns:
        The outcome; for a target out of reach, its message says how near the hand can get.

    Raises:
        PepperKinError: for invalid arguments, naming the fault.
    """
    scene = scene if scene is not None else Scene()
    target = read_only(as_finite(at, "at", (3,)))
    gaze = None if look_at is None else read_only(as_finite(look_at, "look_at", (3,)))
    q_start = pepper.default_posture() if start is None else np.asarray(start, dtype=float)
    tasks: list[Any] = [HandPosition(hand, target)]
    if gaze is not None:
        tasks.append(LookAt(gaze, camera=CAMERA))
    clock = _Clock(on_stage)
    clock.enter("inverse kinematics and path")
    with np.errstate(over="ignore"):
        found = plan(pepper, q_start, tasks, scene, seed=seed, timeout=timeout)

    def outcome(message: str, **more: Any) -> ReachOutcome:
        fields: dict[str, Any] = {"trajectory": None, "certificate": None, "run": None, "figures": {}}
        return ReachOutcome(hand, target, gaze, scene, found, message=message, **{**fields, **more})

    if not found.success or found.path is None:
        return outcome(_why_not(pepper, tasks[0], scene, found, seed))
    if len(found.path) < 2:
        return outcome("The hand is there already: nothing to move.")
    clock.enter("timing")
    try:
        trajectory = retime(pepper, found)
    except InfeasibleError as error:
        return outcome(str(error))
    clock.enter("certificate")
    certificate = trajectory.check(pepper, scene=scene)
    clock.enter("twin")
    run = Twin(pepper, timestep, scene=scene).execute(trajectory, hold_time=HOLD_TIME)
    clock.enter("report")
    figures = _figures(pepper, tasks, scene, found, trajectory, run)
    clock.enter("done")
    figures["stage_seconds"] = clock.seconds
    message = _sentence(hand, figures, certificate, run)
    return outcome(message, trajectory=trajectory, certificate=certificate, run=run, figures=figures)


def _why_not(pepper: PepperModel, task: HandPosition, scene: Scene, found: Plan, seed: int) -> str:
    """Return in one line why there is no path; for a hand out of reach, with the nearest point's distance."""
    if found.status is not PlanStatus.NO_IK or found.ik is None:
        return found.report()
    # Without the gaze, since the question is how near the hand alone can get.
    with np.errstate(over="ignore"):  # squares of distances to targets very far away
        alone = solve(pepper, [task], start=pepper.neutral(), scene=scene, seed=seed)
    palm = frame_pose(pepper, alone.q, task.frame)[:3, 3]
    wanted, point = (f"({', '.join(map(_coordinate, p))})" for p in (task.target, palm))
    if alone.success:
        return f"The hand reaches {wanted}, but not with the gaze as well: {_unmet(found.ik)}."
    gap = min(math.hypot(*(palm - task.target)), sys.float_info.max)  # squares of 1e300 m would be infinite
    cause = ", without a collision," if alone.status is IKStatus.CLOSEST_COLLISION else ""
    near = f"the closest point found{cause} is {point}, {_distance(gap)} away"
    return f"The hand cannot reach {wanted}: {near}."


def _coordinate(value: float) -> str:
    """Return a coordinate [m] as text to the millimeter, or with few digits if it is large."""
    return f"{value:.3f}" if abs(value) < _FAR else f"{value:.4g}"


def _distance(value: float) -> str:
    """Return a distance [m] as text in centimeters, or in meters with few digits if it is large."""
    return f"{value * 100:.1f} cm" if value < _FAR else f"{value:.4g} m"


def _unmet(result: IKResult) -> str:
    """Return the errors of the unmet tasks in words."""
    return "; ".join(error.shortfall for error in result.errors if not error.met)


def _sentence(hand: str, figures: dict[str, Any], certificate: Certificate, run: Run) -> str:
    """Return the result of a motion in one sentence."""
    palm = f"The {hand} hand ends {figures['hand_error_m'] * 1000:.1f} mm from its target"
    gaze = figures["gaze_error_rad"]
    look = "" if gaze is None else f", the gaze {np.degrees(gaze):.2f} degrees off"
    checked = "all limits are kept" if certificate.success else certificate.report()
    twin = "" if run.success else f"  The twin {run.status.value}: {run.message}."
    return f"{palm}{look}, after {figures['duration_s']:.2f} s; {checked}.{twin}"


class _Clock:
    """Stopwatch of the stages, which announces each."""

    def __init__(self, announce: Callable[[str], None]) -> None:
        self.announce, self.seconds = announce, dict[str, float]()
        self._stage: tuple[str, float] | None = None

    def enter(self, stage: str) -> None:
        """End the current stage and begin another."""
        now = time.perf_counter()
        if self._stage is not None:
            self.seconds[self._stage[0]] = now - self._stage[1]
        self._stage = (stage, now)
        if stage != "done":
            self.announce(stage)


def _figures(
    pepper: PepperModel, tasks: list[Any], scene: Scene, found: Plan, trajectory: Trajectory, run: Run
) -> dict[str, Any]:
    """Return the figures of the executed motion, computed independently of solver and planner."""
    q_end = run.position[-1]
    reached = tasks[0]
    palm_path = frame_pose(pepper, run.position[::10], reached.frame)[:, :3, 3]
    palm = frame_pose(pepper, q_end, reached.frame)[:3, 3]
    gaze_error = _gaze_error(frame_pose(pepper, q_end, CAMERA), tasks[1].target) if len(tasks) > 1 else None
    executed = clearance_along(pepper, run.position[::5], scene)
    return {
        "hand_error_m": float(np.linalg.norm(palm - reached.target)),
        "gaze_error_rad": gaze_error,
        "path_length_joint": found.length,
        "hand_path_length_m": float(np.sum(np.linalg.norm(np.diff(palm_path, axis=0), axis=1))),
        "duration_s": trajectory.duration,
        "clearance_planned_m": found.clearance.as_dict(),
        "clearance_executed_m": executed.as_dict(),
        "peak_torque_use": dict(zip(pepper.joint_names, run.torque_use.tolist(), strict=True)),
        "tracking_error_rms": dict(zip(pepper.joint_names, run.rms_error.tolist(), strict=True)),
        "tracking_error_max": float(run.max_error.max()),
    }


def _gaze_error(transform_camera_to_world: NDArray[np.float64], gaze: NDArray[np.float64]) -> float:
    """Return the angle [rad] between the x axis of a camera's pose, shape (4, 4), and a point, shape (3,)."""
    direction = gaze - transform_camera_to_world[:3, 3]
    axis = transform_camera_to_world[:3, 0]
    return float(np.arctan2(np.linalg.norm(np.cross(axis, direction)), axis @ direction))
