"""Episodes of a policy on other robots: a twin with a world and latency, or a robot behind ALMotion."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision import Scene
from pepper_kin.core.simulation.target_following import time_to_target
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.learning.vector_env import PepperVectorEnv
from pepper_kin.model import PepperModel
from pepper_kin.trajectory import Samples, Trajectory
from pepper_kin.twin import RunStatus, Twin
from pepper_kin.twin.batch_world import BatchBodies
from pepper_kin.twin.world import World

PERIOD = 0.02  # period of a step [s]
_CALLS = ("setAngles", "getAngles", "angleInterpolationWithSpeed", "killTasksUsingResources")
_HOME_SPEED = 0.3  # ratio of the maximum speed on the way to the start of an episode


@dataclass(frozen=True, eq=False)
class Episode(BriefRepr):
    """Motion and result of a robot under a policy.

    Attributes:
        success: Whether it ended in success.
        distances: Maximum distance of a hand from its goal after each step [m], shape (T,).
        motion: Measured motion of all joints: at all timesteps for a twin, else every 20 ms.
        scene: Visible objects around the robot at the start, such as the goals.
    """

    success: bool
    distances: Array
    motion: Trajectory
    scene: Scene

    def explanation(self, pepper: PepperModel, scene: Scene | None = None) -> str:
        """Return a text of the result, and of the faults in the certificate of the motion.

        Args:
            pepper: The robot.
            scene: The world around the robot; empty if omitted.
        """
        found = self.motion.check(pepper, scene=scene)
        end = "in success" if self.success else "in failure"
        lines = [f"The episode ended {end}, {100 * self.distances[-1]:.1f} cm from the goal."]
        wrong = [found.checks[name].sentence() for name in found.failures]
        return "\n".join([*lines, *(f"  {line}" for line in wrong)])


def run_policy(
    policy: Callable[[Any], ArrayLike],
    env: PepperVectorEnv,
    robot: Any,
    *,
    seed: int = 0,
    wait: Callable[[float], object] = time.sleep,
) -> Episode:
    """Run an episode of a policy on a robot.

    A twin gets its targets like the batch, see `TwinBatch.step`, and may have a world, latency, pushes
    and sensors.  Any object with ALMotion's `setAngles`, `getAngles`, `angleInterpolationWithSpeed` and
    `killTasksUsingResources` counts as an ALMotion: the robot must be awake, moves to the start of an
    episode, and gets targets every 20 ms, which no certificate covers; velocities are differences of measured
    angles.  At the end, and after every error and Ctrl-C, the robot is commanded to hold its measured angles.

    Args:
        policy: Function of observations, shape (1, obs), that returns actions, shape (1, k), such as a
            `Policy`.
        env: One environment, which supplies goal, observations and score, not with `SAME_STEP`; it needs a
            `reset` afterwards.
        robot: A `Twin` of `env.pepper`, or an ALMotion.
        seed: Seed of the goal, as in `reset(seed=[seed])` of the batch.
        wait: Function that waits for a time [s], for an ALMotion; for a `Broker` not in real time,
            `broker.body.time.sleep`.

    Raises:
        InvalidValueError: for several environments or `SAME_STEP`, a twin of other joints or whose timesteps
            do not add up to 20 ms, or a robot of another kind.
    """
    if env.num_envs != 1 or env.autoreset_mode is AutoresetMode.SAME_STEP:
        what = f"{env.num_envs} environments, {env.autoreset_mode.value}"
        raise InvalidValueError("env", what, "one environment, with NextStep or Disabled")
    body: _TwinBody | _MotionBody
    if isinstance(robot, Twin):
        body = _TwinBody(robot, env.pepper)
    elif all(hasattr(robot, name) for name in _CALLS):
        body = _MotionBody(robot, env, wait)
    else:
        raise InvalidValueError("robot", type(robot).__name__, "a Twin, or an ALMotion")
    own, distances, ended = env.twins, [], False
    env.twins = body  # type: ignore[assignment]
    try:
        observations, _ = env.reset(seed=[seed])
        scene = env.task.scene(env.state, 0)
        while not ended:
            observations, _, terminated, truncated, infos = env.step(policy(observations))
            distances.append(float(infos["distance"][0]))
            ended = bool((terminated | truncated)[0])
    finally:
        env.twins, env._ready = own, False
        body.hold()
    return Episode(bool(infos["is_success"][0]), np.array(distances), body.motion(), scene)


def _motion(pepper: PepperModel, period: float, position: Array, velocity: Array) -> Trajectory:
    """Return the motion through states, shape (T, n), one per period [s]."""
    time = period * np.arange(len(position), dtype=np.float64)
    acceleration = np.asarray(np.gradient(velocity, period, axis=0))
    names, units = pepper.joint_names, pepper.joint_units
    return Samples(names, time, position, velocity, acceleration, units).to_trajectory()


class _TwinBody:
    """A twin with the interface of a batch of one.

    Args:
        twin: The twin.
        pepper: The robot of the environment.
    """

    def __init__(self, twin: Twin, pepper: PepperModel) -> None:
        if twin.pepper.joint_names != pepper.joint_names:
            raise InvalidValueError("joints of the twin", twin.pepper.joint_names, "those of env.pepper")
        self._count = round(PERIOD / twin.timestep)
        if abs(self._count * twin.timestep - PERIOD) > 1e-9:
            raise InvalidValueError("timestep of the twin", twin.timestep, f"a part of {PERIOD} s")
        self._twin, self._command, self._speed = twin, np.zeros(pepper.n), np.zeros(pepper.n)
        self._states: list[Array] = []

    @property
    def position(self) -> Array:
        """Joint positions [rad or m], shape (1, n)."""
        return np.array(self._twin.state.position)[np.newaxis]

    @property
    def velocity(self) -> Array:
        """Joint velocities [rad/s or m/s], shape (1, n)."""
        return np.array(self._twin.state.velocity)[np.newaxis]

    def reset(self, q: Array | None = None, **_: Any) -> None:
        """Reset the twin, to q if given, (n,) or (1, n), and the bodies of its world."""
        if self._twin.world is not None and hasattr(self._twin.world, "reset"):
            self._twin.world.reset()
        self._twin.reset(None if q is None else np.reshape(q, -1))
        self._command, self._speed = self.position[0], np.zeros_like(self._speed)
        self._states = [np.stack([self.position, self.velocity])]

    def place(self, name: str, position: Array, *, rows: Array) -> None:
        """Set the position of a body of the twin's world [m], shape (1, 3)."""
        del rows
        self._world().place(name, position[0])

    def body(self, name: str) -> BatchBodies:
        """Return the state of a body of the twin's world."""
        found = self._world().bodies.get(name)
        if found is None:
            raise UnknownNameError("body of the twin's world", name, self._world().bodies)
        return BatchBodies(
            *(np.array(x)[np.newaxis] for x in (found.position, found.pose[:3, :3], found.velocity))
        )

    def _world(self) -> World:
        if not isinstance(self._twin.world, World):
            raise InvalidValueError("world of the twin", type(self._twin.world).__name__, "that of the task")
        return self._twin.world

    def step(
        self, targets: Array, steps: int, *, speed: float = 1.0, commands: str = "shaped", **options: Any
    ) -> np.ndarray:
        """Move towards targets [rad or m], shape (1, n), see `TwinBatch.step`; return whether it is sound."""
        pepper, load = self._twin.pepper, options.get("load")
        way = np.clip(targets[0], pepper.lower_limits, pepper.upper_limits) - self._command
        limits = speed * pepper.velocity_limits, pepper.acceleration_limits
        rows = zip(way.tolist(), self._speed.tolist(), *(x.tolist() for x in limits), strict=True)
        h = self._twin.timestep
        duration = np.maximum([time_to_target(*row) for row in rows], h)
        coast = self._speed * duration
        square, cube = (3.0 * way - 2.0 * coast) / duration**2, (coast - 2.0 * way) / duration**3
        if commands == "linear":
            duration, self._speed = np.full_like(way, PERIOD), way / PERIOD
            square = cube = np.zeros_like(way)
        t = np.minimum(h * np.arange(1, self._count + 1)[:, np.newaxis], duration)
        position = self._command + t * (self._speed + t * (square + t * cube))
        velocity = self._speed + t * (2.0 * square + 3.0 * t * cube)
        self._command, self._speed = position[-1], velocity[-1]
        outer = None if load is None else np.repeat(load, len(position), axis=0)
        run = self._twin.follow(position, velocity, load=outer)
        self._states.append(np.stack([run.position, run.velocity])[:, 1:])
        return np.array([run.status is not RunStatus.STOPPED])

    def hold(self) -> None:
        """Do nothing: a twin does not move between calls."""

    def motion(self) -> Trajectory:
        """Return the motion since the reset."""
        return _motion(self._twin.pepper, self._twin.timestep, *np.concatenate(self._states, axis=1))


