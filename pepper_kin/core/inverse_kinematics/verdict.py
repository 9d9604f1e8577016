"""Exact verdict on one configuration, callable by address."""

from __future__ import annotations

from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.check import check_rows
from pepper_kin.core.collision.gjk import CONTACT
from pepper_kin.core.collision.records import HEAD
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def verdict(configuration: int, memory: int, size: int, _: int) -> int:
    """Return FREE, CONTACT or TIE, see `pepper_kin.core.collision.gjk`, for a configuration.

    Args:
        configuration: Address of q, shape (n,) [rad or m].
        memory: Address of a block of the compiled check in which all joints are free.
        size: Number of doubles in the block.
    """
    block = floats_at(memory, size)
    head = at.head_of(block)
    if HEAD.blocked(head) != 0:
        return CONTACT
    check_rows(block, floats_at(configuration, HEAD.joints(head)), 1)
    return at.section_bits(block, at.STATUS)[0]
