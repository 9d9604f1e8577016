"""Search of motions from rest to rest in time slices, one in each cycle of a control loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import PepperKinError
from pepper_kin.model import PepperModel
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.motion.goals import ends_of
from pepper_kin.motion.plan_request import PlanOptions, PlanRequest, moves_base
from pepper_kin.motion.plan_result import Plan
from pepper_kin.motion.planning import path_found
from pepper_kin.planners.compiled import PausedClock, Slices
from pepper_kin.trajectory import Trajectory, retime

MOST_SLICES, LONGEST = 20, 0.3
"""Maximum number of slices, and maximum time [s], of a search."""


class SlicedSearch:
    """Time-sliced search of one motion: a path by the search of `plan`, and its timing.

    Args:
        pepper: The robot, whose limits are kept.
        margin: Requested distance to all bodies [m].
        budget: Time of a slice [s].
        limits: Options `torque`, `torque_scale` and `balance` of `retime`.
    """

    def __init__(self, pepper: PepperModel, margin: float, budget: float, limits: dict[str, Any]) -> None:
        self._pepper, self._margin, self._budget, self._limits = pepper, margin, budget, limits
        self._clock = PausedClock()
        self._slices: Slices[Trajectory | None] | None = None

    @property
    def running(self) -> bool:
        """Whether there is a search that has not ended."""
        return self._slices is not None

    def begin(self, start: Array, goal: Array, scene: Scene, seed: int) -> None:
        """Begin a search in place of the current one; `go_on` does the work.

        With an odd seed, all joints except the base's may move, not only joints in which the ends differ.

        Args:
            start: Start configuration [rad or m], shape (n,).
            goal: Goal configuration [rad or m], shape (n,).
            scene: The world.
            seed: Seed of all random choices.
        """
        self._slices = self._search(start, goal, scene, seed)

    def go_on(self) -> Trajectory | None:
        """Search for one slice of time; return the motion, or None if none is found or the search goes on."""
        assert self._slices is not None
        self._clock.resume(self._budget)
        try:
            next(self._slices)
        except StopIteration as end:
            self._slices = None
            found: Trajectory | None = end.value
            return found
        finally:
            self._clock.pause()
        return None

    def _search(self, start: Array, goal: Array, scene: Scene, seed: int) -> Slices[Trajectory | None]:
        """Return a motion, or None if none is found; pause at the end of each slice."""
        free = [name for name in self._pepper.joint_names if name not in BASE_JOINTS]
        options = PlanOptions(
            margin=self._margin, seed=seed, timeout=min(MOST_SLICES * self._budget, LONGEST),
            joints=free if seed % 2 else None, balance=self._limits["balance"],
            torque_scale=self._limits["torque_scale"],
        )  # fmt: skip
        try:
            request = PlanRequest(self._pepper, start, goal, scene, options).checked(now=self._clock.now)
            if not request.checks.free(np.stack([start, goal])).all():
                return None  # `ends_of` would take long to find the reason
            ends = ends_of(request)
            if isinstance(ends, Plan) or moves_base(self._pepper, ends.free):
                return None
            found = yield from path_found(request, ends, self._clock)
            if found.way is None:
                return None
            if self._clock.left <= 0.0:
                yield
            return retime(self._pepper, found.way.curve, **self._limits)
        except PepperKinError:
            return None
