"""Quantities for batches of states, at the speed of compiled code."""

from pepper_kin.batch.kernels_of import kernel
from pepper_kin.batch.states import (
    KERNEL_FROM,
    all_over_states,
    are_vectors,
    is_plain_state,
    is_state,
    over_states,
)

__all__ = [
    "KERNEL_FROM",
    "all_over_states",
    "are_vectors",
    "is_plain_state",
    "is_state",
    "kernel",
    "over_states",
]
