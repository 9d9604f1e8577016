"""Instructions and cache lines of operations, beside the time that the processor needs at the least for them.

Valgrind counts them (`apt install valgrind`): each operation of `operations.py` runs once and several times,
and the difference is counted, so that neither imports nor the first call are in it.  Counts hardly differ
from run to run, nor with other load.  The processor's rate is that of a chain of additions, one a cycle.
Prints Markdown.

    python benchmarks/counts.py [OPERATION ...]
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time

import numpy as np
from operations import OPERATIONS, repeated

from pepper_kin.kernels.compiled_function import compiled

USUAL = [
    "inverse_dynamics",
    "forward_dynamics",
    "mass_matrix",
    "inverse_dynamics_derivatives",
    "inverse_dynamics_batch",
    "forward_dynamics_batch",
    "ik_hand",
    "ik_hand_clear",
    "ik_batch",
    "check_one",
    "check_batch",
    "servo",
    "plan",
    "retime",
    "certificate",
    "twin",
    "twin_batch",
]
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
    count, best = 20_000_000, np.inf
    additions(10, 3)
    for _ in range(5):
        begin = time.process_time()
        additions(count, 3)
        best = min(best, time.process_time() - begin)
    return 2.0 * count / best


def bandwidth() -> float:
    """Return bytes a second that one core reads and writes of arrays that no cache holds."""
    source, best = np.ones(1 << 25), np.inf
    target = np.empty_like(source)
    for _ in range(5):
        begin = time.process_time()
        np.copyto(target, source)
        best = min(best, time.process_time() - begin)
    return 2.0 * source.nbytes / best


def counted(name: str, times: int) -> dict[str, int]:
    """Return what valgrind counts in a process that does an operation so often."""
    command = ["valgrind", "--tool=cachegrind", "--cache-sim=yes", "--cachegrind-out-file=/dev/null"]
    variables = os.environ | {"PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
    work = [sys.executable, __file__, "--run", name, str(times)]
    done = subprocess.run([*command, *work], env=variables, capture_output=True, text=True, check=True)
    found = {}
    for key, pattern in COUNTED.items():
        match = re.search(rf"{pattern}: +([\d,]+)", done.stderr)
        assert match is not None, done.stderr
        found[key] = int(match[1].replace(",", ""))
    return found


def row(name: str, cycles: float) -> str:
    """Return a row of the table."""
    ours, problems, _ = OPERATIONS[name].make()
    many, times = repeated(ours)
    spent = []
    for _ in range(9):
        begin = time.process_time()
        many()
        spent.append((time.process_time() - begin) / times / problems)
    few, more = counted(name, 1), counted(name, 1 + times)
    instructions, lines, far = ((more[key] - few[key]) / times / problems for key in COUNTED)
    least, taken = instructions / A_CYCLE / cycles, min(spent)
    return (
        f"| {OPERATIONS[name].words} | {instructions:,.0f} | {lines:,.1f} | {far:,.2f} | {1e6 * least:.3g} "
        f"| {1e6 * taken:.3g} | {instructions / (taken * cycles):.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("operations", nargs="*", default=USUAL)
    parser.add_argument("--run", nargs=2, metavar=("OPERATION", "TIMES"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        function = OPERATIONS[options.run[0]].make()[0]
        for _ in range(int(options.run[1])):
            function()
        return
    cycles = rate()
    print(
        f"{cycles / 1e9:.1f} GHz, {A_CYCLE:g} instructions granted a cycle, cache lines of {LINE} bytes, ",
        end="",
    )
    print(f"{bandwidth() / 1e9:.0f} GB/s copied\n")
    print("| operation | instructions | lines from L2 | from memory | least [us] | taken [us] | a cycle |")
    print("|---|---|---|---|---|---|---|")
    for name in options.operations:
        print(row(name, cycles), flush=True)


if __name__ == "__main__":
    main()
