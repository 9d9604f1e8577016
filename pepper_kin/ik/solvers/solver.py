"""Interface of an inverse-kinematics solver."""

from __future__ import annotations

from abc import ABC, abstractmethod

from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.problem import SearchBudget
from pepper_kin.ik.result import SearchResult
from pepper_kin.ik.tasks.task import Array


class TaskSolver(ABC):
    """Searches for configurations that fulfill the tasks of one `Problem`."""

    @abstractmethod
    def search(self, collisions: Collisions, budget: SearchBudget) -> SearchResult:
        """Return the outcome of a search from q0 and further starts.

        Args:
            collisions: What may not touch.
            budget: How much to search.
        """

    @abstractmethod
    def descend(self, start: Array, collisions: Collisions, budget: SearchBudget, *, clear: bool) -> Array:
        """Return where a descent from a start ends, shape (n,) [rad or m], within the bounds.

        Args:
            start: Joint positions, shape (n,) [rad or m].
            collisions: What may not touch.
            budget: Its steps and deadline count.
            clear: Whether to keep clear of collisions; the start has to be free.
        """
