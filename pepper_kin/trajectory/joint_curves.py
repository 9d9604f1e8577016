"""Curves of several joints by their keys, and their cubic pieces on knots that all share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.splines import shifted
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.key_curve import Key, curve_segments

Part = TypeVar("Part")
_SAME = 1e-9  # [s] knots of two joints that are nearer are one


def checked_parts(quantity: str, parts: Sequence[Part], kind: type[Part]) -> tuple[Part, ...]:
    """Return keys or curves as a tuple; refuse anything else among them."""
    found = tuple(parts)
    for part in found:
        if not isinstance(part, kind):
            raise InvalidValueError(quantity, repr(part), f"a {kind.__name__}")
    return found


@dataclass(frozen=True)
class JointCurve:
    """The keys of one joint, in order of time.

    Attributes:
        joint: Name of the joint.
        keys: One or more.
    """

    joint: str
    keys: tuple[Key, ...]

    def __post_init__(self) -> None:
        """Check the keys.

        Raises:
            InvalidValueError: naming the joint, for no key, or times that do not increase from 0 or later.
        """
        object.__setattr__(self, "keys", checked_parts(f"keys of {self.joint}", self.keys, Key))
        times = [key.time for key in self.keys]
        if not times or times[0] < 0 or any(b <= a for a, b in pairwise(times)):
            raise InvalidValueError(
                f"times of {self.joint}", times[:8], "one or more increasing times, the first 0 or later"
            )


def on_common_knots(
    pepper: PepperModel, curves: Sequence[JointCurve], rest: Array, duration: float
) -> tuple[Array, Array]:
    """Return knots [s], shape (m + 1,), and coefficients of all joints [rad/s^p], shape (m, 4, n).

    Args:
        pepper: The robot.
        curves: Of some of its joints.
        rest: Where curves come from, and the other joints stay [rad or m], shape (n,).
        duration: Time of the last knot [s].
    """
    segments = {
        pepper.joint_index(curve.joint): curve_segments(
            curve.keys, float(rest[pepper.joint_index(curve.joint)]), duration
        )
        for curve in curves
    }
    knots = _merged([breaks for breaks, _ in segments.values()], duration)
    coefficients = np.zeros((knots.size - 1, 4, pepper.n))
    coefficients[:, 0] = rest
    for j, (breaks, powers) in segments.items():
        coefficients[:, :, j] = _on(knots, breaks, powers)
    return knots, coefficients


def _merged(all_breaks: list[Array], duration: float) -> Array:
    """Return the knots of all joints [s], shape (m + 1,), those nearly equal once, from 0 to the duration."""
    knots = np.unique(np.concatenate([[0.0, duration], *all_breaks]))
    keep = np.concatenate([[True], np.diff(knots) > _SAME])
    knots = knots[keep]
    knots[-1] = duration
    return knots


def _on(knots: Array, breaks: Array, powers: Array) -> Array:
    """Return the cubic pieces of one joint on finer knots, shape (m, 4)."""
    middle = (knots[:-1] + knots[1:]) / 2
    segment = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, breaks.size - 2)
    return shifted(powers[segment][..., None], knots[:-1] - breaks[segment])[..., 0]
