"""Result of a check of a robot's dynamics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

FORMS = ("pinocchio", "compiled", "symbolic", "batch")
"""Forms of a quantity: single states by Pinocchio and by machine code, the CasADi function, and its
kernel."""


@dataclass(frozen=True)
class DynamicsCheckRow:
    """One quantity compared with its reference.

    Attributes:
        quantity: Name of the quantity.
        against: Name of the reference.
        limit: Maximum relative error that passes.
        errors: Maximum relative error of each evaluated form of `FORMS`.
        note: Reason why the quantity was not evaluated; else empty.
    """

    quantity: str
    against: str
    limit: float
    errors: dict[str, float]
    note: str = ""

    @property
    def failed_forms(self) -> tuple[str, ...]:
        """Forms whose error is above the limit or NaN."""
        return tuple(form for form, error in self.errors.items() if not error <= self.limit)

    @property
    def success(self) -> bool:
        """Whether no form failed, as in a row that could not be evaluated."""
        return not self.failed_forms


@dataclass(frozen=True)
class DynamicsCheck:
    """Errors of a robot's dynamics, relative to the largest value of each joint over all states.

    Attributes:
        robot: Name of the robot.
        joints: Number of coordinates.
        frame: Frame whose Jacobian was checked.
        states: Number of random states.
        seed: Seed of the random states.
        rows: Results of the checked quantities.
    """

    robot: str
    joints: int
    frame: str
    states: int
    seed: int
    rows: tuple[DynamicsCheckRow, ...]

    @property
    def success(self) -> bool:
        """Whether everything that could be evaluated is within its limit."""
        return all(row.success for row in self.rows)

    @property
    def failures(self) -> tuple[str, ...]:
        """Names of the failures, such as "mass matrix (batch)"."""
        return tuple(f"{row.quantity} ({form})" for row in self.rows for form in row.failed_forms)

    def report(self) -> str:
        """Return a table as text that ends with the verdict."""
        title = (
            f"Dynamics of {self.robot}: {self.joints} joints, {self.states} random states, seed {self.seed}, "
            f"frame {self.frame}"
        )
        heads = ("quantity", *FORMS, "limit", "against")
        lines = [heads, *(self._line(row) for row in self.rows)]
        widths = [max(len(line[k]) for line in lines) for k in range(len(heads))]
        table = [
            "  ".join(
                text.rjust(width) if 0 < k <= len(FORMS) + 1 else text.ljust(width)
                for k, (text, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        ]
        rule = "-" * max(map(len, table))
        notes = [f"{row.quantity}: not evaluated: {row.note}" for row in self.rows if row.note]
        return "\n".join([title, table[0], rule, *table[1:], rule, *notes, self.verdict])

    @property
    def verdict(self) -> str:
        """Verdict in one sentence: all within limits, or the failures."""
        if self.success:
            return "All within the limits (relative errors, largest over joints and states)."
        return f"Beyond the limit: {', '.join(self.failures)}."

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; an error that is not finite becomes None."""
        rows = [
            {
                **vars(row),
                "errors": {form: e if math.isfinite(e) else None for form, e in row.errors.items()},
                "success": row.success,
            }
            for row in self.rows
        ]
        return {**vars(self), "success": self.success, "failures": list(self.failures), "rows": rows}

    def _line(self, row: DynamicsCheckRow) -> tuple[str, ...]:
        """Return the cells of a row; "!" marks a failed form."""
        cells = []
        for form in FORMS:
            mark = " !" if form in row.failed_forms else ""
            cells.append(f"{row.errors[form]:.1e}{mark}" if form in row.errors else "-")
        return (row.quantity, *cells, f"{row.limit:.0e}", row.against)
