"""The task of an environment: the base class of all tasks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pepper_kin import collision, motion, trajectory
from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision import Scene
from pepper_kin.core.episodes import Score, greatest_distances
from pepper_kin.core.simulation.target_following import time_to_target
from pepper_kin.learning.picture import AIM, EYE
from pepper_kin.model import PepperModel, Sphere, load_pepper
from pepper_kin.twin import Twin, TwinBatch

BANK = 2048
"""Episodes that are drawn for a task, of which those of the environments are chosen."""
REACH = 0.3
"""From where a joint is to where an action of 1 sends it [rad or m]."""
STEPS = 20
"""Of the twin in a step of an environment, of a millisecond each: 50 Hz."""

_BALL, _ORANGE = Sphere(0.025), (0.93, 0.36, 0.20, 1.0)


@dataclass(frozen=True, eq=False)
class TaskState(BriefRepr):
    """N robots between two steps: all that a task knows of its environment.

    Attributes:
        pepper: The robot.
        joints: Indices of the joints that actions move, shape (k,).
        speed: Share of the velocity limits that commands use.
        period: Time of a step [s].
        goal_seed: Draws the episodes.
        threads: Threads that share the robots.
        position: Of all joints [rad or m], shape (N, n).
        velocity: Of all joints [rad/s or m/s], shape (N, n).
        episode: Distinguishing values of the episodes, shape (N, w).
        begun: Episodes that each robot has begun, shape (N,).
        elapsed: Steps since the last one has begun, shape (N,).
        measured: What `RobotTask.measure` returns.
    """

    pepper: PepperModel
    joints: np.ndarray
    speed: float
    period: float
    goal_seed: int
    threads: int
    position: Array
    velocity: Array
    episode: Array
    begun: np.ndarray
    elapsed: np.ndarray
    measured: Any

    @property
    def time(self) -> Array:
        """Time since the episodes have begun [s], shape (N,)."""
        return np.asarray(self.elapsed * self.period, dtype=np.float64)


@dataclass(frozen=True)
class RobotTask:
    """A task: which episodes there are, what is seen of them, and how states are scored.

    Attributes:
        name: Its name.
        threshold: Greatest distance of what has met its goal [m].
        horizon: Steps of an episode.
        duration: Steps at the end of which the goals are met.
        view: Where the camera of pictures is, and what it looks at, in the base's axes [m].
    """

    name: str
    threshold: float = 0.05
    horizon: int = 50
    duration: ClassVar[int] = 1
    view: ClassVar[tuple[tuple[float, ...], tuple[float, ...]]] = (EYE, AIM)

    def robot(self) -> PepperModel:
        """Return the robot that does it where none is given."""
        return load_pepper()

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the indices of the joints that actions move, shape (k,)."""
        raise NotImplementedError

    def action_size(self, pepper: PepperModel) -> int:
        """Return the number of actions."""
        return self.joints(pepper).size

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return the distinguishing values of episodes that can be solved, shape (m, w).

        Args:
            pepper: The robot.
            speed: Share of the velocity limits that commands use.
            period: Time of a step [s].
            seed: Draws them.

        Raises:
            InvalidValueError: where the episodes are too short for any.
        """
        raise NotImplementedError

    def twins(self, pepper: PepperModel, count: int, options: dict[str, Any]) -> TwinBatch:
        """Return N robots, which differ by the options; see `Randomization.drawn`."""
        return TwinBatch(pepper, count, **options)

    def twin(self, pepper: PepperModel) -> Twin:
        """Return one robot that the task can be done with, for `run_policy`."""
        return Twin(pepper)

    def base(self, pepper: PepperModel, count: int) -> Any:
        """Return what moves the bases of N robots beside the twins, or None."""

    def measure(self, twins: TwinBatch, base: Any) -> Any:
        """Return values of what moves besides the joints, for `TaskState.measured`."""

    def home(self, pepper: PepperModel) -> Array:
        """Return where the joints are when episodes begin [rad or m], shape (n,)."""
        return pepper.neutral()

    def reset(self, state: TaskState, rows: np.ndarray, twins: TwinBatch, base: Any) -> None:
        """Put some robots, shape (k,), to the beginning of the episodes in the state."""
        twins.reset(self.home(state.pepper), rows=rows)

    def simulate(self, state: TaskState, actions: Array, twins: TwinBatch, base: Any) -> np.ndarray:
        """Let the robots do actions, shape (N, k), for a step; return which are sound, shape (N,)."""
        targets = state.position.copy()
        targets[:, state.joints] += REACH * actions
        return twins.step(targets, STEPS, speed=state.speed, threads=state.threads)

    def achieved_goal(self, state: TaskState) -> Array:
        """Return where what is led is [m], shape (N, g, 3)."""
        raise NotImplementedError

    def desired_goal(self, state: TaskState) -> Array:
        """Return where it should be now [m], shape (N, g, 3)."""
        raise NotImplementedError

    def extra_observation(self, state: TaskState) -> Array:
        """Return what is observed besides, shape (N, e)."""
        return np.zeros((len(state.position), 0))

    def score(self, state: TaskState, achieved: Array, desired: Array) -> Score:
        """Return how the states meet their goals, shape (N, g, 3) each [m]."""
        distance, none = np.empty(len(achieved)), np.zeros(len(achieved))
        greatest_distances(*(np.ascontiguousarray(x, float) for x in (achieved, desired)), distance)
        return Score(distance, none, distance < self.threshold, none > 0)

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Return where an expert, who knows the robot, wants the joints [rad or m], shape (N, n).

        Args:
            state: The robots.
            before: What it has returned the last time; where the robots were, the first time.
            just_reset: Which episodes have begun since then, shape (N,).
        """
        raise NotImplementedError

    def expert_action(self, state: TaskState, targets: Array) -> Array:
        """Return the actions that lead to the expert's targets, shape (N, k)."""
        return np.clip((targets - state.position)[:, state.joints] / REACH, -1.0, 1.0)

    def scene(self, state: TaskState, row: int) -> Scene:
        """Return what is to be seen around one robot."""
        return Scene()


