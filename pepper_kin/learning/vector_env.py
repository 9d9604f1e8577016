"""Vector environment: many environments of one task in one batch of twins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.episodes import Score, Seen, StepOutcome, StepRules, begin_episodes, end_step, observe
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.picture import MOST_DRAWN, EpisodeCamera
from pepper_kin.learning.randomization import Randomization
from pepper_kin.learning.task import STEPS, RobotTask, TaskState
from pepper_kin.learning.tasks import task_named
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import check_choice, check_seed, check_whole
from pepper_kin.planners.compiled import stream_key

_LOST = 1.0  # cost of each remaining step of a failed episode [m]


class PepperVectorEnv(gymnasium.vector.VectorEnv):
    """N Peppers, each with a goal; an action is a displacement of the joints from their measured positions.

    The robot shapes the targets like those of `setAngles`, see `TwinBatch.step`, at 50 Hz.  The state is
    fully observed: the next state follows from the observation, except for the commands' lag of some
    hundredths of a radian.  A task documents its deviations.

    Observation, shape (2 k + 6 g + e,), float32: positions of the k acting joints, -1 to 1 for their limits;
    velocities over their limits; the g achieved goals in the world [m]; vectors from there to the desired
    goals [m]; and observations of the task.  With `goal_form` a dictionary of `observation` (without the
    vectors to the goals), `achieved_goal` and `desired_goal`.

    Reward: minus the maximum distance from a goal [m], and the task's further cost; or with `sparse` 0 if the
    goals are met, else -1.  Episodes are truncated after the task's horizon; a failed episode terminates, and
    1 is subtracted for each remaining step.  `is_success` and `distance` are in the infos.

    Args:
        num_envs: Number N of environments.
        task: A name of `TASKS`, or a task.
        pepper: The robot; the default Pepper if omitted.
        speed: Ratio of the velocity limits that commands use, in (0, 1].
        sparse: Whether the reward is 0 or -1, see above.
        goal_form: Whether an observation is a dictionary with goals, see above.
        autoreset_mode: Behavior at the end of an episode, as Gymnasium defines it.
        randomization: Differences of the robots, a `Randomization` or its ranges; none if omitted.  Drawn
            once, with `randomization_seed`.
        randomization_seed: Seed of the randomization.
        goal_seed: Seed of the goals, two thousand at most, from which episodes choose.
        threads: Number of threads that share the robots; the result does not depend on it.
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
        task: str | RobotTask = "Reach",
        *,
        pepper: PepperModel | None = None,
        speed: float = 0.5,
        sparse: bool = False,
        goal_form: bool = False,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        randomization: Randomization | Mapping[str, Any] | None = None,
        randomization_seed: int = 0,
        goal_seed: int = 0,
        threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs, self.task = check_whole("num_envs", num_envs, 1), task_named(task)
        self.pepper = self.task.robot() if pepper is None else pepper
        self.joints = self.task.joints(self.pepper)
        self.speed, self.sparse, self.goal_form = speed, sparse, goal_form
        self.threads = check_whole("threads", threads, 1)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        if render_mode is not None:
            check_choice("render_mode", render_mode, ("rgb_array",))
        self.render_mode = render_mode
        self._camera = None if render_mode is None else EpisodeCamera(self.pepper, *self.task.view)
        given = {} if randomization is None else randomization
        differing = given if isinstance(given, Randomization) else Randomization(given)
        options = differing.drawn(self.pepper, self.num_envs, check_seed(randomization_seed))
        self.twins = self.task.twins(self.pepper, self.num_envs, options)
        self._base = self.task.base(self.pepper, self.num_envs)
        self.period, self.goal_seed = STEPS * self.twins.timestep, check_seed(goal_seed)
        self._bank = np.ascontiguousarray(
            _episodes(self.pepper, self.task, speed, self.period, self.goal_seed), float
        )
        low, high = self.pepper.lower_limits[self.joints], self.pepper.upper_limits[self.joints]
        endless = ~np.isfinite(high - low)
        low, high = np.where(endless, -np.pi, low), np.where(endless, np.pi, high)
        fastest = self.pepper.velocity_limits[self.joints]
        self._scales = np.array([(low + high) / 2, (high - low) / 2, fastest])
        self._rules = StepRules(self.task.horizon, _LOST, bool(sparse))
        counts = (np.zeros(self.num_envs, np.int64) for _ in range(5))
        self._keys, self._episodes, self._begun, self._met, self.elapsed = counts
        self.episode = self._bank[self._episodes]
        self._ended, self._ready = np.zeros(self.num_envs, bool), False
        constants = self.joints, speed, self.period, self.goal_seed, self.threads
        self._state_of = partial(TaskState, self.pepper, *constants)
        self.single_action_space = gymnasium.spaces.Box(
            -1.0, 1.0, (self.task.action_size(self.pepper),), np.float32
        )
        self.single_observation_space = self._observation_space()
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes; see `gymnasium.vector.VectorEnv.reset`.

        Args:
            seed: Seed of all robots, or one per robot; the same seeds give the same goals for any number of
                robots and threads.
            options: Dictionary with `reset_mask`, shape (N,): which robots are reset; all if omitted.

        Raises:
            InvalidValueError: for a mask or seeds of another shape, or a seed below 0.
        """
        single = seed if isinstance(seed, int) else None
        super().reset(seed=single)
        if seed is not None and not isinstance(seed, int | np.integer):
            if len(seed) != self.num_envs:
                raise InvalidValueError(
                    "seed", f"{len(seed)} numbers", f"{self.num_envs}, one for each robot"
                )
            rows = np.array([s is not None for s in seed])
            self._keys[rows] = _keys_of([s for s in seed if s is not None])
            self._episodes[rows] = 0
        elif seed is not None or not self._ready:
            base = int(self.np_random.integers(1 << 62)) if seed is None else int(seed)
            self._keys, self._episodes = _keys_of([base]) + np.arange(self.num_envs), 0 * self._episodes
        mask = np.ones(self.num_envs, bool) if not options else np.asarray(options.get("reset_mask", True))
        if mask.dtype != bool or mask.shape not in ((), (self.num_envs,)):
            raise InvalidValueError(
                "reset_mask", f"shape {mask.shape}", f"booleans of shape ({self.num_envs},)"
            )
        self._begin(np.broadcast_to(mask, (self.num_envs,)) | (not self._ready))
        self._ready = True
        return self._observations(self.state), {}

    def step(self, actions: Any) -> tuple[Any, Array, np.ndarray, np.ndarray, dict[str, Any]]:
        """Move the joints towards new targets for 20 ms; see `gymnasium.vector.VectorEnv.step`.

        Raises:
            InvalidValueError: for NaN, another shape, or before `reset`.
        """
        moves = self._checked(actions)
        anew = self._ended & (self.autoreset_mode is AutoresetMode.NEXT_STEP)
        sound = self.task.simulate(self.state, moves, self.twins, self._base)
        self._begin(anew)
        self.elapsed[~anew] += 1
        state = self.state
        score = self._score(state)
        rewards, terminated, truncated = self._end_step(score, sound, anew)
        observations = self._observations(state)
        made = {"is_success": score.success & ~score.failed, "distance": score.distance, "diverged": ~sound}
        infos = _infos(made, ~anew)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            ended = self._ended.copy()
            infos = {
                **_infos(made, ~ended), "final_obs": observations, "_final_obs": ended,
                "final_info": _infos(made, ended), "_final_info": ended,
            }  # fmt: skip
            self._begin(ended)
            observations = self._observations(self.state)
        return observations, rewards, terminated, truncated, infos

    @property
    def state(self) -> TaskState:
        """Present states of the robots, for their task."""
        return self._state_of(
            self.twins.position, self.twins.velocity, self.episode.copy(), self._begun.copy(),
            self.elapsed.copy(), self.task.measure(self.twins, self._base),
        )  # fmt: skip

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each robot with its goals, shape (320, 320, 3), or None without `render_mode`.

        The first 16 robots are drawn; the others share one gray picture.
        """
        if self._camera is None:
            return None
        state = self.state
        scenes = [self.task.scene(state, row) for row in range(min(self.num_envs, MOST_DRAWN))]
        return self._camera.pictures(state.position, scenes)

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Array:
        """Return the rewards of achieved goals for desired goals [m], shapes (N, 3 hands) or (3 hands,).

        Other criteria of a task, such as the gaze or a tilt, are not among the goals, and count as met.
        """
        del info
        gaps = np.asarray(desired_goal, float) - np.asarray(achieved_goal, float)
        distance = np.linalg.norm(gaps.reshape(*gaps.shape[:-1], -1, 3), axis=-1).max(axis=-1)
        return np.where(distance < self.task.threshold, 0.0, -1.0) if self.sparse else -distance

    def _checked(self, actions: Any) -> Array:
        """Return actions from -1 to 1, shape (N, k), or refuse them."""
        if not self._ready:
            raise InvalidValueError("step", "before reset", "reset() first")
        moves = np.asarray(actions, float)
        if moves.shape != self.action_space.shape:
            raise InvalidValueError("actions", f"shape {moves.shape}", f"shape {self.action_space.shape}")
        if not np.isfinite(moves).all():
            row = int(np.argmax(~np.isfinite(moves).all(axis=1)))
            raise InvalidValueError(f"action of environment {row}", moves[row], "finite numbers from -1 to 1")
        return np.clip(moves, -1.0, 1.0)

    def _score(self, state: TaskState) -> Score:
        """Return the scores at the end of a step; success needs goals met for the task's duration."""
        found = self.task.score(state, self.task.achieved_goal(state), self.task.desired_goal(state))
        distance, cost = (np.ascontiguousarray(part, float) for part in found[:2])
        met, failed = (np.ascontiguousarray(part, bool) for part in found[2:])
        self._met = np.where(met, self._met + 1, 0)
        return Score(distance, cost, self._met >= self.task.duration, failed)

    def _end_step(self, score: Score, sound: np.ndarray, anew: np.ndarray) -> StepOutcome:
        """Return the rewards, and which episodes end; a step that begins one (`anew`) has neither."""
        ends = StepOutcome(
            np.empty(self.num_envs), np.empty(self.num_envs, bool), np.empty(self.num_envs, bool)
        )
        end_step(score, np.ascontiguousarray(sound), anew, self.elapsed, self._rules, ends)
        self._met[anew], self._ended = 0, ends.terminated | ends.truncated
        return ends

    def _begin(self, mask: np.ndarray) -> None:
        """Begin new episodes of some robots, shape (N,)."""
        rows = np.flatnonzero(mask)
        if not rows.size:
            return
        begin_episodes(rows, self._keys, self._episodes, self._bank, self.episode)
        self._begun[rows] += 1
        self.elapsed[rows], self._ended[rows], self._met[rows] = 0, False, 0
        self.task.reset(self.state, rows, self.twins, self._base)

    def _observations(self, state: TaskState) -> Any:
        """Return the observations as new arrays."""
        achieved, desired = self.task.achieved_goal(state), self.task.desired_goal(state)
        parts = achieved, desired, self.task.extra_observation(state)
        seen = Seen(state.position, state.velocity, *(np.ascontiguousarray(part, float) for part in parts))
        ways = 1 if self.goal_form else 2
        size = 2 * self.joints.size + ways * seen.places[0].size + seen.extra.shape[1]
        found = np.empty((self.num_envs, size), np.float32)
        observe(seen, self._scales, self.joints, not self.goal_form, found)
        if not self.goal_form:
            return found
        goals = {"achieved_goal": achieved, "desired_goal": desired}
        flat = {name: part.reshape(len(part), -1).astype(np.float32) for name, part in goals.items()}
        return {"observation": found, **flat}

    def _observation_space(self) -> gymnasium.Space[Any]:
        state = self.state
        goal = 3 * self.task.achieved_goal(state).shape[1]
        size = 2 * self.joints.size + goal + self.task.extra_observation(state).shape[1]

        def box(length: int) -> gymnasium.spaces.Box:
            return gymnasium.spaces.Box(-np.inf, np.inf, (length,), np.float32)

        if not self.goal_form:
            return box(size + goal)
        parts: dict[str, gymnasium.Space[Any]] = {"observation": box(size)}
        parts |= {"achieved_goal": box(goal), "desired_goal": box(goal)}
        return gymnasium.spaces.Dict(parts)


