"""What a solver has to offer: the best step from a configuration."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from pepper_kin.ik.tasks.task import Array

# Largest change of one joint in one step [rad or m]: beyond it the linear model says little.
STEP_BOUND = 0.6


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
    """Solves the differential quadratic programme of one problem, again and again.

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
            residuals: The tasks' residuals at q.
            reference: q_ref [rad or m], shape (n,).
            damping: lambda.
            half_spaces: More inequalities, if any.

        Returns:
            dq [rad or m], shape (n,), zero at joints that may not move; None where the programme has no
            solution.
        """
