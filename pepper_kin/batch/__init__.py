"""Quantities for batches of states, at the speed of compiled code."""

from pepper_kin.batch.kernels_of import kernel
from pepper_kin.batch.states import (
    KERNEL_FROM,
    all_over_states,
    over_states,
    state_data,
)

__all__ = [
    "KERNEL_FROM",
    "all_over_states",
    "kernel",
    "over_states",
    "state_data",
]
