"""Planning from the page: planning to the targets, timing and display of the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import PointCloud, Scene
from pepper_kin.ik import LookAt
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kinematics import frame_pose, frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.motion import Plan, plan
from pepper_kin.motion.plan_request import PlanOptions
from pepper_kin.motion.smoothed_plan import smoothed
from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.joint_motion import JointMotion, Playable, joint_motion
from pepper_kin.viewer.server.explaining import no_closer
from pepper_kin.viewer.server.readings import Curves, curves_of

TIMEOUT, MARGIN = 5.0, 0.01
GHOSTS = 3
"""Number of robots drawn along a motion, the last at its end."""

_GHOST_COLOR: Color = (0.93, 0.36, 0.20, 0.13)
_TRACE_COLOR: Color = (0.93, 0.36, 0.20, 1.0)
_TRACE_POINTS, _TRACE_RADIUS = 60, 0.006
_WAY_POINTS = 60
_MOVED = 0.01  # [m]; a link that moves less is not drawn in ghosts


@dataclass(frozen=True)
class Shown:
    """A motion with the data that a page shows.

    Attributes:
        title: Title of the motion.
        motion: Joint positions over time.
        curves: Curves of the motion's plots.
        ghost: Traces and some robots along the motion, fixed to the world.
        way: Two opposite corners of the box around the whole motion, shape (2, 3) [m].
    """

    title: str
    motion: JointMotion
    curves: Curves
    ghost: tuple[Drawable, ...]
    way: Array


@dataclass(frozen=True)
class Planned:
    """Outcome of planning.

    Attributes:
        report: Text of the message line.
        shown: The motion, or None if none was found.
    """

    report: str
    shown: Shown | None


def compile_planning(pepper: PepperModel) -> None:
    """Load the machine code of planning to targets, or compile it on a machine's first use."""
    plan_motion(pepper, pepper.neutral(), [LookAt((1.0, 0.3, 1.0))], Scene())


def plan_motion(pepper: PepperModel, q: Array, tasks: list[Task], scene: Scene, seed: int = 0) -> Planned:
    """Plan a timed motion from joint positions q, shape (n,), to targets.

    Args:
        pepper: Model of the robot.
        q: Joint positions at the start [rad or m], shape (n,).
        tasks: Tasks of the targets.
        scene: Scene around the robot.
        seed: Seed of all random choices.

    Returns:
        The motion, or the reason why there is none.
    """
    found = plan(pepper, q, tasks, scene, seed=seed, timeout=TIMEOUT)
    if found.path is None:
        return Planned(_why_no_plan(pepper, q, tasks, scene, found), None)
    if len(found.path) < 2:
        return Planned("The body is at its targets already: nothing to plan.", None)
    found = smoothed(pepper, found, scene, PlanOptions(margin=MARGIN, timeout=TIMEOUT))
    trajectory = found.trajectory
    if trajectory is None:
        return Planned(f"{found.message} {found.advice}", None)
    report = (
        f"A motion of {trajectory.duration:.2f} s is ready, within every limit; clearance: "
        f"{found.clearance.sentence()}. Press play."
    )
    frames = [task.frame for task in tasks if task.unit == "m" and task.frame is not None]
    return Planned(report, show_motion(pepper, trajectory, scene, "Planned motion", frames))


def _why_no_plan(pepper: PepperModel, q: Array, tasks: list[Task], scene: Scene, found: Plan) -> str:
    """Explain in a sentence or two why there is no plan from joint positions q, shape (n,) [rad or m]."""
    if found.ik is not None and not found.ik.success:
        return no_closer(pepper, q, tasks, scene, found.ik)
    return f"No way there was found. {found.report()}"


def show_motion(
    pepper: PepperModel, source: Playable, scene: Scene, title: str, frames: list[str] | None = None
) -> Shown:
    """Compute the displayed data of a motion; traces of `frames` are drawn, none for None."""
    motion = joint_motion(pepper, source)
    return Shown(
        title,
        motion,
        curves_of(pepper, source, motion, scene),
        _ghost(pepper, motion.positions, frames),
        _way(pepper, motion.positions),
    )


def _way(pepper: PepperModel, positions: Array) -> Array:
    """Return the box, shape (2, 3) [m], around the origins of all links at joint positions, shape (T, n)."""
    kept = np.unique(np.linspace(0, len(positions) - 1, _WAY_POINTS).round().astype(int))
    places = frame_poses(pepper, positions[kept], pepper.frame_names)[..., :3, 3].reshape(-1, 3)
    return np.stack([places.min(axis=0), places.max(axis=0)])


def _ghost(pepper: PepperModel, positions: Array, frames: list[str] | None) -> tuple[Drawable, ...]:
    """Return traces of frames, and robots along joint positions [rad or m], shape (T, n)."""
    if frames is None or len(positions) < 2:
        return ()
    kept = np.linspace(0, len(positions) - 1, _TRACE_POINTS).round().astype(int)
    trace = [
        Drawable(
            f"trace of {frame}", None,
            PointCloud(frame_pose(pepper, positions[kept], frame)[:, :3, 3], _TRACE_RADIUS),
            np.eye(4), _TRACE_COLOR,
        )
        for frame in frames
    ]  # fmt: skip
    shapes = pepper.collision_shapes
    links = tuple(dict.fromkeys(shape.link for shape in shapes))
    stops = np.linspace(0, len(positions) - 1, GHOSTS + 1).round().astype(int)
    poses = frame_poses(pepper, positions[stops], links)
    moved = np.linalg.norm(poses[:, :, :3, 3] - poses[0, :, :3, 3], axis=-1).max(axis=0) > _MOVED
    bodies = [
        Drawable(
            f"{shape.name} {stop}", None, shape.geometry,
            poses[stop, links.index(shape.link)] @ shape.transform_shape_to_link, _GHOST_COLOR,
        )
        for stop in range(1, GHOSTS + 1)
        for shape in shapes
        if moved[links.index(shape.link)]
    ]  # fmt: skip
    return (*trace, *bodies)
