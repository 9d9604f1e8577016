"""Base class of the tasks of environments."""

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
"""Number of episodes that are drawn for a task, from which the environments choose."""
REACH = 0.3
"""Distance from a joint's position to the target of an action of 1 [rad or m]."""
STEPS = 20
"""Number of timesteps of the twin, 1 ms each, in a step of an environment: 50 Hz."""

_BALL, _ORANGE = Sphere(0.025), (0.93, 0.36, 0.20, 1.0)


@dataclass(frozen=True, eq=False)
class TaskState(BriefRepr):
    """State of N robots between two steps: all inputs of a task.

    Attributes:
        pepper: The robot.
        joints: Indices of the joints that actions move, shape (k,).
        speed: Ratio of the velocity limits that commands use.
        period: Time of a step [s].
        goal_seed: Seed of the episodes.
        threads: Number of threads that share the robots.
        position: Positions of all joints [rad or m], shape (N, n).
        velocity: Velocities of all joints [rad/s or m/s], shape (N, n).
        episode: Parameters of the episodes, shape (N, w).
        begun: Number of episodes that each robot has begun, shape (N,).
        elapsed: Number of steps since the last episode has begun, shape (N,).
        measured: Result of `RobotTask.measure`.
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
    """A task: its episodes, observations and scores.

    Attributes:
        name: Name of the task.
        threshold: Maximum distance at which a goal counts as met [m].
        horizon: Number of steps of an episode.
        duration: Number of last steps in which the goals must be met.
        view: Position and aim point of the camera of pictures, in the base's axes [m].
    """

    name: str
    threshold: float = 0.05
    horizon: int = 50
    duration: ClassVar[int] = 1
    view: ClassVar[tuple[tuple[float, ...], tuple[float, ...]]] = (EYE, AIM)

    def robot(self) -> PepperModel:
        """Return the default robot of the task."""
        return load_pepper()

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the indices of the joints that actions move, shape (k,)."""
        raise NotImplementedError

    def action_size(self, pepper: PepperModel) -> int:
        """Return the number of actions."""
        return self.joints(pepper).size

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return the parameters of episodes that can be solved, shape (m, w).

        Args:
            pepper: The robot.
            speed: Ratio of the velocity limits that commands use.
            period: Time of a step [s].
            seed: Seed of the episodes.

        Raises:
            InvalidValueError: if the episodes are too short for any goal.
        """
        raise NotImplementedError

    def twins(self, pepper: PepperModel, count: int, options: dict[str, Any]) -> TwinBatch:
        """Return a batch of N robots, which differ by the options; see `Randomization.drawn`."""
        return TwinBatch(pepper, count, **options)

    def twin(self, pepper: PepperModel) -> Twin:
        """Return one robot suitable for the task, for `run_policy`."""
        return Twin(pepper)

    def base(self, pepper: PepperModel, count: int) -> Any:
        """Return the simulation of the bases of N robots in addition to the twins, or None."""

    def measure(self, twins: TwinBatch, base: Any) -> Any:
        """Return the state of bodies other than the joints, for `TaskState.measured`."""

    def home(self, pepper: PepperModel) -> Array:
        """Return the start posture of episodes [rad or m], shape (n,)."""
        return pepper.neutral()

    def reset(self, state: TaskState, rows: np.ndarray, twins: TwinBatch, base: Any) -> None:
        """Set some robots, indices of shape (k,), to the start of the episodes in the state."""
        twins.reset(self.home(state.pepper), rows=rows)

    def simulate(self, state: TaskState, actions: Array, twins: TwinBatch, base: Any) -> np.ndarray:
        """Simulate a step with actions, shape (N, k); return which robots are sound, shape (N,)."""
        targets = state.position.copy()
        targets[:, state.joints] += REACH * actions
        return twins.step(targets, STEPS, speed=state.speed, threads=state.threads)

    def achieved_goal(self, state: TaskState) -> Array:
        """Return the achieved goals, such as hand positions [m], shape (N, g, 3)."""
        raise NotImplementedError

    def desired_goal(self, state: TaskState) -> Array:
        """Return the present desired goals [m], shape (N, g, 3)."""
        raise NotImplementedError

    def extra_observation(self, state: TaskState) -> Array:
        """Return the observations that the task adds, shape (N, e)."""
        return np.zeros((len(state.position), 0))

    def score(self, state: TaskState, achieved: Array, desired: Array) -> Score:
        """Return the scores of achieved goals for desired goals, shape (N, g, 3) each [m]."""
        distance, none = np.empty(len(achieved)), np.zeros(len(achieved))
        greatest_distances(*(np.ascontiguousarray(x, float) for x in (achieved, desired)), distance)
        return Score(distance, none, distance < self.threshold, none > 0)

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Return the joint targets of an oracle that knows the robot [rad or m], shape (N, n).

        Args:
            state: The robots.
            before: Result of the last call; at the first call the robots' positions [rad or m], shape (N, n).
            just_reset: Which episodes have begun since the last call, shape (N,).
        """
        raise NotImplementedError

    def expert_action(self, state: TaskState, targets: Array) -> Array:
        """Return the actions that lead to the oracle's targets, shape (N, k)."""
        return np.clip((targets - state.position)[:, state.joints] / REACH, -1.0, 1.0)

    def scene(self, state: TaskState, row: int) -> Scene:
        """Return the visible objects around one robot."""
        return Scene()


