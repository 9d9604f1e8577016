"""Kinds of datasets: their columns, and the computation of their rows."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pepper_kin import ik, kinematics
from pepper_kin.arrays import Array
from pepper_kin.batch.states import KERNEL_FROM
from pepper_kin.collision import Scene
from pepper_kin.datasets.columns import Column
from pepper_kin.datasets.recipe import Goals, Recipe
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.ik.batch import CODES
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.requirements import ROBOT
from pepper_kin.motion import Plan, plan
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.twin import ActuatorParameters, Run, RunStatus, Twin, actuator_parameters
from pepper_kin.twin.sensors import SensorSuite

learning = lazy_module("pepper_kin.learning")  # needs another extra
identification = lazy_module("pepper_kin.identification")

SOLVED = "solved"
NOT_CERTIFIED = "not_certified"
NO_TIMING = "no_timing"
_NOT_KEPT = (RunStatus.STOPPED, RunStatus.TOUCHED, RunStatus.BLOCKED)  # no frames kept; a late run is data
_ROW = Column("row", "int64")
_STATUS = Column("status", "str")
_REASON = Column("reason", "str")
_TARGET = Column("target", "float64", (3,), unit="m", names=("x", "y", "z"))
_SCENE = Column("scene", "int32")
_TIME = Column("time", frames=True, unit="s")
_TIMED = re.compile(r"\d m?s\b")
_TIMEOUT = 60.0  # timeout of a plan [s]: long, so that slow and fast machines find the same plans
_TOGETHER = 64  # maximum number of robots that act at once

Values = Mapping[str, Any]


class DatasetKind:
    """Rows of one kind of dataset.

    Attributes:
        recipe: Robot, scenes and random numbers that the rows share.
        columns: The columns, `row` first and `status` second.
        episodes: Whether each row is a motion, stored as one group of the file.
    """

    episodes = True

    def __init__(self, recipe: Recipe) -> None:
        self.recipe, self.job = recipe, recipe.job
        self.columns: tuple[Column, ...] = ()

    def rows(self, begin: int, end: int) -> Iterator[Values]:
        """Yield the columns of rows, one row or all rows at a time; a row depends only on its index."""
        raise NotImplementedError

    def _ended(self, row: int, status: str, reason: str, **values: Any) -> Values:
        """Return a row; frames that are not given are empty, and numbers NaN."""
        found: dict[str, Any] = {"row": [row], "status": [status], "reason": [reason]}
        for column in self.columns:
            if column.name in values:
                value = values[column.name]
                found[column.name] = value if column.frames else np.asarray(value)[np.newaxis]
            elif column.name not in found:
                empty = np.nan if np.dtype(column.dtype).kind == "f" else 0
                found[column.name] = np.full((0 if column.frames else 1, *column.shape), empty, column.dtype)
        return found


class IKRows(DatasetKind):
    """Solutions of the inverse kinematics."""

    episodes = False

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.goals = Goals(recipe, starts=False)
        parts = [_ROW, _STATUS, _REASON, _SCENE, *recipe.place_columns(), _TARGET]
        parts += [recipe.joints("q", "rad or m")]
        parts += [Column("error", unit="m"), Column("iterations", "int64"), Column("restarts", "int64")]
        self.columns = tuple(parts)

    def rows(self, begin: int, end: int) -> Iterator[Values]:
        """Yield all rows at once."""
        u = self.recipe.uniforms(begin, end)
        points, count = self.goals.points(u), end - begin
        found: dict[str, Any] = {
            c.name: np.empty((count, *c.shape), c.dtype if c.dtype != "str" else object) for c in self.columns
        }
        numbers = self.recipe.scene_numbers(u)
        found |= {"row": np.arange(begin, end), "target": points, "scene": numbers}
        found |= self.recipe.place_values(numbers, u)
        words = np.array([status.value for status in CODES], dtype=object)
        options = {"seed": self.job.seed % 2**31, "closest": False, **self.job.planner}
        for rows, scene in self.recipe.worlds(u):
            if options.get("collisions", True):
                options["scene"] = scene
            solved = ik.solve_batch(self.recipe.pepper, self.goals.tasks(points[rows]), **options)
            for name, value in {
                "q": solved.q, "status": words[solved.codes], "error": solved.errors[:, 0],
                "reason": [solved.reason(row) for row in range(len(rows))],
                "iterations": solved.iterations, "restarts": solved.restarts,
            }.items():  # fmt: skip
                found[name][rows] = value
        yield found


class ReachMapRows(DatasetKind):
    """Reachability maps of a frame, each from other samples, so that their counts can be added."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.frame = recipe.job.targets.get("frame", "LArm_effector")
        recipe.pepper.frame_id(self.frame)
        center = Column("center", "float64", (3,), True, "m", ("x", "y", "z"))
        self.columns = (
            _ROW, _STATUS, _REASON, Column("samples", "int64"), center,
            Column("count", "int64", frames=True), Column("manipulability", frames=True, unit="m^3"),
        )  # fmt: skip

    def rows(self, begin: int, end: int) -> Iterator[Values]:
        """Yield map after map."""
        options = {"samples": 100_000, **self.job.targets, "frame": self.frame}
        for row in range(begin, end):
            found = kinematics.reach_map(self.recipe.pepper, seed=self.recipe.seed_of(row), **options)
            hit = found.counts > 0
            yield self._ended(
                row, SOLVED, "", samples=found.samples, center=found.centers, count=found.counts[hit],
                manipulability=found.best[hit],
            )  # fmt: skip


