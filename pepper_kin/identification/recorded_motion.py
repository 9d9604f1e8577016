"""Preparation of a recording for least squares: filtered motion and torques, and the solution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.identification.base_parameters import torque_columns
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.twin.run import Run

ndimage, signal, stats = (lazy_module(f"scipy.{name}") for name in ("ndimage", "signal", "stats"))

CUTOFF = 8.0
"""Cutoff of the low-pass filter of positions, torques and regressors [Hz]."""
_ORDER = 4  # order of the filter, which is applied forward and backward
_EDGE = 1.0  # time that is omitted at either end, where the filter settles, in units of 1 / cutoff
_PER_BLOCK = 1.0  # length of a block of residuals x cutoff, twice their correlation time
_LONG = 4.0  # ratio of long blocks, over which also encoder steps are uncorrelated, to usual blocks
_AROUND = 0.8  # time before and after a reversal in which friction columns are wrong, in units of 1 / cutoff
_SLOW = 0.05  # ratio of a joint's maximum speed below which its direction is uncertain
_HUBER, _ROUNDS = 2.0, 6
_STATES = 512  # maximum number of states whose regressor is in memory at a time


class RecordedMotion(NamedTuple):
    """A recording, filtered.

    Attributes:
        pepper: The robot.
        names: Names of the k joints.
        moving: Indices of the joints.
        step: Time between states [s].
        cutoff: Cutoff of the filter [Hz].
        position: Positions [rad or m], shape (T, n).
        velocity: Velocities [rad/s or m/s], shape (T, n).
        acceleration: Accelerations [rad/s^2 or m/s^2], shape (T, n).
        torque: Filtered torques of the joints [N m or N], shape (T, k).
    """

    pepper: PepperModel
    names: tuple[str, ...]
    moving: list[int]
    step: float
    cutoff: float
    position: Array
    velocity: Array
    acceleration: Array
    torque: Array

    def filter(self, values: Array) -> Array:
        """Return filtered values over time, shape (T, ...)."""
        return _low_pass(values, self.step, self.cutoff)

    def regressor(self, of: Array) -> Array:
        """Return `torque_columns` times a matrix, shape (10 bodies + k, p), filtered, shape (T, k, p)."""
        found = np.empty((len(self.position), len(self.moving), of.shape[1]))
        for begin in range(0, len(found), _STATES):  # the whole regressor may need gigabytes
            part = slice(begin, begin + _STATES)
            state = self.position[part], self.velocity[part], self.acceleration[part]
            found[part] = torque_columns(self.pepper, self.moving, *state) @ of
        return self.filter(found)

    @property
    def friction(self) -> Array:
        """Columns of viscous and Coulomb friction of each joint, filtered, shape (T, k, 2 k)."""
        speed = self.velocity[:, None, self.moving]
        return self.filter(
            np.concatenate([np.eye(len(self.moving)) * one for one in (speed, np.sign(speed))], axis=2)
        )

    @property
    def slowest(self) -> Array:
        """Minimum speed of each joint at which its direction is certain, shape (k,)."""
        return np.asarray(_SLOW * np.abs(self.velocity[:, self.moving]).max(axis=0))

    @property
    def sliding(self) -> NDArray[np.bool_]:
        """Mask of the times at which each joint's direction is certain, away from reversals, shape (T, k).

        At a reversal a joint sticks for a while, and the filter spreads the effect over its width: the
        columns of Coulomb friction are wrong there.

        Raises:
            InvalidValueError: for a joint whose direction is never certain for that long.
        """
        speed = self.velocity[:, self.moving]
        slow = np.abs(speed) < self.slowest
        slow[1:] |= speed[1:] * speed[:-1] < 0.0
        around = int(_AROUND / (self.cutoff * self.step))
        found = ~ndimage.maximum_filter1d(slow, 2 * around + 1, axis=0)
        for name, ever in zip(self.names, found.any(axis=0), strict=True):
            if not ever:
                longer = f"motion one way for over {2 * _AROUND / self.cutoff:.2g} s, or a higher cutoff"
                raise InvalidValueError("recording", f"{name} turns around all the time", longer)
        return np.asarray(found)


def recorded_motion(pepper: PepperModel, run: Run, names: tuple[str, ...], cutoff: float) -> RecordedMotion:
    """Return a recording, filtered.

    The torque of a run acts during the step that ends at its time, so states are at the middle of steps.

    Raises:
        InvalidValueError: for other joints, uneven times, too few of them, joints that do not move, or a
            cutoff that the rate does not allow.
    """
    if run.joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the recording", ", ".join(run.joint_names), ", ".join(pepper.joint_names)
        )
    steps = np.diff(run.time)
    if not (steps.size and np.allclose(steps, steps[0], rtol=1e-3, atol=0.0)):
        raise InvalidValueError("time", "uneven steps", "times of the recording in equal steps")
    step, moving = float(np.mean(steps)), [pepper.joint_index(name) for name in names]
    if not check_positive("cutoff", cutoff, "Hz") < 0.4 / step:
        raise InvalidValueError("cutoff", f"{cutoff:g} Hz", f"below {0.4 / step:.4g} Hz, 0.4 of the rate")
    if run.duration * cutoff < 20 * _PER_BLOCK:
        raise InvalidValueError("duration", f"{run.duration:g} s", f"at least {20 * _PER_BLOCK / cutoff:g} s")
    for name, still in zip(names, np.ptp(run.position[:, moving], axis=0) == 0, strict=True):
        if still:
            raise InvalidValueError("recording", f"{name} does not move", "motion of all joints")
    position = _low_pass(0.5 * (run.position[1:] + run.position[:-1]), step, cutoff)
    velocity = np.gradient(position, step, axis=0)
    acceleration = np.gradient(velocity, step, axis=0)
    torque = _low_pass(run.torque[1:, moving], step, cutoff)
    return RecordedMotion(pepper, names, moving, step, cutoff, position, velocity, acceleration, torque)


def _low_pass(values: Array, step: float, cutoff: float) -> Array:
    sections = signal.butter(_ORDER, cutoff, fs=1.0 / step, output="sos")
    return np.asarray(signal.sosfiltfilt(sections, values, axis=0))


class Solution(NamedTuple):
    """Parameters by least squares.

    Attributes:
        values: Values of the parameters, shape (p,).
        covariance: Covariance of their errors, shape (p, p).
        quantile: Half the width of a 95 % interval over the standard deviation.
        residual: Root mean square residual of each column of the targets, shape (k,).
    """

    values: Array
    covariance: Array
    quantile: float
    residual: Array

    @property
    def intervals(self) -> Array:
        """95 % intervals, shape (p, 2)."""
        half = self.quantile * np.sqrt(np.diag(self.covariance))
        return np.asarray(np.column_stack([self.values - half, self.values + half]))


def solve(
    data: RecordedMotion,
    columns: Array,
    target: Array,
    counts: NDArray[np.bool_],
    *,
    long_blocks: bool = False,
) -> Solution:
    """Return x of columns x = target by weighted least squares, robust against outliers (Huber).

    Rows of a joint are divided by the spread of its residuals.  Residuals are correlated in time, so their
    covariance is computed from sums over blocks (Liang and Zeger, Biometrika 73, 1986), with H = sum_b H_b
    and s_b the sum of block b,

        C = H^-1 sum_b s_b s_b^T H^-1 B / (B - p).

    Long blocks are few, and each biases the solution towards itself; s_b becomes (1 - H_b H^-1)^-1 s_b, which
    excludes the block, and the last factor (B - 1) / B (the jackknife; Bell and McCaffrey, Survey
    Methodology 28, 2002).

    Args:
        data: The recording.
        columns: Columns of the least-squares problem, shape (T, k, p).
        target: Right-hand side, such as torques [N m or N], shape (T, k).
        counts: Which rows count, shape (T, k).
        long_blocks: Whether blocks are as long as a sufficient number allows, up to `_LONG` times the usual.

    Raises:
        InvalidValueError: for a recording with too few blocks for so many parameters.
    """
    edge = int(_EDGE / (data.cutoff * data.step))
    columns, target, counts = columns[edge:-edge], target[edge:-edge], counts[edge:-edge]
    p = columns.shape[2]
    length = max(int(_PER_BLOCK / (data.cutoff * data.step)), 1)
    if long_blocks:
        length = max(min(int(_LONG * length), len(target) // (p + 8)), length)
    blocks = len(target) // length
    if blocks < p + 8:
        needed = ((p + 8) * _PER_BLOCK + 2 * _EDGE) / data.cutoff
        raise InvalidValueError(
            "duration", f"{len(target) * data.step:.3g} s", f"at least {needed:.3g} s for {p} parameters"
        )
    counts = counts[: blocks * length]
    columns, target = columns[: blocks * length] * counts[..., None], target[: blocks * length] * counts
    scale = np.sqrt(np.mean(columns**2, axis=(0, 1))) + 1e-300
    weight, values, left = np.ones_like(target), np.zeros(p), target
    for _ in range(_ROUNDS):
        rows = columns * (np.sqrt(weight)[..., None] / scale)
        values = np.linalg.lstsq(rows.reshape(-1, p), (np.sqrt(weight) * target).ravel(), rcond=None)[0]
        values = values / scale
        left = target - columns @ values
        spread = 1.4826 * np.nanmedian(np.where(counts, np.abs(left), np.nan), axis=0) + 1e-12
        weight = np.minimum(1.0, _HUBER * spread / (np.abs(left) + 1e-300)) / spread**2
    weighted = columns * weight[..., None]
    inverse = np.linalg.pinv(np.einsum("tkp,tkq->pq", weighted / scale, columns / scale), hermitian=True)
    scores = np.einsum("tkp,tk->tp", weighted / scale, left).reshape(blocks, length, p).sum(axis=1)
    used, share = blocks, blocks / (blocks - p)
    if long_blocks:
        own = np.einsum("tkp,tkq->tpq", weighted / scale, columns / scale).reshape(blocks, length, p, p)
        without = np.eye(p) - own.sum(axis=1) @ inverse
        scores = np.einsum("bpq,bq->bp", np.linalg.pinv(without), scores)
        used = max(int(counts.reshape(blocks, -1).any(axis=1).sum()), p + 1)
        share = (used - 1) / used
    covariance = inverse @ (scores.T @ scores) @ inverse * share
    return Solution(
        values,
        covariance / np.outer(scale, scale),
        float(stats.t.ppf(0.975, used - p)),
        np.sqrt(np.sum(left**2, axis=0) / np.count_nonzero(counts, axis=0)),
    )
