"""Terms that are linear in the outputs of a kernel of (q, v, a): torques, edge moments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.kernel_batch import evaluate_batch
from pepper_kin.kernels import Kernel
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_batch, floats_at, words_at
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1
from pepper_kin.kernels.tables import TableMemory, table_reader, take
from pepper_kin.motion.optimization.moving import Moving, whole_states
from pepper_kin.planners.optimization import KINDS, ROWS, BarrierBound, CompiledTerm


class _KernelTable(NamedTuple):
    """Data of a kernel term L f for compiled functions.

    Attributes:
        joints: Indices of the joints that move, shape (k,).
        rest: A whole configuration with the other joints' positions, followed by constants, shape (n,).
        still: Zeros, shape (n,).
        first: Offsets of the rows of L among its nonzero elements, shape (R + 1,).
        column: Column of each nonzero element of L, shape (w,).
        weight: Nonzero elements of L, shape (w,).
        workspace: Memory of a call.
        outputs: Number of outputs of f.
        values: Address of the `batch` function of f.
        slopes: Address of the `batch` function of the derivatives of f.
        work: Workspace size of both functions.
    """

    joints: Ints1
    rest: Floats1
    still: Floats1
    first: Ints1
    column: Ints1
    weight: Floats1
    workspace: Floats1
    outputs: int
    values: int
    slopes: int
    work: int


_kernels_at = table_reader(_KernelTable)


class KernelTerm(CompiledTerm):
    """Term L f(q, v, a) with a constant matrix L.

    Args:
        moving: The joints that move.
        kernels: Kernel of f, and kernel of its derivatives by q, v and a, shape (outputs, n) each.
        matrix: Matrix L, shape (R, outputs).
        per_interval: Samples in each interval of the spline.
        barrier_bound: Bound on the allowed values.
        constants: Numbers that f takes after q, shape (p,); v and a then have p additional zeros.
    """

    def __init__(
        self,
        moving: Moving,
        kernels: tuple[Kernel, Kernel],
        matrix: Array,
        per_interval: int,
        barrier_bound: BarrierBound,
        constants: Array | None = None,
    ) -> None:
        values, slopes = kernels
        row, column = np.nonzero(matrix)
        first = np.searchsorted(row, np.arange(len(matrix) + 1))
        rest = moving.rest if constants is None else np.concatenate([moving.rest, constants])
        n, outputs = rest.size, matrix.shape[1]
        work = max(values.work_size, slopes.work_size)
        self.table = TableMemory(
            _KernelTable,
            joints=moving.joints,
            rest=rest,
            still=np.zeros(n),
            first=first,
            column=column,
            weight=matrix[row, column],
            workspace=np.zeros(0),
            outputs=outputs,
            values=values.address_of("batch", inputs=3 * n, outputs=outputs, work=work),
            slopes=slopes.address_of("batch", inputs=3 * n, outputs=3 * outputs * n, work=work),
            work=work,
        )
        self._workspace_size = 3 * n + outputs * (1 + 3 * n), 32 + work
        self._workspace = np.zeros(0)
        super().__init__(
            kernel_rows.address,
            self.table.words,
            len(matrix),
            3,
            per_interval,
            barrier_bound,
            keep_alive=kernels,
        )

    def reserve(self, count: int) -> None:
        """Allocate memory for a number of samples."""
        size = count * self._workspace_size[0] + self._workspace_size[1]
        if size > self._workspace.size:
            self._workspace = np.zeros(size)
            self.table.set(workspace=self._workspace)


@compiled(lean=True)
def _evaluate_slopes(address: int, whole: Floats3, outputs: Floats2, words: Ints1, work: Floats1) -> None:
    """Run a kernel of three inputs and three outputs for all states, with pointers in given memory."""
    count = whole.shape[1]
    for i in range(3):
        words[i], words[3 + i] = whole[i].ctypes.data, whole.shape[2]
        words[6 + i], words[9 + i] = outputs[i].ctypes.data, outputs.shape[1] // count
    here = words.ctypes.data
    call_batch(address, here, here + 24, here + 48, here + 72, count, work.ctypes.data)


@compiled(lean=True)
def _map_rows(
    parts: Floats1, lines: tuple[Ints1, Ints1, Floats1], columns: Ints1, sizes: tuple[int, int, int],
    result: Floats1,
) -> None:  # fmt: skip
    """Write the products of L with selected columns of K blocks of outputs.

    Args:
        parts: Blocks, shape (K, outputs, n), flat.
        lines: Sparse rows of L: offsets of the rows, columns, and weights.
        columns: Indices of the selected columns.
        sizes: K, outputs and n.
        result: Receives the products, shape (K, R, number of columns), flat.
    """
    count, outputs, n = sizes
    first, column, weight = lines
    taken, rows = columns.size, first.size - 1
    for k in range(count):
        for r in range(rows):
            place = (k * rows + r) * taken
            for j in range(taken):
                result[place + j] = 0.0
            for i in range(first[r], first[r + 1]):
                begin, share = (k * outputs + column[i]) * n, weight[i]
                for j in range(taken):
                    result[place + j] += share * parts[begin + columns[j]]


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def kernel_rows(states: int, result: int, asked: int, memory_address: int) -> int:
    """Evaluate a kernel term; see `CompiledTerm`."""
    what, count = asked % KINDS, asked // KINDS
    t = _kernels_at(memory_address)
    n, outputs, joints, lines = t.rest.size, t.outputs, t.joints, (t.first, t.column, t.weight)
    rows, size = t.first.size - 1, count * joints.size
    used = np.zeros(1, np.int64)
    inputs, whole = floats_at(states, 3 * size), take(t.workspace, used, 3 * count * n).reshape((3, count, n))
    for part in range(3):
        whole_states(
            inputs[part * size : (part + 1) * size], joints, t.rest if part == 0 else t.still, whole[part]
        )
    work = take(t.workspace, used, t.work + 8)
    words = words_at(take(t.workspace, used, 12).ctypes.data, 12)
    numbers = floats_at(result, count * rows * (1 + 3 * joints.size if what == ROWS else 1))
    single, values = np.zeros(1, np.int64), take(t.workspace, used, count * outputs).reshape((count, outputs))
    evaluate_batch(t.values, whole[0], whole[1], whole[2], values, work, words)
    _map_rows(values.reshape(values.size), lines, single, (count, outputs, 1), numbers[: count * rows])
    if what == ROWS:
        slopes = take(t.workspace, used, 3 * count * outputs * n).reshape((3, count * outputs * n))
        _evaluate_slopes(t.slopes, whole, slopes, words, work)
        for part in range(3):
            begin = count * rows * (1 + part * joints.size)
            own = numbers[begin : begin + count * rows * joints.size]
            _map_rows(slopes[part], lines, joints, (count, outputs, n), own)
    return 0
