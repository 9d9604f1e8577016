"""Checked inputs of a base-placement search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.base_placement.moving_base import moving_base, wrapped
from pepper_kin.base_placement.score import PlacementWeights, Scorer
from pepper_kin.base_placement.task_sets import Given, task_sets
from pepper_kin.base_placement.trial import CandidateEvaluator
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.loads import loads_of
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.problem import movable_joints
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_finite,
    as_joint_vector,
    check_seed,
    check_whole,
    check_within_limits,
)
from pepper_kin.model.wheels import BASE_JOINTS

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


class Job(NamedTuple):
    """Checked inputs of a search.

    Attributes:
        evaluator: Evaluator of candidate base poses.
        stand: Current base pose: x, y [m] and yaw [rad], shape (3,).
        movable: Mask of the joints of the moving robot that may move, without the base's, shape (robot.n,).
    """

    evaluator: CandidateEvaluator
    stand: Array
    movable: np.ndarray


def make_job(
    pepper: PepperModel,
    tasks: Given,
    start: ArrayLike | None,
    stand: ArrayLike | None,
    scene: Scene | None,
    collisions: bool,
    joints: str | Sequence[str] | None,
    weights: PlacementWeights | None,
    *,
    seed: int,
    threads: int,
) -> Job:
    """Check the common arguments of `place_base` and `placement_map`; return them as a `Job`.

    `start` has shape (n,) [rad or m], `stand` shape (3,): x, y [m] and yaw [rad].
    """
    moving = moving_base(pepper)
    sets = task_sets(pepper, tasks)
    home = pepper.neutral() if start is None else as_joint_vector(pepper, start, "start")
    check_within_limits(pepper, home, "start")
    home = np.clip(home, pepper.lower_limits, pepper.upper_limits)
    held = [name in pepper.joint_names for name in BASE_JOINTS]
    here = moving.states(home, np.zeros((1, 3)))[0]
    if stand is not None:
        place = as_finite(stand, "stand", (3,)).copy()
    elif all(held):
        place = home[[pepper.joint_index(name) for name in BASE_JOINTS]]
    else:
        place = here[moving.base]
    place[2] = wrapped(place[2])
    low, high = moving.robot.lower_limits[moving.base], moving.robot.upper_limits[moving.base]
    if (place < low).any() or (place > high).any():
        raise InvalidValueError("stand", place.tolist(), f"a place within {low.tolist()} and {high.tolist()}")
    mask = moving.movable(movable_joints(pepper, joints))
    if not mask.any():
        raise InvalidValueError("joints", repr(joints), "at least one joint besides the base's")
    world = checked_world(scene, collisions)
    loads = loads_of(moving.robot, world)
    sets = tuple(tuple(with_loads(group, loads)) for group in sets)
    scorer = Scorer(moving, sets, mask, home, place, weights or PlacementWeights())
    evaluator = CandidateEvaluator(
        moving, sets, home, moving.names(mask), scorer, world, check_seed(seed),
        check_whole("threads", threads, 1),
    )  # fmt: skip
    return Job(evaluator, place, mask)