class _MotionBody:
    """A robot behind ALMotion with the interface of a batch of one.

    Args:
        motion: ALMotion.
        env: The environment.
        wait: Function that waits for a time [s].
    """

    def __init__(self, motion: Any, env: PepperVectorEnv, wait: Callable[[float], object]) -> None:
        self._motion, self._wait, self._pepper = motion, wait, env.pepper
        self._names = list(env.pepper.joint_names)
        self._acting = np.asarray(env.joints).tolist()
        self._states: list[Array] = []
        self._last = self.velocity = np.zeros((1, env.pepper.n))

    @property
    def position(self) -> Array:
        """Joint positions measured in the last step [rad], shape (1, n)."""
        return self._last.copy()

    def reset(self, q: Array | None = None, **_: Any) -> None:
        """Move to the start of an episode, the neutral posture or q [rad], shape (n,) or (1, n)."""
        home = self._pepper.neutral() if q is None else np.reshape(q, -1)
        self._motion.angleInterpolationWithSpeed(self._names, home.tolist(), _HOME_SPEED)
        self._wait(1.0)  # until the joints, which lag, are at rest
        self._last = np.array([self._motion.getAngles(self._names, True)])
        self.velocity = np.zeros_like(self._last)
        self._states = [np.stack([self._last, self.velocity])]

    def step(self, targets: Array, steps: int, *, speed: float = 1.0, **options: Any) -> np.ndarray:
        """Command the acting joints to targets [rad], shape (1, n), and wait for 20 ms."""
        if options.get("load") is not None or options.get("commands", "shaped") != "shaped":
            raise InvalidValueError(
                "task", "one that pushes or drives", "one of arms and head, for an ALMotion"
            )
        names = [self._names[j] for j in self._acting]
        self._motion.setAngles(names, targets[0, self._acting].tolist(), speed)
        self._wait(PERIOD)
        before, self._last = self._last, np.array([self._motion.getAngles(self._names, True)])
        self.velocity = (self._last - before) / PERIOD
        self._states.append(np.stack([self._last, self.velocity]))
        return np.array([True])

    def hold(self) -> None:
        """End all tasks that move the joints, and command the measured angles."""
        self._motion.killTasksUsingResources(self._names)
        angles = self._motion.getAngles(self._names, True)
        self._motion.setAngles(self._names, angles, _HOME_SPEED)

    def motion(self) -> Trajectory:
        """Return the motion since the reset."""
        return _motion(self._pepper, PERIOD, *np.concatenate(self._states, axis=1))
