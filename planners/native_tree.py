"""Nodes of compiled planners: nearest neighbours by a linear scan, eight nodes at a time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from .vectors import FloatArray

LANES = 8


def _eight_square_distances(typing_context: Any, block: Any, query: Any, n: Any, answer: Any) -> Any:
    """Write the squares of the distances of eight states, shape (n, 8), from one; return the least.

    Arguments are addresses and a number; LLVM's vector types give SIMD code where its loop vectoriser does
    not see its way through.
    """
    signature = types.float64(types.intp, types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, number = ir.IntType(64), ir.DoubleType()
        vector = ir.VectorType(number, LANES)
        block, query, count, answer = arguments
        states = builder.inttoptr(block, vector.as_pointer())
        coordinates = builder.inttoptr(query, number.as_pointer())
        before = builder.block
        body = builder.append_basic_block("coordinate")
        after = builder.append_basic_block("done")
        builder.branch(body)
        builder.position_at_end(body)
        i, total = builder.phi(word), builder.phi(vector)
        i.add_incoming(word(0), before)
        total.add_incoming(ir.Constant(vector, [0.0] * LANES), before)
        coordinate = builder.load(builder.gep(coordinates, [i]))
        lane = builder.insert_element(ir.Constant(vector, ir.Undefined), coordinate, ir.IntType(32)(0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        spread = builder.shuffle_vector(lane, ir.Constant(vector, ir.Undefined), zeros)
        difference = builder.fsub(builder.load(builder.gep(states, [i]), align=8), spread)
        summed = builder.fadd(
            total, builder.fmul(difference, difference, flags=["contract"]), flags=["contract"]
        )
        following = builder.add(i, word(1))
        i.add_incoming(following, body)
        total.add_incoming(summed, body)
        builder.cbranch(builder.icmp_signed("<", following, count), body, after)
        builder.position_at_end(after)
        builder.store(summed, builder.inttoptr(answer, vector.as_pointer()), align=8)
        reduce = builder.module.declare_intrinsic(
            f"llvm.vector.reduce.fmin.v{LANES}f64", (), ir.FunctionType(number, [vector])
        )
        return builder.call(reduce, [summed], fastmath=["nnan", "nsz"])

    return signature, generate


eight_square_distances: Any = intrinsic(_eight_square_distances)


@njit(nogil=True, cache=True, error_model="numpy")
def set_lane(lanes: FloatArray, node: int, state: FloatArray, weights: FloatArray) -> None:
    """Write the scaled state of a new node; the rest of its lanes, if it is the first, is infinitely far."""
    if node % LANES == 0:
        for i in range(state.size):
            for lane in range(1, LANES):
                lanes[node // LANES, i, lane] = math.inf
    for i in range(state.size):
        lanes[node // LANES, i, node % LANES] = state[i] * weights[i]


@njit(nogil=True, cache=True, error_model="numpy")
def nearest(lanes: FloatArray, size: int, query: FloatArray, room: FloatArray) -> int:
    """Return the node nearest to a scaled state; the first of equally near ones.

    Args:
        lanes: Scaled states, shape (blocks, n, 8); those of the last block that are no nodes are infinite.
        size: Number of nodes.
        query: Scaled state, shape (n,).
        room: Eight numbers.
    """
    best, found, n = math.inf, 0, query.size
    base, stride, asked, place = lanes.ctypes.data, 8 * LANES * n, query.ctypes.data, room.ctypes.data
    for block in range((size + LANES - 1) // LANES):
        if eight_square_distances(base + block * stride, asked, n, place) < best:
            for lane in range(LANES):
                if room[lane] < best:
                    best, found = room[lane], block * LANES + lane
    return found


@njit(nogil=True, cache=True, error_model="numpy")
def k_nearest(
    lanes: FloatArray,
    size: int,
    query: FloatArray,
    wanted: int,
    found: np.ndarray,
    squares: FloatArray,
    room: FloatArray,
) -> int:
    """Write the nodes nearest to a scaled state and the squares of their distances, nearest first.

    Args:
        lanes: Scaled states, shape (blocks, n, 8).
        size: Number of nodes.
        query: Scaled state, shape (n,).
        wanted: How many are wanted, 1 or more.
        found: Room for them.
        squares: Room for the squares of their distances.
        room: Eight numbers.

    Returns:
        How many were found: `wanted`, or all.
    """
    n, count, limit = query.size, 0, math.inf
    base, stride, asked, place = lanes.ctypes.data, 8 * LANES * n, query.ctypes.data, room.ctypes.data
    for block in range((size + LANES - 1) // LANES):
        if eight_square_distances(base + block * stride, asked, n, place) >= limit:
            continue
        for lane in range(LANES):
            square = room[lane]
            if square >= limit or block * LANES + lane >= size:
                continue
            k = count if count < wanted else wanted - 1
            while k > 0 and squares[k - 1] > square:
                squares[k], found[k] = squares[k - 1], found[k - 1]
                k -= 1
            squares[k], found[k] = square, block * LANES + lane
            count = min(count + 1, wanted)
            if count == wanted:
                limit = squares[wanted - 1]
    return count
