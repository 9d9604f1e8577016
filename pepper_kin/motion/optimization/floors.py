"""Terms with floors, which admit initial motions that violate them, and rise as motions improve."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1
from pepper_kin.kernels.tables import TableMemory
from pepper_kin.planners.optimization import BarrierBound, CompiledTerm


class FlooredTerm(CompiledTerm):
    """A compiled term whose table holds floors, as `floor`; an empty array counts as zeros.

    Args:
        address: Address of the function.
        table: Table of the term.
        rows_count: Number of rows of a sample.
        per_interval: Samples in each interval of the spline.
        per_sample: Number of floors of a sample.
        keep_alive: Objects whose addresses the table contains.

    Attributes:
        floor: Floors, flat, shape (K * per_sample,) for K samples; empty for none.
    """

    def __init__(
        self, address: int, table: TableMemory, rows_count: int, per_interval: int, *,
        per_sample: int = 1, keep_alive: object = None,
    ) -> None:  # fmt: skip
        super().__init__(
            address, table.words, rows_count, 1, per_interval, BarrierBound.ABOVE_ZERO, has_floors=True,
            keep_alive=keep_alive,
        )  # fmt: skip
        self.table, self._per_sample, self.floor = table, per_sample, np.zeros(0)

    def start_from(self, q: Array) -> None:
        """Set the floors below a motion, given at the samples, shape (K, k)."""
        self.floor = np.zeros(len(q) * self._per_sample)
        self.table.set(floor=self.floor)
        super().start_from(q)


@compiled(lean=True)
def any_below_zero(floors: Floats1) -> bool:
    """Whether a floor is below zero."""
    least = 0.0
    for k in range(floors.size):
        least = min(least, floors[k])
    return least < 0.0
