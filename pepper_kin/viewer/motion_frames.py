"""The frames of a recorded motion: poses reduced to a frame rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.poses import quaternions_of
from pepper_kin.viewer.drawable import rigid_transforms


@dataclass(frozen=True)
class Curve:
    """A curve to plot with a motion.

    Attributes:
        values: Value at each sample, shape (T,).
        limit: Largest allowed magnitude, in the curve's unit; None for no limit.
        ghost: Values of a second robot, shape (T,), or None.
        command: Commanded values, shape (T,), or None.
    """

    values: ArrayLike
    limit: float | None = None
    ghost: ArrayLike | None = None
    command: ArrayLike | None = None


@dataclass(frozen=True)
class SampledSeries:
    """A curve to plot with a motion, reduced to its frames without losing peaks.

    Attributes:
        name: Name of the curve, with its unit.
        value: Value at each frame, shape (F,).
        low: Minimum of the values nearer to the frame than to its neighbors, shape (F,).
        high: Maximum of the values nearer to the frame than to its neighbors, shape (F,).
        limit: Largest allowed magnitude, in the curve's unit; None for no limit.
        ghost: Value of a second robot at each frame, shape (F,), or None.
        command: Commanded value at each frame, shape (F,), or None.
    """

    name: str
    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    limit: float | None = None
    ghost: NDArray[np.float64] | None = None
    command: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class MotionFrames:
    """Frames of a motion.

    Attributes:
        times: Time of each frame, shape (F,), increasing [s].
        positions: Origin of each link in the world, shape (F, L, 3) [m].
        quaternions_xyzw: Orientation of each link in the world, shape (F, L, 4), continuous in time.
        series: Curves to plot with the motion.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    quaternions_xyzw: NDArray[np.float64]
    series: tuple[SampledSeries, ...]


def limited_series(series: Mapping[str, ArrayLike], limits: Mapping[str, float]) -> dict[str, Curve]:
    """Return curves with their limits.

    Args:
        series: Name of a curve (with unit) -> values of shape (T,).
        limits: Name of a curve -> largest allowed magnitude.

    Raises:
        UnknownNameError: for a limit of an unknown curve.
        InvalidValueError: for a limit that is not above 0 and finite.
    """
    for name, limit in limits.items():
        if name not in series:
            raise UnknownNameError("curve", name, series)
        if not (np.isfinite(limit) and limit > 0):
            raise InvalidValueError(f"limit of {name!r}", limit, "a finite number above 0")
    return {
        name: Curve(values, float(limits[name]) if name in limits else None)
        for name, values in series.items()
    }


def motion_frames(
    times: ArrayLike,
    link_poses: ArrayLike,
    link_count: int,
    series: Mapping[str, Curve],
    fps: float,
) -> MotionFrames:
    """Check a motion and reduce it to at most `fps` samples per second, with the first and the last.

    Args:
        times: Sample times, shape (T,), strictly increasing [s].
        link_poses: Transforms from link to world, shape (T, L, 4, 4) [m].
        link_count: Number of links L.
        series: Name of a curve (with unit) -> curve to plot.
        fps: Maximum frames per second to keep.

    Returns:
        The frames.

    Raises:
        InvalidValueError: Wrong shapes, times that do not increase, NaN or infinite values, transforms that
            are not rigid, or `fps` not positive.
    """
    kept = kept_samples(times, fps)
    samples = np.asarray(times).size
    poses = rigid_transforms("link_poses", link_poses, (samples, link_count, 4, 4))
    return frames_of_samples(times, kept, poses[kept], link_count, series)


def kept_samples(times: ArrayLike, fps: float) -> NDArray[np.intp]:
    """Select the samples nearest to a regular grid, each once, with the first and the last.

    Frames are samples of the motion, not interpolations, so every shown state was really computed.

    Args:
        times: Sample times, shape (T,), strictly increasing [s].
        fps: Maximum frames per second.

    Returns:
        Indices of the samples, shape (F,), increasing.

    Raises:
        InvalidValueError: Times that do not increase or are not finite, or `fps` not positive.
    """
    sample_times = _checked_times(times)
    if not (np.isfinite(fps) and fps > 0):
        raise InvalidValueError("fps", fps, "a positive number of frames per second")
    wanted = int(np.ceil((sample_times[-1] - sample_times[0]) * fps - 1e-9)) + 1
    if wanted >= sample_times.size:
        return np.arange(sample_times.size)
    grid = np.linspace(sample_times[0], sample_times[-1], wanted)
    after = np.clip(np.searchsorted(sample_times, grid), 1, sample_times.size - 1)
    nearer_before = grid - sample_times[after - 1] < sample_times[after] - grid
    return np.unique(after - nearer_before)


def frames_of_samples(
    times: ArrayLike,
    kept: NDArray[np.intp],
    kept_poses: ArrayLike,
    link_count: int,
    series: Mapping[str, Curve],
) -> MotionFrames:
    """Assemble frames from poses at the kept samples.

    Args:
        times: Times of all samples, shape (T,), strictly increasing [s].
        kept: Indices from `kept_samples`, shape (F,).
        kept_poses: Transforms from link to world at the kept samples, shape (F, L, 4, 4) [m].
        link_count: Number of links L.
        series: Name of a curve (with unit) -> curve to plot, with values at all samples.

    Returns:
        The frames.

    Raises:
        InvalidValueError: Wrong shapes, times that do not increase, NaN or infinite values, or transforms
            that are not rigid.
    """
    sample_times = _checked_times(times)
    poses = rigid_transforms("link_poses", kept_poses, (kept.size, link_count, 4, 4))
    quaternions = quaternions_of(poses[..., :3, :3])
    # q and -q are one orientation; signs are chosen so that neighboring frames blend along the shorter arc.
    turns = np.where(np.einsum("fli,fli->fl", quaternions[1:], quaternions[:-1]) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(turns, axis=0)[..., None]
    curves = tuple(_sampled(name, curve, sample_times.size, kept) for name, curve in series.items())
    return MotionFrames(sample_times[kept], poses[..., :3, 3], quaternions, curves)


def _checked_times(times: ArrayLike) -> NDArray[np.float64]:
    """Check that times [s], shape (T,), are finite and strictly increasing, and return them."""
    sample_times = as_finite(times, "times", (None,))
    if sample_times.size == 0:
        raise InvalidValueError("times", "no sample", "at least one time [s]")
    steps = np.diff(sample_times)
    if (steps <= 0.0).any():
        k = int(np.argmax(steps <= 0.0))
        raise InvalidValueError(
            "times",
            f"{sample_times[k]:g} s followed by {sample_times[k + 1]:g} s",
            "strictly increasing times",
        )
    return sample_times


def _sampled(name: str, series: Curve, samples: int, kept: NDArray[np.intp]) -> SampledSeries:
    """Reduce a curve to the kept samples, indices of shape (F,), with its extremes around each."""
    curve = as_finite(series.values, f"series {name!r}", (samples,))
    borders = np.concatenate([[0], (kept[1:] + kept[:-1] + 1) // 2])
    return SampledSeries(
        name,
        curve[kept],
        np.minimum.reduceat(curve, borders),
        np.maximum.reduceat(curve, borders),
        series.limit,
        *(None if line is None else np.asarray(line)[kept] for line in (series.ghost, series.command)),
    )
