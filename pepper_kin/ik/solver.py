"""Interfaces of an inverse-kinematics solver, and of one that gives steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from pepper_kin.arrays import Array
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.problem import SearchBudget
from pepper_kin.ik.result import SearchResult


class TaskSolver(ABC):
    """Searches for configurations that fulfill the tasks of one `TaskProblem`."""

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


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """Linear inequalities that a step has to keep: normals dq <= offsets.

    Attributes:
        normals: Shape (k, n).
        offsets: Shape (k,).
    """

    normals: Array
    offsets: Array


class StepSolver(ABC):
    """Solves the differential quadratic program of one problem, again and again.

    min over dq of |W (J dq + r)|^2 + lambda |diag(d) dq|^2 + eps^2 |q + dq - q_ref|^2
    subject to  lower <= q + dq <= upper,  |dq_i| <= STEP_BOUND,  normals dq <= offsets
    """

    @abstractmethod
    def step(
        self,
        q: Array,
        residuals: Sequence[Array],
        reference: Array,
        damping: float,
        half_spaces: HalfSpaces | None = None,
    ) -> Array | None:
        """Return the step dq.

        Args:
            q: Joint positions within the bounds [rad or m], shape (n,).
            residuals: The tasks' residuals at q, shape (m,) each, with m of the task.
            reference: q_ref [rad or m], shape (n,).
            damping: lambda.
            half_spaces: More inequalities, if any.

        Returns:
            dq [rad or m], shape (n,), zero at joints that may not move; None where the program has no
            solution.
        """
