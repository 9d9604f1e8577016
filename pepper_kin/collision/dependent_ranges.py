"""Neighboring bodies that capsules cannot tell apart: where one joint's free range depends on another.

The capsules of pelvis and trunk, trunk and head, upper arm and forearm overlap in postures in which the
bodies are well apart.  For these pairs the free interval of one joint is tabulated against the other,
computed from the surfaces in steps of 0.01 rad (the tighter side of left and right is kept for both).
Between two rows the intersection of both intervals holds, so that no contact is missed for want of a row.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.model import PepperModel, kept_for_robot

REASON = "DependentRange"


@dataclass(frozen=True, eq=False)
class DependentRange(FrozenArrays):
    """The free interval of one joint against another's position.

    Attributes:
        links: The two links that would touch.
        first: Place of the first joint in the joint vector.
        second: Place of the joint whose range depends on it.
        positions: (k,) positions of the first joint, rising [rad].
        lower: (k,) least free position of the second joint [rad], -inf where its own limit comes first.
        upper: (k,) greatest free position of the second joint [rad]; below `lower` where none is free.
    """

    links: tuple[str, str]
    first: int
    second: int
    positions: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]

    def violated(self, q: NDArray[np.float64], margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether the links touch, shape (...,), at joint positions q, shape (..., n) [rad].

        Args:
            q: Joint positions.
            margin: Angle that the second joint keeps from a contact [rad].
        """
        x, y = q[..., self.first], q[..., self.second]
        last = len(self.positions) - 1
        below = np.clip(np.searchsorted(self.positions, x, side="right") - 1, 0, last)
        above = np.clip(np.searchsorted(self.positions, x, side="left"), 0, last)
        lower = np.maximum(self.lower[below], self.lower[above])
        upper = np.minimum(self.upper[below], self.upper[above])
        return np.asarray((y < lower + margin) | (y > upper - margin))


@kept_for_robot(most=32)
def dependent_ranges(pepper: PepperModel) -> tuple[DependentRange, ...]:
    """Return the ranges that replace the collision check of `pepper`'s pairs marked "DependentRange"."""
    marked = {pair for pair, reason in pepper.semantics.disabled_pairs.items() if reason == REASON}
    if not marked:
        return ()
    text = (files("pepper_kin.urdf") / "data" / "anti_collision.csv").read_text(encoding="utf-8")
    rows: dict[tuple[str, str, str, str], list[tuple[float, float, float]]] = {}
    for row in csv.DictReader(text.splitlines()):
        a, b = row["link_pair"].split("-")
        key = (a, b, row["joint_1"], row["joint_2"])
        values = (row["value_1_rad"], row["joint_2_free_min_rad"], row["joint_2_free_max_rad"])
        rows.setdefault(key, []).append((float(values[0]), float(values[1]), float(values[2])))
    ranges = []
    for (a, b, first, second), table in rows.items():
        if (min(a, b), max(a, b)) not in marked:
            continue
        positions, lower, upper = (read_only(column) for column in np.array(sorted(table)).T)
        places = pepper.joint_index(first), pepper.joint_index(second)
        ranges.append(DependentRange((a, b), *places, positions, lower, upper))
    return tuple(ranges)