def by_kind(kinds: Array) -> list[tuple[int, np.ndarray]]:
    """Return the numbers of the scenes of N robots, shape (N,), each once, and the robots in it, (k,)."""
    return [(int(kind), np.flatnonzero(kinds == kind)) for kind in np.unique(kinds)]


def touching(pepper: PepperModel, q: Array, kinds: Array, scene_of: Callable[[int], Scene]) -> np.ndarray:
    """Return which robots at q, shape (N, n), touch themselves or the scenes that they are in, shape (N,)."""
    found = np.zeros(len(q), bool)
    for kind, rows in by_kind(kinds):
        found[rows] = collision.in_collision(pepper, q[rows], scene_of(kind))
    return found


def planned_path(
    pepper: PepperModel, ends: tuple[Array, Array], scene: Scene, times: np.ndarray,
    shares: tuple[float, float], **options: Any,
) -> Array | None:  # fmt: skip
    """Return joint positions at times of a planned motion, shape (T, n), which has ended at eight tenths.

    Args:
        pepper: The robot.
        ends: Positions at the start and at the end [rad or m], shape (n,) each.
        scene: What it keeps clear of.
        times: [s], shape (T,).
        shares: Of the limits of velocity and acceleration.
        **options: Of `motion.plan`.

    Returns:
        None where there is no plan, or none that is as fast.
    """
    plan = motion.plan(pepper, *ends, scene, **options)
    if not plan.success:
        return None
    timed = trajectory.retime(pepper, plan, velocity_scale=shares[0], acceleration_scale=shares[1])
    return timed(np.minimum(times, timed.duration)).position if timed.duration <= 0.8 * times[-1] else None


def with_goals(scene: Scene, goals: Array) -> Scene:
    """Return a scene with small balls at goals [m], shape (g, 3)."""
    for k, goal in enumerate(goals):
        scene = scene.add(f"goal {k + 1}", _BALL, goal, color=_ORANGE)
    return scene


def joint_indices(pepper: PepperModel, groups: list[str]) -> np.ndarray:
    """Return the indices of joints by their names and groups, shape (k,)."""
    return np.array([pepper.joint_index(name) for name in pepper.resolve_joints(groups)])


def duration_of(pepper: PepperModel, way: Array, joints: np.ndarray, speed: float) -> Array:
    """Return how long shaped commands take for a way of the joints [s], shape (m,) for (m, k) [rad or m]."""
    fastest, strongest = speed * pepper.velocity_limits[joints], pepper.acceleration_limits[joints]
    rows = np.abs(way).tolist()
    return np.array(
        [
            max(time_to_target(d, 0.0, v, a) for d, v, a in zip(row, fastest, strongest, strict=True))
            for row in rows
        ]
    )
