"""Many environments of one task, in one batch of twins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.picture import Pictures
from pepper_kin.learning.reach_task import ReachTask, Score, goals_of, task_named
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.joint_vectors import check_choice, check_positive, check_seed, check_whole
from pepper_kin.twin import TwinBatch, actuator_parameters

STEPS = 20  # of the twin, of a millisecond each: 50 Hz
REACH = 0.3  # [rad or m] from where a joint is to where an action of 1 sends it
_GAZE = 0.2  # [m/rad] of the reward, of the angle of the gaze


class PepperVectorEnv(gymnasium.vector.VectorEnv):
    """N Peppers, each with a goal; an action is where the joints should go from where they are measured.

    The targets are shaped as the robot shapes those of `setAngles`, see `TwinBatch.step`, at 50 Hz.  Nothing
    is hidden: the next state follows from what is observed, but for the commands' lag of some hundredths of
    a radian.  There are no contacts.

    Observation, shape (2 k + 6 hands,), float32: positions of the k acting joints, -1 to 1 for their limits;
    velocities over their limits; the hands in the world [m]; from there to the goals [m].  With `goal_form`
    a dictionary of `observation` (the first two and the hands), `achieved_goal` and `desired_goal`.

    Reward: minus the greatest distance of a hand from its goal [m], and 0.2 times the angle of the gaze
    [rad]; or with `sparse` 0 where both are within the task's thresholds, else -1.  Episodes are truncated
    after the task's horizon; `is_success` and `distance` are in the infos.

    Args:
        num_envs: N.
        task: A name of `TASKS`, or a task.
        pepper: The robot; the default Pepper if omitted.
        speed: Share of the velocity limits that commands use, in (0, 1].
        sparse: See above.
        goal_form: See above.
        autoreset_mode: What happens at the end of an episode, as Gymnasium defines it.
        randomization: Quantity of `ActuatorParameters` -> range of the factor on it, drawn for each robot and
            joint once, with `randomization_seed`.
        goal_seed: Draws the two thousand goals at most that episodes choose from.
        threads: Threads that share the robots; the result does not depend on it.
        render_mode: "rgb_array" for pictures by `render`.

    Raises:
        InvalidValueError: for options out of range.
        UnknownNameError: for an unknown task, or a robot without its joints.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"], "render_fps": 50, "autoreset_mode": AutoresetMode.NEXT_STEP,
    }  # fmt: skip

    def __init__(
        self,
        num_envs: int = 1,
        task: str | ReachTask = "Reach",
        *,
        pepper: PepperModel | None = None,
        speed: float = 0.5,
        sparse: bool = False,
        goal_form: bool = False,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        randomization: Mapping[str, tuple[float, float]] | None = None,
        randomization_seed: int = 0,
        goal_seed: int = 0,
        threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs, self.task = check_whole("num_envs", num_envs, 1), task_named(task)
        self.pepper = load_pepper() if pepper is None else pepper
        self.joints = self.task.joints(self.pepper)
        self.speed, self.sparse, self.goal_form = speed, sparse, goal_form
        self.threads = check_whole("threads", threads, 1)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        if render_mode is not None:
            check_choice("render_mode", render_mode, ("rgb_array",))
        self.render_mode, self._pictures = render_mode, None if render_mode is None else Pictures(self.pepper)
        self.twins = TwinBatch(
            self.pepper, self.num_envs, vary=self._varied(randomization or {}, randomization_seed)
        )
        period, drawn = STEPS * self.twins.timestep, check_seed(goal_seed)
        self._goals = goals_of(self.pepper, self.task, speed, period, drawn)
        self._low, self._high = self.pepper.lower_limits[self.joints], self.pepper.upper_limits[self.joints]
        self._keys = np.zeros(self.num_envs, np.uint64)
        self._episodes, self._elapsed = np.zeros(self.num_envs, np.uint64), np.zeros(self.num_envs, np.int64)
        self.goals = np.zeros((self.num_envs, len(self.task.hands), 3))
        self._ended = np.zeros(self.num_envs, bool)
        self._ready = False
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (self.joints.size,), np.float32)
        self.single_observation_space = self._observation_space()
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes; see `gymnasium.vector.VectorEnv.reset`.

        Args:
            seed: Of all robots, or one for each; the same seeds give the same goals, whatever the number of
                robots and threads.
            options: `reset_mask`, shape (N,): which robots begin anew; all without.

        Raises:
            InvalidValueError: for a mask or seeds of another shape.
        """
        single = seed if isinstance(seed, int) else None
        super().reset(seed=single)
        if seed is not None and not isinstance(seed, int | np.integer):
            if len(seed) != self.num_envs:
                raise InvalidValueError(
                    "seed", f"{len(seed)} numbers", f"{self.num_envs}, one for each robot"
                )
            rows = np.array([s is not None for s in seed])
            self._keys[rows] = _mixed(np.array([s for s in seed if s is not None], np.uint64))
            self._episodes[rows] = 0
        elif seed is not None or not self._ready:
            base = int(self.np_random.integers(1 << 62)) if seed is None else int(seed)
            self._keys = _mixed(
                _mixed(np.array([base], np.uint64)) + np.arange(self.num_envs, dtype=np.uint64)
            )
            self._episodes[:] = 0
        mask = np.ones(self.num_envs, bool) if not options else np.asarray(options.get("reset_mask", True))
        if mask.dtype != bool or mask.shape not in ((), (self.num_envs,)):
            raise InvalidValueError(
                "reset_mask", f"shape {mask.shape}", f"booleans of shape ({self.num_envs},)"
            )
        self._begin(np.broadcast_to(mask, (self.num_envs,)) | (not self._ready))
        self._ready = True
        return self._observations(self._places()), {}

    def step(self, actions: Any) -> tuple[Any, Array, np.ndarray, np.ndarray, dict[str, Any]]:
        """Send the joints to new targets for 20 ms; see `gymnasium.vector.VectorEnv.step`.

        Raises:
            InvalidValueError: for NaN, another shape, or before `reset`.
        """
        if not self._ready:
            raise InvalidValueError("step", "before reset", "reset() first")
        moves = np.asarray(actions, float)
        if moves.shape != self.action_space.shape:
            raise InvalidValueError("actions", f"shape {moves.shape}", f"shape {self.action_space.shape}")
        if not np.isfinite(moves).all():
            row = int(np.argmax(~np.isfinite(moves).all(axis=1)))
            raise InvalidValueError(f"action of environment {row}", moves[row], "finite numbers from -1 to 1")
        anew = self._ended & (self.autoreset_mode is AutoresetMode.NEXT_STEP)
        targets = self.twins.position
        targets[:, self.joints] += REACH * np.clip(moves, -1.0, 1.0)
        sound = self.twins.step(targets, STEPS, speed=self.speed, threads=self.threads)
        if anew.any():
            self._begin(anew)
        self._elapsed[~anew] += 1
        places = self._places()
        score = self.task.score(self.pepper, self.twins.position, places, self.goals)
        rewards = np.where(anew, 0.0, self._rewards(score))
        terminated = np.zeros(self.num_envs, bool)
        truncated = ((self._elapsed >= self.task.horizon) | ~sound) & ~anew
        infos: dict[str, Any] = {"is_success": score.success, "distance": score.distance, "diverged": ~sound}
        self._ended = truncated.copy()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and truncated.any():
            infos |= {
                "final_obs": self._observations(places), "_final_obs": truncated,
                "final_info": dict(infos), "_final_info": truncated,
            }  # fmt: skip
            self._begin(truncated)
            places = self._places()
            self._ended[:] = False
        return self._observations(places), rewards, terminated, truncated, infos

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each robot with its goals, shape (320, 320, 3), or None without `render_mode`.

        The first 16 are drawn; one gray picture stands for each of the others.
        """
        if self._pictures is None:
            return None
        return self._pictures.pictures(self.twins.position, self.task.shown, self.goals)

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Array:
        """Return the rewards of goals achieved beside goals desired [m], shapes (N, 3 hands) or (3 hands,).

        The angle of the gaze is not among the goals, and counts as 0.
        """
        del info
        gaps = np.asarray(desired_goal, float) - np.asarray(achieved_goal, float)
        distance = np.linalg.norm(gaps.reshape(*gaps.shape[:-1], -1, 3), axis=-1).max(axis=-1)
        return np.where(distance < self.task.threshold, 0.0, -1.0) if self.sparse else -distance

    def _rewards(self, score: Score) -> Array:
        if self.sparse:
            return np.where(score.success, 0.0, -1.0)
        return -score.distance - _GAZE * score.angle

    def _begin(self, mask: np.ndarray) -> None:
        """Begin new episodes of some robots, shape (N,)."""
        rows = np.flatnonzero(mask)
        if not rows.size:
            return
        self.twins.reset(rows=rows)
        chosen = _mixed(self._keys[rows] + self._episodes[rows]) % np.uint64(len(self._goals))
        self.goals[rows] = self._goals[chosen.astype(np.int64)]
        self._episodes[rows] += np.uint64(1)
        self._elapsed[rows], self._ended[rows] = 0, False

    def _places(self) -> Array:
        return self.task.places(self.pepper, self.twins.position)

    def _observations(self, places: Array) -> Any:
        """Return new arrays of what is observed, with the hands at places [m], shape (N, hands, 3)."""
        q, v = self.twins.position[:, self.joints], self.twins.velocity[:, self.joints]
        center, half = (self._low + self._high) / 2, (self._high - self._low) / 2
        own = [(q - center) / half, v / self.pepper.velocity_limits[self.joints], _flat(places)]
        if self.goal_form:
            parts = {
                "observation": np.concatenate(own, axis=1),
                "achieved_goal": own[2],
                "desired_goal": _flat(self.goals),
            }
            return {name: part.astype(np.float32) for name, part in parts.items()}
        return np.concatenate([*own, _flat(self.goals - places)], axis=1).astype(np.float32)

    def _observation_space(self) -> gymnasium.Space[Any]:
        size, goal = 2 * self.joints.size + 3 * len(self.task.hands), 3 * len(self.task.hands)

        def box(length: int) -> gymnasium.spaces.Box:
            return gymnasium.spaces.Box(-np.inf, np.inf, (length,), np.float32)

        if not self.goal_form:
            return box(size + goal)
        parts: dict[str, gymnasium.Space[Any]] = {"observation": box(size)}
        parts |= {"achieved_goal": box(goal), "desired_goal": box(goal)}
        return gymnasium.spaces.Dict(parts)

    def _varied(self, ranges: Mapping[str, tuple[float, float]], seed: int) -> dict[str, Array]:
        """Return the actuators' quantities of each robot, shape (N, n), drawn from ranges of factors."""
        usual, drawn = actuator_parameters(self.pepper), np.random.default_rng(seed)
        found = {}
        for quantity, (low, high) in ranges.items():
            check_positive(f"{quantity}, low", low)
            if not low <= high:
                raise InvalidValueError(
                    f"randomization of {quantity}", (low, high), "low, and a number above"
                )
            factors = drawn.uniform(low, high, (self.num_envs, self.pepper.n))
            found[quantity] = np.asarray(getattr(usual, quantity)) * factors
        return found


def _flat(places: Array) -> Array:
    return places.reshape(len(places), -1)


def _mixed(keys: np.ndarray) -> np.ndarray:
    """Return well mixed numbers of 64 bits (splitmix64: G. Steele and others, OOPSLA 2014), shape (k,)."""
    with np.errstate(over="ignore"):
        z = keys + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))
