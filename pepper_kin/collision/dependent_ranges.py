"""Joint ranges that depend on another joint, for adjacent bodies whose capsules overlap.

The capsules of pelvis and trunk, trunk and head, upper arm and forearm overlap in postures in which the
bodies are well separated.  For these pairs the free interval of one joint is tabulated against the other.
Between two rows the intersection of both intervals applies, so that no contact is missed between rows.

Rows whose source is "surfaces" were computed from the measured surfaces in steps of 0.01 rad (the tighter
side of left and right is used for both).  Rows whose source is "robot" are from positions at which a robot's
head stopped, for yaws of 45 degrees and more: lines through the stops, a row for each degree, `STOP_SPARE`
above them.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.model import PepperModel, kept_for_robot

REASON = "DependentRange"
STOP_SPARE = 0.015
"""Distance of rows of the source "robot" beyond the position at which the joint stopped [rad]: measured and
commanded positions of a settled joint differ by 0.005 in the median, which is 0.015 at two standard
deviations of a normal error."""


@dataclass(frozen=True, eq=False)
class DependentRange(FrozenArrays):
    """Free interval of one joint as a function of another joint's position.

    Attributes:
        links: The two links that would touch.
        first: Index of the first joint in the joint vector.
        second: Index of the joint whose range depends on the first.
        positions: (k,) positions of the first joint, ascending [rad].
        lower: (k,) minimum free position of the second joint [rad], -inf where its own limit comes first.
        upper: (k,) maximum free position of the second joint [rad]; below `lower` where none is free.
        sources: (k,) source of each row: "surfaces" or "robot".
    """

    links: tuple[str, str]
    first: int
    second: int
    positions: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    sources: tuple[str, ...]

    def interval(self, x: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the minimum and maximum free position of the second joint [rad], shape (...,) each.

        Args:
            x: Positions of the first joint [rad], shape (...,).
        """
        place = self.positions.searchsorted(x, side="right") + self.positions.searchsorted(x, side="left")
        lower, upper = self._steps
        return lower[place], upper[place]

    @cached_property
    def _steps(self) -> NDArray[np.float64]:
        """Bounds before, at and after each position, in pairs, shape (2, 2 k + 1)."""
        places = np.arange(2 * len(self.positions) + 1)
        below, above = np.maximum(places - 1, 0) // 2, np.minimum(places // 2, len(self.positions) - 1)
        lower = np.maximum(self.lower[below], self.lower[above])
        return np.stack([lower, np.minimum(self.upper[below], self.upper[above])])

    def violated(self, q: NDArray[np.float64], margin: float = 0.0) -> NDArray[np.bool_]:
        """Return whether the links touch, shape (...,), at joint positions q, shape (..., n) [rad].

        Args:
            q: Joint positions.
            margin: Angle that the second joint keeps from a contact [rad].
        """
        lower, upper = self.interval(q[..., self.first])
        y = q[..., self.second]
        return np.asarray((y < lower + margin) | (y > upper - margin))


@kept_for_robot(most=32)
def dependent_ranges(pepper: PepperModel) -> tuple[DependentRange, ...]:
    """Return the ranges that replace the collision check of `pepper`'s pairs marked "DependentRange"."""
    marked = {pair for pair, reason in pepper.semantics.disabled_pairs.items() if reason == REASON}
    if not marked:
        return ()
    text = (files("pepper_kin.urdf") / "data" / "anti_collision.csv").read_text(encoding="utf-8")
    rows: dict[tuple[str, str, str, str], list[tuple[float, float, float, str]]] = {}
    for row in csv.DictReader(text.splitlines()):
        a, b = row["link_pair"].split("-")
        key = (a, b, row["joint_1"], row["joint_2"])
        values = (row["value_1_rad"], row["joint_2_free_min_rad"], row["joint_2_free_max_rad"])
        rows.setdefault(key, []).append((float(values[0]), float(values[1]), float(values[2]), row["source"]))
    ranges = []
    for (a, b, first, second), table in rows.items():
        if (min(a, b), max(a, b)) not in marked:
            continue
        *numbers, sources = zip(*sorted(table), strict=True)
        positions, lower, upper = (read_only(column) for column in np.array(numbers))
        places = pepper.joint_index(first), pepper.joint_index(second)
        ranges.append(DependentRange((a, b), *places, positions, lower, upper, sources))
    return tuple(ranges)
