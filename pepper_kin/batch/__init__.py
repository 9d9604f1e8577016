"""Quantities for batches of states, by compiled code.

    kernel                                    machine code of a quantity by name
    over_states, all_over_states, state_data  a function of one state, over arrays of states
    KERNEL_FROM                               minimum number of states for machine code

Machine code of a robot's quantities is compiled once and cached on disk.
"""

from pepper_kin.batch.kernels_of import kernel
from pepper_kin.batch.states import (
    KERNEL_FROM,
    all_over_states,
    over_states,
    state_data,
)
from pepper_kin.call_errors import name_options

__all__ = [
    "KERNEL_FROM",
    "all_over_states",
    "kernel",
    "over_states",
    "state_data",
]

name_options(__name__)