def by_kind(kinds: Array) -> list[tuple[int, np.ndarray]]:
    """Return each index of a scene in `kinds`, shape (N,), once, with the robots in the scene, shape (k,)."""
    return [(int(kind), np.flatnonzero(kinds == kind)) for kind in np.unique(kinds)]


def touching(pepper: PepperModel, q: Array, kinds: Array, scene_of: Callable[[int], Scene]) -> np.ndarray:
    """Return which robots at q, shape (N, n), touch themselves or their scenes, shape (N,)."""
    found = np.zeros(len(q), bool)
    for kind, rows in by_kind(kinds):
        found[rows] = collision.in_collision(pepper, q[rows], scene_of(kind))
    return found


def planned_path(
    pepper: PepperModel, ends: tuple[Array, Array], scene: Scene, times: np.ndarray,
    shares: tuple[float, float], **options: Any,
) -> Array | None:  # fmt: skip
    """Return joint positions at times of a planned motion, shape (T, n), that ends by 80 % of the time.

    Args:
        pepper: The robot.
        ends: Positions at the start and at the end [rad or m], shape (n,) each.
        scene: Obstacles that the motion avoids.
        times: Times [s], shape (T,).
        shares: Ratios of the limits of velocity and acceleration.
        **options: Options of `motion.plan`.

    Returns:
        The positions, or None if there is no plan, or none that is fast enough.
    """
    plan = motion.plan(pepper, *ends, scene, **options)
    if not plan.success:
        return None
    timed = trajectory.retime(pepper, plan, velocity_scale=shares[0], acceleration_scale=shares[1])
    return timed(np.minimum(times, timed.duration)).position if timed.duration <= 0.8 * times[-1] else None


def with_goals(scene: Scene, goals: Array) -> Scene:
    """Return a scene with small spheres at goals [m], shape (g, 3)."""
    for k, goal in enumerate(goals):
        scene = scene.add(f"goal {k + 1}", _BALL, goal, color=_ORANGE)
    return scene


def joint_indices(pepper: PepperModel, groups: list[str]) -> np.ndarray:
    """Return the indices of joints by their names and groups, shape (k,)."""
    return np.array([pepper.joint_index(name) for name in pepper.resolve_joints(groups)])


def duration_of(pepper: PepperModel, way: Array, joints: np.ndarray, speed: float) -> Array:
    """Return the times of shaped commands for joint displacements, shape (m, k) [rad or m]: (m,) [s]."""
    fastest, strongest = speed * pepper.velocity_limits[joints], pepper.acceleration_limits[joints]
    rows = np.abs(way).tolist()
    return np.array(
        [
            max(time_to_target(d, 0.0, v, a) for d, v, a in zip(row, fastest, strongest, strict=True))
            for row in rows
        ]
    )