class PlanRows(DatasetKind):
    """Paths free of collisions, as waypoints."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.goals = Goals(recipe, starts=True)
        self.columns = (
            *self._about(), Column("length", unit="rad or m"), recipe.joints("path", "rad or m", frames=True)
        )  # fmt: skip

    def _about(self) -> tuple[Column, ...]:
        places = self.recipe.place_columns()
        return (_ROW, _STATUS, _REASON, _SCENE, *places, _TARGET, self.recipe.joints("start", "rad or m"))

    def rows(self, begin: int, end: int) -> Iterator[Values]:
        """Yield plan after plan."""
        u = self.recipe.uniforms(begin, end)
        points, numbers = self.goals.points(u), self.recipe.scene_numbers(u)
        places = self.recipe.place_values(numbers, u)
        for k, row in enumerate(range(begin, end)):
            scene = self.recipe.scene(int(numbers[k]), u[k])
            start = self.goals.start(row, scene)
            options = {"timeout": _TIMEOUT, **self.job.planner, "seed": self.recipe.seed_of(row)}
            found = plan(self.recipe.pepper, start, self.goals.tasks(points[k]), scene, **options)
            about = {"scene": numbers[k], "target": points[k], "start": start}
            about |= {name: values[k] for name, values in places.items()}
            if found.success:
                yield self._made(row, found, scene, about)
            else:
                yield self._ended(row, found.status.value, _reason(found), **about)

    def _made(self, row: int, found: Plan, scene: Scene, about: dict[str, Any]) -> Values:
        """Return the row of a plan."""
        path = np.asarray(found.path)
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        return self._ended(row, SOLVED, "", path=path, length=length, **about)


class TrajectoryRows(PlanRows):
    """Plans with their timing, checked independently."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.columns = (*self._about(), Column("duration", unit="s"), _TIME, *self._motion())

    def _motion(self) -> tuple[Column, ...]:
        quantities = {"position": "rad or m", "velocity": "rad/s or m/s", "acceleration": "rad/s^2 or m/s^2"}
        return tuple(self.recipe.joints(name, unit, frames=True) for name, unit in quantities.items())

    def _made(self, row: int, found: Plan, scene: Scene, about: dict[str, Any]) -> Values:
        pepper = self.recipe.pepper
        limits = {"balance": ROBOT, **self.job.timing}
        try:
            motion = retime(pepper, found, **limits)
        except InfeasibleError as error:
            return self._ended(row, NO_TIMING, str(error), **about)
        checked = {name: limits[name] for name in ("balance", "payload") if name in limits}
        certificate = motion.check(pepper, scene=scene, **checked)
        if not certificate.success:
            reason = "; ".join(certificate.checks[name].sentence() for name in certificate.failures)
            return self._ended(row, NOT_CERTIFIED, reason, duration=motion.duration, **about)
        return self._certified(row, motion, scene, {"duration": motion.duration, **about})

    def _certified(self, row: int, motion: Trajectory, scene: Scene, about: dict[str, Any]) -> Values:
        # At equally spaced times, the last of which is at or after the end, where the robot rests.
        time = np.arange(math.ceil(motion.duration * self.job.fps - 1e-6) + 1) / self.job.fps
        state = motion(np.minimum(time, motion.duration))
        resting = (time < motion.duration)[:, np.newaxis]
        frames = {"time": time, "position": state.position, "velocity": state.velocity * resting}
        frames["acceleration"] = state.acceleration * resting
        return self._ended(row, SOLVED, "", **frames, **about)


