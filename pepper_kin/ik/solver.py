"""Interfaces of an inverse-kinematics solver and of a solver of single steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from pepper_kin.arrays import Array
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.problem import SearchBudget
from pepper_kin.ik.result import SearchResult


class TaskSolver(ABC):
    """Search for configurations that fulfill the tasks of one `TaskProblem`."""

    @abstractmethod
    def search(self, collisions: Collisions, budget: SearchBudget) -> SearchResult:
        """Return the outcome of a search from q0 and further starts.

        Args:
            collisions: Collision checks.
            budget: Limits of the search.
        """

    @abstractmethod
    def descend(self, start: Array, collisions: Collisions, budget: SearchBudget, *, clear: bool) -> Array:
        """Return the end of a descent from a start, shape (n,) [rad or m], within the bounds.

        Args:
            start: Joint positions, shape (n,) [rad or m].
            collisions: Collision checks.
            budget: Number of steps and deadline.
            clear: Whether to keep clear of collisions; the start has to be free.
        """


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """Linear inequalities on a step: normals dq <= offsets.

    Attributes:
        normals: Normals of the half-spaces, shape (k, n).
        offsets: Right-hand sides, shape (k,).
    """

    normals: Array
    offsets: Array


class StepSolver(ABC):
    """Solver of the differential quadratic program of one problem, for repeated steps.

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
            residuals: Residual of each task at q, shape (m_i,).
            reference: q_ref [rad or m], shape (n,).
            damping: lambda.
            half_spaces: Further inequalities, or None.

        Returns:
            dq [rad or m], shape (n,), zero at joints that may not move; None where the program has no
            solution.
        """
