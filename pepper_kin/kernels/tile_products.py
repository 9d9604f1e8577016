"""Products of two blocks of rows, added to a tile of four rows of eight numbers that stays in registers.

Factorizing a matrix, and adding J^T W J to one, consist of sums of outer products; row by row each product
costs a load and a store of its target.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pepper_kin.kernels.intrinsics import floats_at, in_all_lanes, intrinsic
from pepper_kin.kernels.sources import file_digest

TILE_ROWS, TILE_COLUMNS = 4, 8
_WIDE = 4


def _emit_tile(
    typing_context: Any, target: Any, target_stride: Any, left: Any, right: Any, stride: Any, count: Any,
    share: Any,
) -> Any:  # fmt: skip
    """Write a loop over the rows, which keeps the tile's sums in eight vectors."""
    from llvmlite import ir
    from numba import types

    vectors = TILE_COLUMNS // _WIDE

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, number = ir.IntType(64), ir.DoubleType()
        vector = ir.VectorType(number, _WIDE)
        target, target_stride, left, right, stride, count, share = arguments
        none = ir.Constant(vector, [0.0] * _WIDE)

        def place(address: Any, kind: Any) -> Any:
            return builder.inttoptr(address, kind.as_pointer())

        step = builder.mul(stride, word(8))
        before = builder.block
        test, body, after = (builder.append_basic_block(name) for name in ("test", "body", "after"))
        builder.branch(test)
        builder.position_at_end(test)
        places = [builder.phi(word) for _ in range(3)]  # counter, addresses of the left and right row
        sums = [[builder.phi(vector) for _ in range(vectors)] for _ in range(TILE_ROWS)]
        for phi, first in zip(places, (word(0), left, right), strict=True):
            phi.add_incoming(first, before)
        for row in sums:
            for phi in row:
                phi.add_incoming(none, before)
        builder.cbranch(builder.icmp_signed("<", places[0], count), body, after)
        builder.position_at_end(body)
        wide = [
            builder.load(place(builder.add(places[2], word(8 * _WIDE * v)), vector), align=8)
            for v in range(vectors)
        ]
        for a, row in enumerate(sums):
            own = builder.load(place(builder.add(places[1], word(8 * a)), number), align=8)
            factor = in_all_lanes(builder, own, vector)
            for v, phi in enumerate(row):
                product = builder.fmul(factor, wide[v], flags=["contract"])
                phi.add_incoming(builder.fadd(phi, product, flags=["contract"]), body)
        places[0].add_incoming(builder.add(places[0], word(1)), body)
        for phi in places[1:]:
            phi.add_incoming(builder.add(phi, step), body)
        builder.branch(test)
        builder.position_at_end(after)
        factor, below = in_all_lanes(builder, share, vector), builder.mul(target_stride, word(8))
        address = target
        for row in sums:
            for v, phi in enumerate(row):
                own = place(builder.add(address, word(8 * _WIDE * v)), vector)
                product = builder.fmul(factor, phi, flags=["contract"])
                builder.store(
                    builder.fadd(builder.load(own, align=8), product, flags=["contract"]), own, align=8
                )
            address = builder.add(address, below)
        return context.get_dummy_value()

    words = [types.intp] * 6
    return types.void(*words, types.float64), generate


@intrinsic(_emit_tile)
def add_tile(
    target: int, target_stride: int, left: int, right: int, stride: int, count: int, share: float
) -> None:
    """Add share * sum_r left_r^T right_r to a tile; rows overlap no row of the tile.

    Args:
        target: Address of the tile, four rows of eight numbers.
        target_stride: Stride of the tile's rows, in numbers.
        left: Address of the first left row of four numbers.
        right: Address of the first right row of eight numbers.
        stride: Stride of the left and of the right rows, in numbers.
        count: Number of rows.
        share: Factor of the sum.
    """
    if count <= 0:
        return
    target, left, right = int(target), int(left), int(right)  # interpreted callers pass NumPy's integers
    ours = np.stack([floats_at(left + 8 * r * stride, TILE_ROWS) for r in range(count)])
    theirs = np.stack([floats_at(right + 8 * r * stride, TILE_COLUMNS) for r in range(count)])
    for a, row in enumerate(share * (ours.T @ theirs)):
        floats_at(target + 8 * a * target_stride, TILE_COLUMNS)[:] += row


add_tile.described += " " + file_digest(str(Path(__file__)))
