"""Joint limits of this library compared with the paper's table 4.

Sekkat et al., Heliyon 2024, table 4: limits read in Choregraphe, the vendor's program, and in the paper's
Gazebo twin, to two decimals.
"""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass
from importlib.resources import files

from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.text_table import text_table

ROUNDING = 0.005
"""Maximum change of a value by rounding to two decimals [rad, or fraction of a hand's opening]."""
SLACK = 1e-9


@dataclass(frozen=True)
class LimitRow:
    """Limits of one joint [rad, or fraction of a hand's opening].

    Attributes:
        joint: Name of the joint.
        ours: Lower and upper limit of this library's model, the published ones to all digits.
        choregraphe: Lower and upper limit in Choregraphe, two decimals.
        gazebo: Lower and upper limit in the paper's twin, two decimals.
        error: Mean absolute error of the two Choregraphe values against ours.
        gazebo_error: Mean absolute error of the two Gazebo values against ours.
        paper_error: Mean absolute error of Gazebo against Choregraphe, the error that the paper prints.
        printed_error: Value that the paper prints for `paper_error`.
        outside: Distance of each Choregraphe value outside this library's range (below zero: inside).
    """

    joint: str
    ours: tuple[float, float]
    choregraphe: tuple[float, float]
    gazebo: tuple[float, float]
    error: float
    gazebo_error: float
    paper_error: float
    printed_error: float
    outside: tuple[float, float]

    @property
    def explained_by_rounding(self) -> tuple[bool, bool]:
        """Whether rounding explains the difference of Choregraphe's lower and upper value from ours."""
        return tuple(abs(value) <= ROUNDING + SLACK for value in self.outside)  # type: ignore[return-value]


@dataclass(frozen=True)
class LimitsTable:
    """Table 4 with this library's limits.

    Attributes:
        rows: Rows of the joints in the order of the paper.
    """

    rows: tuple[LimitRow, ...]

    @property
    def mean_error(self) -> float:
        """Mean of the rows' errors of Choregraphe against ours."""
        return sum(row.error for row in self.rows) / len(self.rows)

    @property
    def mean_gazebo_error(self) -> float:
        """Mean of the rows' errors of the paper's twin against ours."""
        return sum(row.gazebo_error for row in self.rows) / len(self.rows)

    def to_dict(self) -> dict[str, object]:
        """Return everything as plain values for JSON."""
        rows = [{**asdict(row), "explained_by_rounding": row.explained_by_rounding} for row in self.rows]
        return {"rows": rows, "mean_error": self.mean_error, "mean_gazebo_error": self.mean_gazebo_error}

    def report(self) -> str:
        """Return the table and the conclusions as text."""
        head = (
            "limits [rad]", "ours", "Choregraphe", "Gazebo", "MAE Choregraphe", "MAE Gazebo", "outside by",
        )  # fmt: skip
        rows = [
            (
                row.joint, f"{row.ours[0]:.6f} {row.ours[1]:.6f}",
                f"{row.choregraphe[0]:.2f} {row.choregraphe[1]:.2f}",
                f"{row.gazebo[0]:.2f} {row.gazebo[1]:.2f}", f"{row.error:.4f}", f"{row.gazebo_error:.4f}",
                " ".join(f"{value:+.4f}" for value in row.outside),
            )
            for row in self.rows
        ]  # fmt: skip
        values = [value for row in self.rows for value in row.outside]
        unexplained = [value for value in values if abs(value) > ROUNDING + SLACK]
        beyond = [
            f"{row.joint} {end}"
            for row in self.rows
            for end, value in zip(("lower", "upper"), row.outside, strict=True)
            if value > ROUNDING + SLACK
        ]
        lines = [
            "Joint limits [rad; hands: share of the opening] beside table 4 of Sekkat et al. 2024",
            "",
            *text_table(head, rows),
            "",
            f"mean absolute error of Choregraphe against ours  {self.mean_error:.4f} rad",
            f"mean absolute error of Gazebo against ours       {self.mean_gazebo_error:.4f} rad",
            "",
            "outside by: how far Choregraphe's value lies beyond our limit (negative: within it).",
            f"{len(unexplained)} of Choregraphe's {len(values)} values differ by more than the {ROUNDING} "
            "rad that rounding to two decimals can explain:",
            f"{len(unexplained) - len(beyond)} lie within our range, by up to {-min(values):.4f} rad;",
            f"{len(beyond)} lie beyond it, by up to {max(values):.4f} rad: {', '.join(beyond)}.",
            "The Gazebo values are ours rounded to two decimals: the same source, not a second measurement."
            if all(row.gazebo_error <= ROUNDING + SLACK for row in self.rows)
            else "The Gazebo values differ from ours by more than rounding.",
        ]
        return "\n".join(lines)


def limits_table(pepper: PepperModel | None = None) -> LimitsTable:
    """Return the joint limits of this library's model with the paper's table 4.

    Args:
        pepper: A Pepper with moving hands; None loads it.

    Raises:
        UnknownNameError: if the robot lacks a joint of the table.
    """
    pepper = load_pepper(hands="mimic") if pepper is None else pepper
    text = (files("pepper_kin.paper") / "data" / "table4.csv").read_text(encoding="utf-8")
    rows = []
    for line in csv.DictReader(text.splitlines()):
        index = pepper.joint_index(line["joint"])
        ours = float(pepper.lower_limits[index]), float(pepper.upper_limits[index])
        vendor = float(line["choregraphe_lower"]), float(line["choregraphe_upper"])
        twin = float(line["gazebo_lower"]), float(line["gazebo_upper"])
        rows.append(
            LimitRow(
                joint=line["joint"],
                ours=ours,
                choregraphe=vendor,
                gazebo=twin,
                error=_mean_error(vendor, ours),
                gazebo_error=_mean_error(twin, ours),
                paper_error=_mean_error(twin, vendor),
                printed_error=float(line["printed_mae"]),
                outside=(ours[0] - vendor[0], vendor[1] - ours[1]),
            )
        )
    return LimitsTable(tuple(rows))


def _mean_error(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the mean absolute difference of two pairs of limits."""
    return (abs(a[0] - b[0]) + abs(a[1] - b[1])) / 2
