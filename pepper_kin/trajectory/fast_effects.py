"""What states of a robot ask of it, as far as there are limits on it: batches with little ado."""

from __future__ import annotations

import ctypes
import struct

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.kernels import Kernel
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.balance import edge_moments, moment_matrix, moves_base, support_polygon
from pepper_kin.trajectory.limit_use import Limits
from pepper_kin.trajectory.payload import payload_torque, payload_wrench

Array = NDArray[np.float64]

_BATCH = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 4, ctypes.c_int64, ctypes.c_void_p)


class Effects:
    """What states of a robot ask of it, as far as there are limits on it; arrays of shape (T, n)."""

    def __init__(self, pepper: PepperModel, limits: Limits) -> None:
        self.pepper, self.limits = pepper, limits
        torque = limits.torque is not None and bool(np.isfinite(limits.torque).any())
        self.torque_limit = np.array(limits.torque) if torque else np.zeros(0)
        self.polygon = support_polygon(pepper) if limits.balance is not None else None
        self.moment_of_wrench: Array | None = None
        if self.polygon is not None and limits.balance is not None and not moves_base(pepper):
            self.moment_of_wrench = moment_matrix(self.polygon, limits.balance)

    @property
    def any(self) -> bool:
        """Whether there are limits besides those of velocity and acceleration."""
        return bool(self.torque_limit.size or self.polygon is not None or self.limits.speed)

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Torques, shape (T, n or 0)."""
        if not self.torque_limit.size:
            return np.zeros((len(q), 0))
        torque = _evaluate(kernel(self.pepper, "inverse_dynamics"), q, v, a)
        return (
            torque + payload_torque(self.pepper, self.limits.payload, q, v, a)
            if self.limits.payload
            else torque
        )

    def moments(self, q: Array, v: Array, a: Array) -> Array:
        """Edge moments, shape (T, k or 0)."""
        if self.polygon is None or self.limits.balance is None:
            return np.zeros((len(q), 0))
        if self.moment_of_wrench is None:
            return edge_moments(self.pepper, self.polygon, q, v, a, self.limits.balance, self.limits.payload)
        wrench = _evaluate(kernel(self.pepper, "base_wrench"), q, v, a)
        if self.limits.payload:
            wrench = wrench + payload_wrench(self.pepper, self.limits.payload, q, v, a)
        return wrench @ self.moment_of_wrench

    def speed(self, q: Array, v: Array) -> Array:
        """Speeds of frames over their limits, shape (T, number of frames)."""
        shares = np.empty((len(q), len(self.limits.speed)))
        for k, (frame, limit) in enumerate(self.limits.speed):
            velocity = _evaluate(kernel(self.pepper, "frame_velocity", frame), q, v)[:, :3]
            shares[:, k] = np.sqrt(np.einsum("ti,ti->t", velocity, velocity)) / limit
        return shares


def _evaluate(compiled: Kernel, *states: Array) -> Array:
    """Evaluate a kernel for contiguous arrays of shape (T, n) that are known to be finite.

    Calling it by its address, as it documents, saves the checks of `Kernel.__call__`, which take as long as
    hundreds of states.
    """
    count, size = len(states[0]), compiled.signature.output_sizes[0]
    result, work = np.empty((count, size)), np.empty(compiled.work_size + 8)
    widths = [state.shape[1] for state in states]
    begin = -(-work.ctypes.data // 64) * 64
    function = _BATCH(compiled.batch_address)
    function(
        _pack([state.ctypes.data for state in states]),
        _pack(widths),
        _pack([result.ctypes.data]),
        _pack([size]),
        count,
        begin,
    )
    return result


def _pack(numbers: list[int]) -> bytes:
    """Return a C array of int64."""
    return struct.pack(f"={len(numbers)}q", *numbers)
