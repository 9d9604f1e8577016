"""Parts that all rows of a job share: robot, scenes, random numbers, goals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pepper_kin import kinematics
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene, in_collision
from pepper_kin.collision.scene_file import scene_from_dict
from pepper_kin.datasets.columns import Column
from pepper_kin.datasets.job import DatasetJob
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ik import HandPosition, LookAt
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel, load_pepper, load_robot
from pepper_kin.model.joint_vectors import as_finite, check_choice

NUMBERS = 64
"""Number of random numbers per row that are drawn for many rows at once."""
_POSITION, _PLACE, _STARTS, _SHIFT = 0, 3, 4, 40  # offsets of the numbers for goal, scene, start and shifts
_TRIES = 64  # maximum number of random starts that are tried until one is collision-free


PLACE = "object."
"""Prefix of the names of columns with the positions of shifted objects."""


class Recipe:
    """Robot, scenes and random numbers of a job, all determined by the job.

    The random numbers of row r are the counters from 16 r on of Philox (J. Salmon et al., Parallel random
    numbers: as easy as 1, 2, 3, 2011) with the job's seed as its key: they do not depend on the process and
    shard that compute the row.

    Args:
        job: The job.

    Raises:
        InvalidValueError, UnknownNameError, LimitError: naming the option that the robot does not accept.
        FileFormatError: for a missing file.
    """

    def __init__(self, job: DatasetJob) -> None:
        self.job = job
        robot = dict(job.robot)
        files = {name: robot.pop(name)["path"] for name in ("urdf", "srdf") if name in robot}
        self.pepper: PepperModel = load_robot(**files, **robot) if files else load_pepper(**robot)
        made = [scene_from_dict(s, f"scenes[{k}]", Scene) for k, s in enumerate(job.scenes)]
        self.scenes = made or [Scene()]
        self.shifts = {
            name: np.abs(as_finite(shift, f"shift of {name}", (3,)))
            for name, shift in job.randomization.get("objects", {}).items()
        }
        known = {name for scene in self.scenes for name in scene.objects}
        for name in self.shifts:
            if name not in known:
                raise UnknownNameError("object to shift", name, sorted(known))
        if 3 * len(self.shifts) > NUMBERS - _SHIFT:
            raise InvalidValueError("objects of randomization", len(self.shifts), "8 at most")

    def seed_of(self, row: int) -> int:
        """Return the seed of a row's own random choices, from 0 to 2^31 - 1."""
        source = np.random.Philox(key=[self.job.seed, 1], counter=[row, 0, 0, 0])
        return int(source.random_raw() >> 33)

    def uniforms(self, begin: int, end: int) -> Array:
        """Return random numbers of rows, shape (rows, NUMBERS), from 0 to 1."""
        source = np.random.Philox(key=[self.job.seed, 0], counter=[begin * NUMBERS // 4, 0, 0, 0])
        return np.random.Generator(source).random((end - begin, NUMBERS))

    def joints(self, name: str, unit: str = "", *, frames: bool = False) -> Column:
        """Return a column with one number per joint."""
        return Column(name, "float64", (self.pepper.n,), frames, unit, self.pepper.joint_names)

    def scene_numbers(self, u: Array) -> np.ndarray:
        """Return the index of the scene of each row, shape (rows,)."""
        return np.minimum((u[:, _PLACE] * len(self.scenes)).astype(np.int32), len(self.scenes) - 1)

    def scene(self, number: int, u: Array) -> Scene:
        """Return the world of a row with random numbers of shape (NUMBERS,)."""
        scene, places = self.scenes[number], self.places(number, u)
        return scene.moved(places) if places else scene

    def places(self, number: int, u: Array) -> dict[str, Array]:
        """Return the positions of the shifted objects in a row's scene [m], shape (3,) each."""
        scene, places = self.scenes[number], {}
        for k, (name, shift) in enumerate(self.shifts.items()):
            if name in scene.objects:
                way = shift * (2.0 * u[_SHIFT + 3 * k : _SHIFT + 3 * k + 3] - 1.0)
                places[name] = scene.objects[name].transform_object_to_world[:3, 3] + way
        return places

    def place_columns(self) -> tuple[Column, ...]:
        """Return a column for each shifted object: its position in the world, NaN in scenes without it."""
        xyz = ("x", "y", "z")
        return tuple(Column(f"{PLACE}{name}", "float64", (3,), unit="m", names=xyz) for name in self.shifts)

    def place_values(self, numbers: np.ndarray, u: Array) -> dict[str, Array]:
        """Return the values of `place_columns` of rows, shape (rows, 3) each.

        Args:
            numbers: Indices of the rows' scenes, shape (rows,).
            u: Random numbers, shape (rows, NUMBERS).
        """
        found = {f"{PLACE}{name}": np.full((len(u), 3), np.nan) for name in self.shifts}
        if self.shifts:
            for row, number in enumerate(numbers.tolist()):
                for name, place in self.places(number, u[row]).items():
                    found[f"{PLACE}{name}"][row] = place
        return found

    def worlds(self, u: Array) -> Iterator[tuple[np.ndarray, Scene]]:
        """Yield the indices of the rows in each world, shape (k,), and the world."""
        numbers = self.scene_numbers(u)
        if self.shifts:
            for row, number in enumerate(numbers.tolist()):
                yield np.array([row]), self.scene(number, u[row])
            return
        for number, scene in enumerate(self.scenes):
            rows = np.flatnonzero(numbers == number)
            if rows.size:
                yield rows, scene


class Goals:
    """Goals of hands, and starts of motions.

    Args:
        recipe: Recipe of the job.
        starts: Whether the rows have a start of a motion.
    """

    def __init__(self, recipe: Recipe, *, starts: bool) -> None:
        targets, self._recipe = recipe.job.targets, recipe
        pepper = recipe.pepper
        self.hand = check_choice("hand", targets.get("hand", "left"), ("left", "right"))
        self.by = check_choice("by", targets.get("by", "box"), ("box", "postures"))
        self.look = bool(targets.get("look", False))
        self.frame = HandPosition(self.hand, (0.0, 0.0, 1.0)).frame
        pepper.frame_id(self.frame)
        if self.by == "box":
            low, high = (targets.get(name) for name in ("lower", "upper"))
            if low is None or high is None:
                raise InvalidValueError("targets", sorted(targets), "lower and upper [m], or by: postures")
            self._box = as_finite(low, "lower", (3,)), as_finite(high, "upper", (3,))
            if np.any(self._box[0] > self._box[1]):
                raise InvalidValueError("lower", low, f"at most upper, {high}")
        elif pepper.n > _SHIFT - _STARTS:
            raise InvalidValueError("robot", f"{pepper.n} joints", f"{_SHIFT - _STARTS} for by: postures")
        self._start = targets.get("start", "Stand") if starts else "Stand"
        if starts and self._start != "random":
            pepper.posture(self._start)
        full = ~np.isfinite(pepper.upper_limits - pepper.lower_limits)
        self._lower = np.where(full, -np.pi, pepper.lower_limits)
        self._upper = np.where(full, np.pi, pepper.upper_limits)

    def points(self, u: Array) -> Array:
        """Return the goals of the hand [m], shape (rows, 3)."""
        if self.by == "box":
            return self._box[0] + u[:, _POSITION : _POSITION + 3] * (self._box[1] - self._box[0])
        pepper = self._recipe.pepper
        q = self._lower + u[:, _STARTS : _STARTS + pepper.n] * (self._upper - self._lower)
        few = max(0, 24 - len(q))  # smaller batches run other code, which differs in the last bit
        padded = np.concatenate([q, np.repeat(q[-1:], few, axis=0)])
        return np.array(kinematics.frame_pose(pepper, padded, self.frame)[: len(q), :3, 3])

    def tasks(self, points: Array) -> list[Task]:
        """Return the inverse kinematics tasks of one point [m], shape (3,), or several, (rows, 3)."""
        return [HandPosition(self.hand, points), *([LookAt(points)] if self.look else [])]

    def start(self, row: int, scene: Scene) -> Array:
        """Return the start of a motion [rad or m], shape (n,); after the last try it may be in collision."""
        pepper = self._recipe.pepper
        if self._start != "random":
            return pepper.posture(self._start)
        rng = np.random.Generator(np.random.Philox(key=[self._recipe.job.seed, 2], counter=[0, row, 0, 0]))
        q = rng.uniform(self._lower, self._upper, (_TRIES, pepper.n))
        free = np.flatnonzero(~in_collision(pepper, q, scene))
        return np.array(q[free[0] if free.size else -1])
