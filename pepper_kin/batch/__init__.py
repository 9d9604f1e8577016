"""Quantities for batches of states, at the speed of compiled code."""

from pepper_kin.batch.kernels_of import kernel
from pepper_kin.batch.states import KERNEL_FROM, over_states

__all__ = ["KERNEL_FROM", "kernel", "over_states"]