def ended_values(infos: Mapping[str, Any], name: str, ended: np.ndarray) -> np.ndarray:
    """Return a value of a step's infos for the robots whose episode has ended with it, else zero.

    Args:
        infos: Infos of `PepperVectorEnv.step`, in any autoreset mode.
        name: Name of the value, such as "is_success".
        ended: Which robots' episodes have ended, shape (N,).
    """
    last = infos.get("final_info", infos)
    return np.where(ended, last[name], 0) if name in last else np.zeros(len(ended))


def _infos(made: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, Any]:
    """Return values of some robots' steps as infos of a Gymnasium vector environment.

    Args:
        made: Name -> values of all robots, shape (N,).
        rows: Mask of the robots whose values count, shape (N,), returned as `_name`; others' values are zero.
    """
    found: dict[str, Any] = {}
    if rows.any():
        for name, values in made.items():
            found |= {name: np.where(rows, values, np.zeros((), values.dtype)), f"_{name}": rows.copy()}
    return found


@kept_for_robot(most=32)
def _episodes(pepper: PepperModel, task: RobotTask, speed: float, period: float, seed: int) -> Array:
    return task.episodes(pepper, speed, period, seed)


def _keys_of(seeds: Sequence[int]) -> NDArray[np.int64]:
    """Return keys of streams of random numbers, shape (k,)."""
    return np.array([stream_key(check_seed(seed), 0) for seed in seeds], np.uint64).view(np.int64)
