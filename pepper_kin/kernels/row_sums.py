"""Sums of rows of numbers in vectors of four.

LLVM's own vectorizer takes sixteen numbers at a time and the rest one by one: in rows of fifteen, all.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pepper_kin.kernels.intrinsics import floats_at, in_all_lanes, intrinsic
from pepper_kin.kernels.sources import file_digest

_WIDE = 4


def _emit_sum(typing_context: Any, target: Any, rows: Any, shares: Any, count: Any) -> Any:
    """Write a loop over vectors, and one over the remaining numbers."""
    from llvmlite import ir
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, number = ir.IntType(64), ir.DoubleType()
        vector = ir.VectorType(number, _WIDE)
        target, count = arguments[0], arguments[3]
        rows, shares = (
            [builder.extract_value(group, i) for i in range(len(kind))]
            for group, kind in zip(arguments[1:3], signature.args[1:3], strict=True)
        )
        spread = [in_all_lanes(builder, share, vector) for share in shares]
        whole = builder.and_(count, word(-_WIDE))

        def loop(first: Any, last: Any, step: int, kind: Any, factors: list[Any]) -> None:
            before = builder.block
            test = builder.append_basic_block("test")
            body = builder.append_basic_block("body")
            after = builder.append_basic_block("after")
            builder.branch(test)
            builder.position_at_end(test)
            k = builder.phi(word)
            k.add_incoming(first, before)
            builder.cbranch(builder.icmp_signed("<", k, last), body, after)
            builder.position_at_end(body)
            offset = builder.mul(k, word(8))
            places = [
                builder.inttoptr(builder.add(address, offset), kind.as_pointer())
                for address in (target, *rows)
            ]
            total = builder.load(places[0], align=8)
            for place, factor in zip(places[1:], factors, strict=True):
                product = builder.fmul(builder.load(place, align=8), factor, flags=["contract"])
                total = builder.fadd(total, product, flags=["contract"])
            builder.store(total, places[0], align=8)
            k.add_incoming(builder.add(k, word(step)), body)
            builder.branch(test)
            builder.position_at_end(after)

        loop(word(0), whole, _WIDE, vector, spread)
        loop(whole, count, 1, number, list(shares))
        return context.get_dummy_value()

    size = len(rows)
    return types.void(
        types.intp, types.UniTuple(types.intp, size), types.UniTuple(types.float64, size), types.intp
    ), generate


@intrinsic(_emit_sum)
def add_rows(target: int, rows: tuple[int, ...], shares: tuple[float, ...], count: int) -> None:
    """Add multiples of some rows to a row; rows are given by address, and the target overlaps no other row.

    Args:
        target: Address of the row to which the others are added.
        rows: Addresses of the rows that are added.
        shares: Factors of the rows.
        count: Length of all rows.
    """
    if count > 0:
        for row, share in zip(rows, shares, strict=True):
            floats_at(target, count)[:] += share * floats_at(row, count)


add_rows.described += " " + file_digest(str(Path(__file__)))
