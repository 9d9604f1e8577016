"""Base-placement map: score of each cell of the floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, BriefRepr, read_only
from pepper_kin.base_placement.job import make_job
from pepper_kin.base_placement.moving_base import wrapped
from pepper_kin.base_placement.score import PlacementWeights
from pepper_kin.base_placement.task_sets import Given
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, check_positive, check_whole

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


@dataclass(frozen=True, eq=False)
class PlacementMap(BriefRepr):
    """Best score in each cell of a grid on the floor.

    Attributes:
        origin: Corner with the smallest coordinates [m], shape (2,), read-only.
        resolution: Edge of a cell [m].
        scores: Best score, shape (nx, ny), read-only; NaN for cells without a suitable or tried base pose.
        yaws: Heading of the best base pose [rad], shape (nx, ny), read-only; NaN where the score is.
    """

    origin: Array
    resolution: float
    scores: Array
    yaws: Array

    @property
    def area(self) -> float:
        """Area of all cells from which every target is reached [m^2]."""
        return float(np.isfinite(self.scores).sum() * self.resolution**2)

    @property
    def centers(self) -> Array:
        """Centers of the cells from which every target is reached [m], shape (k, 2)."""
        return self.origin + (np.argwhere(np.isfinite(self.scores)) + 0.5) * self.resolution

    def score_at(self, point: tuple[float, float]) -> float:
        """Return the score of the cell that contains a point of the floor [m]; NaN outside the grid.

        Raises:
            InvalidValueError: for a point of another shape, NaN or infinity.
        """
        cell = np.floor((as_finite(point, "point", (2,)) - self.origin) / self.resolution + 1e-9).astype(int)
        if (cell < 0).any() or (cell >= self.scores.shape).any():
            return float("nan")
        return float(self.scores[cell[0], cell[1]])


def map_of(places: Array, scores: Array, resolution: float) -> PlacementMap:
    """Return the map of base poses, shape (N, 3), with scores, shape (N,), NaN for unsuitable ones.

    Raises:
        InvalidValueError: for a resolution that is not a finite number above 0, or more than ten million
            cells.
    """
    size = check_positive("resolution", resolution, "m")
    cells = np.floor(places[:, :2] / size + 1e-9)
    corner = cells.min(axis=0)
    shape = (cells.max(axis=0) - corner).astype(int) + 1
    if shape.prod() > 1e7:
        raise InvalidValueError("resolution", resolution, "a coarser one: the map has over ten million cells")
    best, yaws = np.full(shape, np.nan), np.full(shape, np.nan)
    index = (cells - corner).astype(int)
    for row in np.argsort(np.nan_to_num(scores, nan=-1.0), kind="stable"):
        if np.isfinite(scores[row]):
            best[index[row, 0], index[row, 1]] = scores[row]
            yaws[index[row, 0], index[row, 1]] = places[row, 2]
    return PlacementMap(read_only(corner * size), size, read_only(best), read_only(yaws))


def placement_map(
    pepper: PepperModel,
    tasks: Given,
    start: ArrayLike | None = None,
    *,
    center: ArrayLike,
    stand: ArrayLike | None = None,
    scene: Scene | None = None,
    collisions: bool = True,
    joints: str | Sequence[str] | None = None,
    size: float = 2.0,
    resolution: float = 0.1,
    headings: int = 12,
    weights: PlacementWeights | None = None,
    seed: int = 0,
    threads: int = 1,
    progress: Callable[[float], None] | None = None,
) -> PlacementMap:
    """Try every cell of a square of the floor with several headings, and return the best scores.

    Scores are as in `place_base` without clearance; base poses in collision are not suitable.

    Args:
        pepper: The robot.
        tasks: One task, a list of tasks, or a list of lists of tasks, see `place_base`.
        start: Joint positions at the start [rad or m], shape (n,); `pepper.neutral()` if None.
        center: Middle of the square [m], shape (2,).
        stand: Current base pose: x, y [m], yaw [rad], shape (3,); None for the pose in `start`, or the
            origin.
        scene: Obstacles around the robot; None for none. Self-collision is checked with or without a scene.
        collisions: Whether collisions are checked.
        joints: Joints that may move, by names of joints and groups; None for all.
        size: Edge of the square [m].
        resolution: Edge of a cell [m].
        headings: Number of headings, evenly distributed.
        weights: Weights of the score's terms.
        seed: Seed of the restarts.
        threads: Number of threads that share the work.
        progress: Function that is called with the finished fraction, from 0 to 1.

    Returns:
        The map of the square.

    Raises:
        InvalidValueError: for no task, malformed numbers, or a size, resolution or number of headings out of
            range.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a start outside the joint limits.
    """
    job = make_job(
        pepper, tasks, start, stand, scene, collisions, joints, weights, seed=seed, threads=threads
    )
    middle = as_finite(center, "center", (2,))
    edge, length = check_positive("resolution", resolution, "m"), check_positive("size", size, "m")
    turns = check_whole("headings", headings, 1)
    cells = int(np.ceil(length / edge))
    if cells**2 * turns > 1e7:
        raise InvalidValueError("resolution", resolution, "a coarser one: over ten million places to try")
    first = np.floor((middle - length / 2) / edge + 1e-9)
    axis = np.arange(cells) + 0.5
    yaws = wrapped(2 * np.pi * np.arange(turns) / turns)
    scores, headed = np.empty((cells, cells, turns)), np.empty((cells, cells, turns, 3))
    for row in range(cells):
        x, y = np.meshgrid((first[0] + axis[row : row + 1]) * edge, (first[1] + axis) * edge, indexing="ij")
        spots = np.stack(np.broadcast_arrays(x[..., None], y[..., None], yaws), axis=-1)
        trials = job.evaluator(spots.reshape(-1, 3))
        headed[row] = spots[0]
        scores[row] = np.where(trials.good, trials.scores, np.nan).reshape(cells, turns)
        if progress is not None:
            progress((row + 1) / cells)
    return map_of(headed.reshape(-1, 3), scores.reshape(-1), edge)