class RunRows(TrajectoryRows):
    """Certified motions on a twin that may differ from row to row, with the readings of its sensors."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self._options = {"timestep": 0.001, **recipe.job.twin}
        self._hold = float(self._options.pop("hold_time", 0.0))
        Twin(recipe.pepper, **self._options)
        self._actuators(0)
        self._stride = max(1, round(1.0 / (self.job.fps * self._options["timestep"])))
        sensed: list[Column] = []
        for name, reading in self._suite(0, recipe.scenes[0]).read(0.0, recipe.pepper.neutral()).items():
            value = np.asarray(reading.value)
            names = recipe.pepper.joint_names if value.shape == (recipe.pepper.n,) else ()
            sensed.append(Column(f"{name}.time", frames=True, unit="s"))
            sensed.append(Column(name, value.dtype.name, value.shape, True, reading.unit, names))
        quantities = {"position": "rad or m", "velocity": "rad/s or m/s", "torque": "N m or N"}
        quantities["reference_position"] = "rad or m"
        moved = [recipe.joints(name, unit, frames=True) for name, unit in quantities.items()]
        self.columns = (*self._about(), Column("duration", unit="s"), _TIME, *moved, *sensed)

    def _suite(self, row: int, scene: Scene) -> SensorSuite:
        seed = self.recipe.seed_of(row)
        return SensorSuite(self.recipe.pepper, seed=seed, sensors=self.job.sensors, scene=scene)

    def _actuators(self, row: int) -> ActuatorParameters:
        usual, ranges = actuator_parameters(self.recipe.pepper), self.job.randomization.get("twin")
        if ranges is None:
            return usual
        drawn = _randomization(ranges).drawn(self.recipe.pepper, 1, self.recipe.seed_of(row))
        if "mass_scale" in drawn:
            raise InvalidValueError("twin of randomization", "mass", "other quantities for runs")
        return replace(usual, **{name: value[0] for name, value in drawn["vary"].items()})

    def _certified(self, row: int, motion: Trajectory, scene: Scene, about: dict[str, Any]) -> Values:
        suite = self._suite(row, scene)
        options = {**self._options, "actuators": self._actuators(row), "sensors": suite, "scene": scene}
        run: Run = Twin(self.recipe.pepper, **options).execute(motion, self._hold)
        if run.status in _NOT_KEPT:
            return self._ended(row, run.status.value, run.message, **about)
        names = ("time", "position", "velocity", "torque", "reference_position")
        frames: dict[str, Array] = {name: getattr(run, name)[:: self._stride] for name in names}
        for name, series in run.readings.items():
            frames |= {f"{name}.time": series.time, name: series.value}
        return self._ended(row, SOLVED, "", **frames, **about)


class DemonstrationRows(DatasetKind):
    """Episodes of learning tasks, acted by the oracle."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        given, ranges = recipe.job.targets, recipe.job.randomization.get("twin")
        self._options = {name: given[name] for name in ("goal_seed", "speed") if name in given}
        if recipe.job.robot:
            self._options["pepper"] = recipe.pepper
        self._ranges = None if ranges is None else _randomization(ranges)
        self._task = given.get("task", "Reach")
        env = self._env(1)
        names = tuple(np.array(env.pepper.joint_names)[env.joints].tolist())
        actions = names if env.action_space.shape[1] == len(names) else ()
        vectors = (
            ("observation", env.observation_space.shape[1], _observed(env, names)),
            ("action", env.action_space.shape[1], actions),
        )
        self.columns = (
            _ROW, _STATUS, _REASON, Column("distance", unit="m"), _TIME,
            *(Column(name, "float32", (size,), True, "", words) for name, size, words in vectors),
            Column("position", "float64", (env.pepper.n,), True, "rad or m", env.pepper.joint_names),
            Column("reward", frames=True),
        )  # fmt: skip

    def _env(self, count: int, seed: int = 0) -> Any:
        options = {**self._options, "randomization": self._ranges, "randomization_seed": seed}
        return learning.PepperVectorEnv(count, self._task, **options)

    def rows(self, begin: int, end: int) -> Iterator[Values]:
        """Yield episode after episode; identical robots act in one batch."""
        alike = self._ranges is None
        together = _TOGETHER if alike else 1
        for first in range(begin, end, together):
            rows = range(first, min(first + together, end))
            yield from self._episodes(rows, max(len(rows), KERNEL_FROM) if alike else 1)

    def _episodes(self, rows: range, count: int) -> Iterator[Values]:
        """Yield the episodes of rows, with at least `count` robots: smaller batches run other code.

        A kernel's result for a row does not depend on its neighbors, so each row is the same bit by bit.
        """
        seeds = [self.recipe.seed_of(row) for row in rows]
        seeds += [seeds[0]] * (count - len(rows))
        env = self._env(count, seeds[0])
        oracle = learning.Oracle(env)
        observation, _ = env.reset(seed=seeds)
        steps: list[tuple[Any, ...]] = []
        lengths, success = np.zeros(count, int), np.zeros(count, bool)
        distance = np.full(count, np.nan)
        while not lengths.all():
            action, position = np.asarray(oracle(), np.float32), env.twins.position
            after, reward, terminated, truncated, infos = env.step(action)
            steps.append((observation, action, position, reward))
            observation, ended = after, (terminated | truncated) & (lengths == 0)
            lengths[ended] = len(steps)
            success[ended], distance[ended] = infos["is_success"][ended], infos["distance"][ended]
        names = ("observation", "action", "position", "reward")
        series = {name: np.stack(each) for name, each in zip(names, zip(*steps, strict=True), strict=True)}
        for k, row in enumerate(rows):
            frames = {name: values[: lengths[k], k] for name, values in series.items()}
            frames["time"] = env.period * np.arange(lengths[k])
            status, reason = (SOLVED, "") if success[k] else ("failed", "the oracle missed the goal")
            yield self._ended(row, status, reason, distance=distance[k], **frames)


