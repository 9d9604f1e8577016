"""The exact verdict on one configuration, for searches that know addresses only."""

from __future__ import annotations

from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.check import check_rows
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def surely_free(configuration: int, memory: int, size: int, _: int) -> int:
    """Return 1 if surely nothing touches at a configuration, else 0.

    Args:
        configuration: Address of q, shape (n,) [rad or m].
        memory: Address of a block of the compiled check in which all joints are free.
        size: Doubles in it.
    """
    block = floats_at(memory, size)
    numbers = at.section(block, at.NUMBERS)
    if numbers[at.BLOCKED] > 0:
        return 0
    check_rows(block, floats_at(configuration, int(numbers[at.N])), 1)
    return 1 if at.section_bits(block, at.STATUS)[0] == 0 else 0
