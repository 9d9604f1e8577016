"""The three movements of the paper's table 5."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import UnknownNameError

GESTURES = ("left-arm", "right-arm", "head")
"""Names of the gestures of the paper's table 5, for `paper_gesture`."""
FRAMES = ("T0", "T1", "T2", "T3", "T4")
COLUMNS = ("plan", "gazebo", "choregraphe", "reality")


@dataclass(frozen=True, eq=False)
class PaperGesture(FrozenArrays):
    """One movement of table 5 of Sekkat et al., Heliyon (2024); arrays are read-only.

    Attributes:
        name: "left-arm", "right-arm" or "head".
        joint_names: Names of the moved joints.
        printed_labels: Labels of the joints in the paper.
        plan: Keyframes planned in RViz2 [rad], shape (5, k).
        gazebo: Positions in Gazebo [rad], shape (5, k).
        choregraphe: Positions in Choregraphe [rad], shape (5, k).
        reality: Positions of the paper's robot [rad], shape (5, k).
    """

    name: str
    joint_names: tuple[str, ...]
    printed_labels: tuple[str, ...]
    plan: Array
    gazebo: Array
    choregraphe: Array
    reality: Array

    def paper_error(self, column: str) -> Array:
        """Return the mean absolute difference of a column from the plan for each joint [rad], shape (k,).

        Raises:
            UnknownNameError: for a column that the table lacks.
        """
        if column not in COLUMNS:
            raise UnknownNameError("column of table 5", column, COLUMNS)
        return np.abs(getattr(self, column) - self.plan).mean(axis=0)


def paper_gesture(name: str) -> PaperGesture:
    """Return a movement of the paper's table 5.

    Args:
        name: "left-arm", "right-arm" or "head".

    Returns:
        The movement.

    Raises:
        UnknownNameError: for another name.
    """
    if name not in GESTURES:
        raise UnknownNameError("gesture", name, GESTURES)
    return _table()[name]


@cache
def _table() -> dict[str, PaperGesture]:
    """Return the gestures of `data/table5.csv` by name."""
    text = (files("pepper_kin.paper") / "data" / "table5.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    table = {}
    for name in GESTURES:
        mine = [row for row in rows if row["gesture"] == name]
        joints = tuple(dict.fromkeys(row["joint"] for row in mine))
        labels = tuple(row["printed_label"] for row in mine if row["column"] == "plan")
        values = {}
        for column in COLUMNS:
            per_joint = {row["joint"]: row for row in mine if row["column"] == column}
            values[column] = read_only(
                [[float(per_joint[joint][frame]) for joint in joints] for frame in FRAMES]
            )
        table[name] = PaperGesture(name, joints, labels, **values)
    return table


def paper_inconsistencies() -> tuple[str, ...]:
    """Return sentences on the inconsistencies of table 5, counted from its numbers."""
    table = _table().values()
    same = sum(int(np.sum(g.reality == g.choregraphe)) for g in table)
    total = sum(g.plan.size for g in table)
    steps = sorted({float(d) for g in table for d in np.round(np.abs(g.gazebo - g.plan), 6).ravel()})
    wrong = [
        f"{label} for {joint}"
        for g in table
        for label, joint in zip(g.printed_labels, g.joint_names, strict=True)
        if label[0].upper() in "LR" and label[0].upper() != joint[0]
    ]
    return (
        f"The paper prints {len(wrong)} right-arm rows with left labels ({', '.join(wrong)}); their signs "
        "fit the right arm's limits only.",
        f"Its column Reality equals its column Choregraphe in {same} of {total} numbers.",
        f"Its column Gazebo differs from the plan by exactly {' or '.join(f'{d:g}' for d in steps)} rad "
        f"in all {total} numbers.",
        "Its T0 of 0.00 rad for ShoulderRoll and ElbowRoll lies outside these joints' one-sided ranges.",
    )