def _observed(env: Any, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of the observed numbers, in the order of `core.episodes.observe`."""
    axes = [f"{k}.{axis}" for k in range(env.task.achieved_goal(env.state).shape[1]) for axis in "xyz"]
    names = [f"{joint}.{quantity}" for quantity in ("position", "velocity") for joint in joints]
    names += [f"{quantity}.{axis}" for quantity in ("place", "way_to_goal") for axis in axes]
    return (*names, *(f"extra.{k}" for k in range(env.observation_space.shape[1] - len(names))))


class ReplayRows(DatasetKind):
    """Logs of robots with the twin's simulation of each log, one log after the other."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        if len(recipe.job.targets["logs"]) != recipe.job.rows:
            count = len(recipe.job.targets["logs"])
            raise InvalidValueError("rows", recipe.job.rows, f"{count}, one for each of the logs")
        numbers = ("command", "measured", "twin", "unexplained")
        self.columns = (
            _ROW, _STATUS, _REASON, Column("log", "str"), Column("round_trip", unit="s"), _TIME,
            *(recipe.joints(name, "rad", frames=True) for name in numbers),
        )  # fmt: skip

    def rows(self, begin: int, end: int) -> Iterator[Values]:
        """Yield log after log; joints that a log lacks are NaN."""
        pepper = self.recipe.pepper
        for row in range(begin, end):
            log = identification.read_log(self.job.targets["logs"][row]["path"])
            found = identification.replay(pepper, log)
            values = (log.commands_at(log.time), log.measured, found.twin, found.unexplained)
            frames = {}
            places = [pepper.joint_index(name) for name in log.joint_names]
            for name, value in zip(("command", "measured", "twin", "unexplained"), values, strict=True):
                frames[name] = np.full((log.time.size, pepper.n), np.nan)
                frames[name][:, places] = value
            about = {"log": log.name, "round_trip": found.round_trip, "time": log.time}
            yield self._ended(row, SOLVED, "", **frames, **about)


ALL: dict[str, type[DatasetKind]] = {
    "ik": IKRows,
    "reach_maps": ReachMapRows,
    "plans": PlanRows,
    "trajectories": TrajectoryRows,
    "runs": RunRows,
    "demonstrations": DemonstrationRows,
    "replays": ReplayRows,
}


def _reason(found: Plan) -> str:
    """Return why there is no plan, without lines that state a time, which differ from call to call."""
    lines = [line for line in found.message.splitlines() if not _TIMED.search(line)]
    return "\n".join(lines) or found.status.advice


def _randomization(ranges: Any) -> Any:
    """Return the ranges of a job: a mapping, or "measured" for the ranges of a real robot."""
    return learning.Randomization(None if ranges == "measured" else ranges)
