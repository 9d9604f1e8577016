"""Motions through key frames: postures at given times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, check_within_limits
from pepper_kin.trajectory.joint_curves import JointCurve, on_common_knots
from pepper_kin.trajectory.key_curve import Key

if TYPE_CHECKING:
    from pepper_kin.trajectory.trajectory import Trajectory

Frame: TypeAlias = str | Mapping[str, ArrayLike] | Sequence[float] | NDArray[np.float64]
"""A posture's name, joints and groups with their positions, or the positions of all joints."""


def from_keyframes(
    kind: type[Trajectory],
    pepper: PepperModel,
    keyframes: Mapping[float, Frame] | Iterable[tuple[float, Frame]],
    start: str | ArrayLike | None,
) -> Trajectory:
    """Return the trajectory of `Trajectory.from_keyframes`, which describes arguments and errors.

    The trajectory is of a `kind`; a start that is not a posture's name has shape (n,) [rad or m].
    """
    frames = _in_order(keyframes)
    keys: dict[str, list[Key]] = {name: [] for name in pepper.joint_names}
    for time, frame in frames:
        q = _position(pepper, frame, f"key frame at {time:.6g} s")
        for name in pepper.resolve_joints(frame) if isinstance(frame, Mapping) else pepper.joint_names:
            keys[name].append(Key(time, float(q[pepper.joint_index(name)])))
    curves = tuple(JointCurve(name, tuple(those)) for name, those in keys.items() if those)
    begin = pepper.neutral() if start is None else _position(pepper, start, "start")
    knots, coefficients = on_common_knots(pepper, curves, begin, frames[-1][0])
    return kind(pepper.joint_names, knots, coefficients, pepper.joint_units)


def _in_order(keyframes: Any) -> list[tuple[float, Frame]]:
    allowed = "time [s] -> frame, or pairs of both, with two or more times that increase from 0 or later"
    try:
        entries = keyframes.items() if isinstance(keyframes, Mapping) else keyframes
        pairs = [(time, frame) for time, frame in entries]
    except (TypeError, ValueError):
        raise InvalidValueError("key frames", repr(keyframes), allowed) from None
    times = [float(as_finite(time, "time of a key frame", ())) for time, _ in pairs]
    if (
        not times
        or times[0] < 0
        or times[-1] == 0
        or any(after <= before for before, after in pairwise(times))
    ):
        raise InvalidValueError("times of key frames", times[:8], allowed)
    return list(zip(times, (frame for _, frame in pairs), strict=True))


def _position(pepper: PepperModel, frame: Any, quantity: str) -> NDArray[np.float64]:
    """Return the joint vector of a frame; where it does not name a joint, the neutral position."""
    if isinstance(frame, str):
        return pepper.posture(frame)
    if isinstance(frame, Mapping) and not frame:
        raise InvalidValueError(quantity, "no joint", "a posture, or at least one joint")
    try:
        q = pepper.joint_vector(frame)
    except InvalidValueError as error:
        raise InvalidValueError(f"{quantity}: {error.quantity}", error.value, error.allowed) from error
    check_within_limits(pepper, q, quantity)
    return q
