"""Counter-based random numbers, a function of a key and an index.

Source: G. L. Steele, D. Lea and C. H. Flood, Fast splittable pseudorandom number generators, OOPSLA 2014
(SplitMix64), whose state is a counter: any number of a stream is computed without the ones before it.
"""

from __future__ import annotations

import numpy as np

from pepper_kin.kernels.compiled_function import INTERPRETED, compiled

GAMMA = np.uint64(0x9E3779B97F4A7C15)
FIRST = np.uint64(0xBF58476D1CE4E5B9)
SECOND = np.uint64(0x94D049BB133111EB)

if INTERPRETED:
    np.seterr(over="ignore")  # integers of 64 bits wrap around, as in machine code


@compiled("uint64(uint64)", lean=True)
def mixed(z: np.uint64) -> np.uint64:
    """Return a hash of 64 bits in which every input bit affects all bits."""
    z = (z ^ (z >> np.uint64(30))) * FIRST
    z = (z ^ (z >> np.uint64(27))) * SECOND
    return z ^ (z >> np.uint64(31))
