"""The force and moment with which the floor carries the robot."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import are_vectors, over_states
from pepper_kin.dynamics.center_of_mass import share_of_moving
from pepper_kin.dynamics.mass import total_mass
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, kept_while_private

pinocchio = lazy_module("pinocchio")


def base_wrench(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.float64]:
    """Return the wrench of the floor on the robot, about the world's origin.

    With p the linear momentum, L the angular momentum about the centre c of the moving mass, m the mass of
    all links with centre c_all, and g the gravity vector,
        f = dp/dt - m g,   n = dL/dt + c x dp/dt - c_all x m g.
    Linear in the accelerations.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Force [N], then moment [N m], in world axes, shape (..., 6).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    model, data = pepper.inner_model, pepper.pinocchio_data
    share, (sx, sy, sz), (wx, wy, wz) = _masses(pepper)

    def one(q: NDArray[np.float64], v: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
        rate = pinocchio.computeCentroidalMomentumTimeVariation(
            model, data, pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a)
        )
        # Plain numbers: for vectors of three, each of NumPy's functions takes as long as all of this.
        px, py, pz, lx, ly, lz = rate.vector.tolist()
        x, y, z = data.com[0].tolist()
        cx, cy, cz = x * share + sx, y * share + sy, z * share + sz
        return np.array([
            px - wx, py - wy, pz - wz,
            lx + y * pz - z * py - (cy * wz - cz * wy),
            ly + z * px - x * pz - (cz * wx - cx * wz),
            lz + x * py - y * px - (cx * wy - cy * wx),
        ])  # fmt: skip

    if not pepper.is_coupled and are_vectors(pepper, q, v, a):
        # What is not finite in any joint is not finite in the sum over all links, and is looked at below.
        wrench = one(
            cast("NDArray[np.float64]", q), cast("NDArray[np.float64]", v), cast("NDArray[np.float64]", a)
        )
        if wrench.dot(wrench) < np.inf:
            return wrench
    return over_states(pepper, one, (6,), ("base_wrench",), q=q, v=v, a=a)


@kept_while_private
def _masses(pepper: PepperModel) -> tuple[float, list[float], list[float]]:
    """Return the moving links' share of the mass, what the others add to the centre [m], and m g [N]."""
    share, still = share_of_moving(pepper)
    weight = total_mass(pepper) * np.asarray(pepper.inner_model.gravity.linear)
    return share, still.tolist(), weight.tolist()
