"""Sines and cosines of many angles at once, in a loop that LLVM vectorizes."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.kernels import compiled
from pepper_kin.kernels.signatures import Floats1
from pepper_kin.kernels.trigonometry import _DOUBLE

TWO_BY_PI = 2.0 / math.pi
P1, P2, P3 = _DOUBLE.half_pi
S0, S1, S2, S3, S4, S5 = _DOUBLE.sine
C0, C1, C2, C3, C4, C5 = _DOUBLE.cosine
MAGIC = _DOUBLE.magic

FAR = 2e4
"""Angle [rad] beyond which n P1 is not exact on a processor without fused instructions."""


@compiled("void(float64[::1], float64[::1], float64[::1])", lean=True, vector=True)
def sines_and_cosines(angles: Floats1, sines: Floats1, cosines: Floats1) -> None:
    """Write sines and cosines, accurate to 1.5 units in the last place; see `kernels.trigonometry`.

    A number of angles that fills vectors, a multiple of four, takes a fraction of the time.

    Args:
        angles: Finite angles, shape (m,) [rad].
        sines: Output, shape (m,).
        cosines: Output, shape (m,).
    """
    far = 0.0
    for i in range(angles.shape[0]):
        far = max(far, abs(angles[i]))
    if far > FAR:
        for i in range(angles.shape[0]):
            sines[i], cosines[i] = math.sin(angles[i]), math.cos(angles[i])
        return
    for i in range(angles.shape[0]):
        turns = (angles[i] * TWO_BY_PI + MAGIC) - MAGIC
        r = ((angles[i] - turns * P1) - turns * P2) - turns * P3
        z = r * r
        s = r + r * (z * (S0 + z * (S1 + z * (S2 + z * (S3 + z * (S4 + z * S5))))))
        c = 1.0 + z * (-0.5 + z * (C0 + z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * C5))))))
        half = np.floor(0.5 * turns)
        odd = turns - 2.0 * half
        negative = half - 2.0 * np.floor(0.5 * half)
        sines[i] = ((1.0 - odd) * s + odd * c) * (1.0 - 2.0 * negative)
        cosines[i] = ((1.0 - odd) * c + odd * s) * (1.0 - 2.0 * (negative + odd - 2.0 * negative * odd))
