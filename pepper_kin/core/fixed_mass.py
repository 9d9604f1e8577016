"""Conversion of sums over moving masses to sums over all masses, some of which are fixed.

With s the fixed masses' fraction of the total, c_0 their center, and c the center of the moving masses, the
center of all masses is (1 - s) c + s c_0, at the distance s (c - c_0) from c.
"""

from __future__ import annotations

from pepper_kin.kernels import compiled
from pepper_kin.kernels.signatures import Floats1


@compiled("void(float64, float64[::1], float64[::1])")
def center_of_all(share: float, still: Floats1, center: Floats1) -> None:
    """Convert the center of the moving masses to the center of all masses, in place.

    Args:
        share: Mass fraction of the moving masses, 1 - s.
        still: s c_0, shape (3,) [m].
        center: c, overwritten, shape (3,) [m].
    """
    for i in range(3):
        center[i] = center[i] * share + still[i]


@compiled("void(float64, float64[::1], float64[::1], float64[::1])")
def momentum_about_center_of_all(part: float, fixed: Floats1, center: Floats1, momentum: Floats1) -> None:
    """Move the reference point of momenta from the center of the moving masses to the center of all.

    Args:
        part: Mass fraction of the fixed masses, s.
        fixed: c_0, shape (3,) [m].
        center: c, shape (3,) [m].
        momentum: Rows of a matrix of shape (6, k), one after the other: linear momenta, then angular momenta
            about c; overwritten, shape (6 k,).
    """
    x = part * (center[0] - fixed[0])
    y = part * (center[1] - fixed[1])
    z = part * (center[2] - fixed[2])
    k = momentum.size // 6
    for j in range(k):
        px, py, pz = momentum[j], momentum[k + j], momentum[2 * k + j]
        momentum[3 * k + j] += y * pz - z * py
        momentum[4 * k + j] += z * px - x * pz
        momentum[5 * k + j] += x * py - y * px


@compiled("void(float64, float64[::1], float64[::1], float64[::1], float64[::1])")
def wrench_about_origin(
    share: float, still: Floats1, weight: Floats1, center: Floats1, rate: Floats1
) -> None:
    """Convert the rate of momentum to the wrench about the origin that causes it together with gravity.

    f = dp/dt - m g and n = dL/dt + c x dp/dt - c_all x m g.

    Args:
        share: Mass fraction of the moving masses, 1 - s.
        still: s c_0, shape (3,) [m].
        weight: m g of all masses, shape (3,) [N].
        center: c, shape (3,) [m].
        rate: dp/dt, then dL/dt about c, overwritten with f and n, shape (6,) [N, N m].
    """
    px, py, pz = rate[0], rate[1], rate[2]
    x, y, z = center[0], center[1], center[2]
    cx, cy, cz = x * share + still[0], y * share + still[1], z * share + still[2]
    wx, wy, wz = weight[0], weight[1], weight[2]
    rate[0], rate[1], rate[2] = px - wx, py - wy, pz - wz
    rate[3] += y * pz - z * py - (cy * wz - cz * wy)
    rate[4] += z * px - x * pz - (cz * wx - cx * wz)
    rate[5] += x * py - y * px - (cx * wy - cy * wx)
