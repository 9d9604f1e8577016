"""Terms that are linear in what a kernel of (q, v, a) computes: torques, moments about edges."""

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
    """What a term is made of.

    Attributes:
        joints: Those that move, shape (k,).
        rest: A whole configuration, whose other joints hold, and constants, shape (n,).
        still: Zeros, shape (n,).
        first: Where rows of L begin, shape (R + 1,).
        column: Of each weight, shape (w,).
        weight: Numbers of L that are not zero, shape (w,).
        workspace: Of a call.
        outputs: How many f has.
        values: Address of the `batch` of f.
        slopes: Address of the `batch` of its derivatives.
        work: Workspace of both.
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
    """L f(q, v, a) with a constant matrix L.

    Args:
        moving: The joints that move.
        kernels: f, and its derivatives by q, v and a, shape (outputs, n) each.
        matrix: L, shape (R, outputs).
        per_interval: Samples in each interval of the spline.
        barrier_bound: Which values are allowed.
        constants: Numbers that f takes behind q, shape (p,); its v and a then have p more, too, which are 0.
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
    """Run a kernel of three inputs and outputs for all states, in memory that outlives the call."""
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
    """Write L times each of K blocks of outputs, of each of which some columns are taken.

    Args:
        parts: Shape (K, outputs, n), flat.
        lines: L row by row: where rows begin, columns, and weights.
        columns: Columns that are taken.
        sizes: K, outputs, n.
        result: Written, shape (K, R, taken), flat.
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
    """Evaluate such a term; see `CompiledTerm`."""
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
