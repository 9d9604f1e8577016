"""Machine code between guard pages: no access past an array, to freed memory, or to what nobody wrote.

Children run jobs of the whole core (`core_job.py`) with every array right in front of a page that may not be
touched, then right behind one (`guarded_memory.py`): the processor itself is the judge.  All results must be
those of a child with ordinary memory, to the last bit.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
JOBS = ("ik", "placing", "plans", "quantities", "searches", "sensors", "servo", "timings", "twin", "verdicts")
IN_SMALL = ("ik", "quantities", "twin")
MOST_SECONDS = 3600.0
TASKS = 12
"""Cases in one child."""


def child(**options: Any) -> subprocess.CompletedProcess[str]:
    """Run jobs in a separate process."""
    command = [sys.executable, str(HERE / "core_job.py"), json.dumps(options)]
    return subprocess.run(command, capture_output=True, text=True, timeout=MOST_SECONDS, cwd=HERE.parents[1])


def answer(found: subprocess.CompletedProcess[str], **options: Any) -> dict[str, Any]:
    """Return what a child printed; its last words, where it did not end well."""
    repeat = f"python tests/fuzz/core_job.py '{json.dumps(options)}'"
    assert found.returncode == 0, f"{repeat}\nended with {found.returncode}:\n{found.stderr[-4000:]}"
    said: dict[str, Any] = json.loads(found.stdout)
    return said


@pytest.mark.parametrize("job", JOBS)
def test_results_are_the_same_between_guard_pages(job, amount, rng, tried, request):
    small = request.config.getoption("--fuzz-size") == "small"
    if small and job not in IN_SMALL:
        pytest.skip("in a larger size")
    left = amount(1, 1 if job == "searches" else 3, 1200)  # their checkers in Python make many arrays
    while left > 0:
        options = {"jobs": [job], "count": min(left, TASKS), "seed": int(rng.integers(2**31))}
        usual = answer(child(**options), **options)
        for guard in ("after",) if small else ("after", "before"):
            options["guard"] = guard
            guarded = answer(child(**options), **options)
            same = guarded["jobs"][job]["parts"] == usual["jobs"][job]["parts"]
            assert same, f"python tests/fuzz/core_job.py '{json.dumps(options)}' differs from ordinary memory"
            tried("results of machine code between guard pages", guarded["jobs"][job]["results"])
            tried("calls of compiled functions between guard pages", sum(guarded["calls"].values()))
        left -= TASKS


@pytest.mark.parametrize(("job", "guard"), [("overrun", "after"), ("underrun", "before"), ("late", "after")])
def test_what_goes_past_an_end_is_a_fault(job, guard, tried):
    """A kernel on memory that is one number short, and on memory that is freed, ends the child."""
    found = child(jobs=[job], count=1, seed=0, guard=guard)
    assert found.returncode == -signal.SIGSEGV, found.stderr[-2000:]
    assert child(jobs=["ready"], count=1, seed=0, guard=guard).returncode == 0
    tried("deliberate faults between guard pages, noticed", 1)
