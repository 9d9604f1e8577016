"""What states of a robot ask of it, as far as there are limits on it: batches with little ado."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.balance import edge_moments, moment_matrix, moves_base, support_polygon
from pepper_kin.trajectory.fast_kernel import edge_products, evaluate, linear_speed
from pepper_kin.trajectory.limit_use import Limits
from pepper_kin.trajectory.payload import payload_torque, payload_wrench

Array = NDArray[np.float64]


@lru_cache(maxsize=32)
def _moment_of_wrench(pepper: PepperModel, margin: float) -> Array:
    polygon = support_polygon(pepper)
    return np.zeros((6, 0)) if polygon is None else moment_matrix(polygon, margin)


class Effects:
    """What states of a robot ask of it, as far as there are limits on it; arrays of shape (T, n)."""

    def __init__(self, pepper: PepperModel, limits: Limits) -> None:
        self.pepper, self.limits = pepper, limits
        torque = limits.torque is not None and bool(np.isfinite(limits.torque).any())
        self.torque_limit = np.array(limits.torque) if torque else np.zeros(0)
        self.polygon = support_polygon(pepper) if limits.balance is not None else None
        self.moment_of_wrench: Array | None = None
        if self.polygon is not None and limits.balance is not None and not moves_base(pepper):
            self.moment_of_wrench = _moment_of_wrench(pepper, limits.balance)

    @property
    def any(self) -> bool:
        """Whether there are limits besides those of velocity and acceleration."""
        return bool(self.torque_limit.size or self.polygon is not None or self.limits.speed)

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Torques, shape (T, n or 0)."""
        if not self.torque_limit.size:
            return np.zeros((len(q), 0))
        torque = evaluate(kernel(self.pepper, "inverse_dynamics"), q, v, a)
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
        wrench = evaluate(kernel(self.pepper, "base_wrench"), q, v, a)
        if self.limits.payload:
            wrench = wrench + payload_wrench(self.pepper, self.limits.payload, q, v, a)
        return edge_products(wrench, self.moment_of_wrench)

    def speed(self, q: Array, v: Array) -> Array:
        """Speeds of frames over their limits, shape (T, number of frames)."""
        shares = np.empty((len(q), len(self.limits.speed)))
        for k, (frame, limit) in enumerate(self.limits.speed):
            linear_speed(evaluate(kernel(self.pepper, "frame_velocity", frame), q, v), limit, k, shares)
        return shares
