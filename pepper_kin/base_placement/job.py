"""Checked inputs of a base-placement search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.base_placement.moving_base import BASE_JOINTS, moving_base, wrapped
from pepper_kin.base_placement.score import PlacementWeights, Scorer
from pepper_kin.base_placement.task_sets import Given, task_sets
from pepper_kin.base_placement.trial import CandidateEvaluator
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.problem import movable_joints
from pepper_kin.ik.solve import whole_number
from pepper_kin.ik.tasks.task import Array
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors, check_within_limits

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


class Job(NamedTuple):
    """What was asked for, checked.

    Attributes:
        evaluator: Tries places out.
        stand: The current place, shape (3,).
        movable: Joints of the moving robot that may move, the base's apart.
    """

    evaluator: CandidateEvaluator
    stand: Array
    movable: np.ndarray


def make_job(
    pepper: PepperModel,
    tasks: Given,
    q0: ArrayLike | None,
    stand: ArrayLike | None,
    scene: Scene | None,
    joints: str | Sequence[str] | None,
    weights: PlacementWeights | None,
    *,
    seed: int,
    threads: int,
) -> Job:
    """Check what `place_base` and `placement_map` share, and return it made ready; see there."""
    moving = moving_base(pepper)
    sets = task_sets(pepper, tasks)
    start = pepper.neutral() if q0 is None else as_joint_vectors(pepper, q0, "q0")
    if start.ndim != 1:
        raise InvalidValueError("q0", f"shape {start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, start, "q0")
    start = np.clip(start, pepper.lower_limits, pepper.upper_limits)
    held = [name in pepper.joint_names for name in BASE_JOINTS]
    here = moving.states(start, np.zeros((1, 3)))[0]
    if stand is not None:
        place = as_finite(stand, "stand", (3,)).copy()
    elif all(held):
        place = start[[pepper.joint_index(name) for name in BASE_JOINTS]]
    else:
        place = here[moving.base]
    place[2] = wrapped(place[2])
    low, high = moving.robot.lower_limits[moving.base], moving.robot.upper_limits[moving.base]
    if (place < low).any() or (place > high).any():
        raise InvalidValueError("stand", place.tolist(), f"a place within {low.tolist()} and {high.tolist()}")
    mask = moving.movable(movable_joints(pepper, joints))
    if not mask.any():
        raise InvalidValueError("joints", repr(joints), "at least one joint besides the base's")
    if scene is not None:
        from pepper_kin.collision import Scene

        if not isinstance(scene, Scene):
            raise InvalidValueError("scene", repr(scene), "a Scene, or None to leave collisions out")
    scorer = Scorer(moving, sets, mask, start, place, weights or PlacementWeights())
    evaluator = CandidateEvaluator(
        moving, sets, start, moving.names(mask), scorer, scene, whole_number("seed", seed, 0),
        whole_number("threads", threads, 1),
    )  # fmt: skip
    return Job(evaluator, place, mask)
