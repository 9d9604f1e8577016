"""Instructions and cache lines of operations, beside the time that the processor needs at the least."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from harness import figures, in_turn, show
from operations import OPERATIONS, repeated

from pepper_kin.kernels.compiled_function import compiled

USUAL = (
    "inverse_dynamics", "forward_dynamics", "mass_matrix", "inverse_dynamics_derivatives",
    "inverse_dynamics_batch", "forward_dynamics_batch", "ik_hand", "ik_hand_clear", "ik_batch", "check_one",
    "check_batch", "servo", "plan", "retime", "certificate", "twin", "twin_batch",
)  # fmt: skip
A_CYCLE = 4.0
"""Instructions that the processor is granted a cycle."""
LINE = 64
COUNTED = {"instructions": r"I +refs", "lines": r"D1 +misses", "far": r"LLd +misses"}


@compiled("int64(int64, int64)")
def additions(count: int, step: int) -> int:
    """Add up a chain that cannot be shortened: each sum is rotated by what came before."""
    total = step
    for _ in range(count):
        total = (total + step) ^ 1
    return total


def rate() -> float:
    """Return cycles a second of this processor: two operations of one cycle each in a chain."""
    count = 20_000_000
    return 2.0 * count / in_turn({"": lambda: additions(count, 3)}, 5)[""].min()


def bandwidth() -> float:
    """Return bytes a second that one core reads and writes of arrays that no cache holds."""
    source = np.ones(1 << 25)
    target = np.empty_like(source)
    return 2.0 * source.nbytes / in_turn({"": lambda: np.copyto(target, source)}, 5)[""].min()


def worked(name: str, times: int) -> None:
    """Do an operation so often, for valgrind."""
    function = OPERATIONS[name].make()[0]
    for _ in range(times):
        function()


def counted(name: str, times: int) -> dict[str, int]:
    """Return what valgrind counts in a process that does an operation so often."""
    command = ["valgrind", "--tool=cachegrind", "--cache-sim=yes", "--cachegrind-out-file=/dev/null"]
    variables = os.environ | {"PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
    work = [sys.executable, "-c", f"import counts; counts.worked({name!r}, {times})"]
    here = {"cwd": Path(__file__).parent, "env": variables}
    done = subprocess.run([*command, *work], capture_output=True, text=True, check=True, **here)
    found = {}
    for key, pattern in COUNTED.items():
        match = re.search(rf"{pattern}: +([\d,]+)", done.stderr)
        assert match is not None, done.stderr
        found[key] = int(match[1].replace(",", ""))
    return found


@figures("benchmarks/why.md", "valgrind", operations=("inverse_dynamics",))
def counts(operations: tuple[str, ...] = USUAL) -> Iterator[tuple | str]:
    """Instructions and cache lines of operations, beside the time that the processor needs at the least.

    Valgrind counts them (`apt install valgrind`): each operation of `operations.py` runs once and several
    times, and the difference is counted, so that neither imports nor the first call are in it.  Counts hardly
    differ from run to run, nor with other load.  The processor's rate is that of a chain of additions, one a
    cycle.
    """
    cycles = rate()
    yield (
        f"{cycles / 1e9:.1f} GHz, {A_CYCLE:g} instructions granted a cycle, cache lines of {LINE} bytes, "
        f"{bandwidth() / 1e9:.0f} GB/s copied"
    )
    for name in operations:
        ours, problems, _ = OPERATIONS[name].make()
        many, times = repeated(ours)
        taken = in_turn({"": many}, 9)[""].min() / times / problems
        few, more = counted(name, 1), counted(name, 1 + times)
        instructions, lines, far = ((more[key] - few[key]) / times / problems for key in COUNTED)
        yield (
            "operation | instructions {:,.0f} | lines from L2 {:,.1f} | from memory {:,.2f} | least [us] "
            "{:.3g} | taken [us] {:.3g} | a cycle {:.1f}",
            OPERATIONS[name].words, instructions, lines, far, 1e6 * instructions / A_CYCLE / cycles,
            1e6 * taken, instructions / (taken * cycles),
        )  # fmt: skip


if __name__ == "__main__":
    show(counts(tuple(sys.argv[1:]) or USUAL))
