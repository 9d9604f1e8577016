"""The long size of all fuzz tests, in parts, within a budget of time; it goes on where it was interrupted.

    python tests/fuzz/long_run.py --hours 8
    python tests/fuzz/long_run.py --hours 1 --files dynamics guard_pages --parts 40

Every file of tests runs `--fuzz-size long` in N parts (`--fuzz-part K/N`), each in a separate process, all
files before the next part: a run that is ended early has examined some of everything.  What a part examined
is written to `--folder` when it ends; a part that is there is not run again.  At the end `report.json` there
has the sums, in the form of `--fuzz-report`; `python docs/make_verification.py FILE...` makes the page.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

TESTS = Path(__file__).parent
ROOT = TESTS.parents[1]
LONGEST_PART = 3 * 3600.0  # [s]; a part that takes longer hangs


def main() -> int:
    """Run the parts that are left; return 1 if anything failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--hours", type=float, default=8.0, help="no part is begun later")
    parser.add_argument("--parts", type=int, default=20, help="number of parts of every test")
    parser.add_argument("--files", nargs="*", default=[], help="names, such as dynamics for test_dynamics.py")
    parser.add_argument("--size", choices=("small", "middle", "long"), default="long")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "fuzz" / "long")
    options = parser.parse_args()
    names = options.files or sorted(path.stem.removeprefix("test_") for path in TESTS.glob("test_*.py"))
    options.folder.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + 3600.0 * options.hours
    left = [(part, name) for part in range(options.parts) for name in names]
    for number, (part, name) in enumerate(left):
        path = options.folder / f"{name}-{options.size}-{part}-of-{options.parts}.json"
        if path.exists():
            continue
        if time.monotonic() >= end:
            print(f"the time is over: {number} of {len(left)} parts are done; the same command goes on")
            break
        began = time.monotonic()
        code = run_part(name, options.size, f"{part}/{options.parts}", path, options.folder)
        print(
            f"{number + 1}/{len(left)}  {said(name, path, code)}, {time.monotonic() - began:.0f} s",
            flush=True,
        )
    report = summed(sorted(options.folder.glob(f"*-{options.size}-*-of-{options.parts}.json")))
    (options.folder / "report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    return print_sums(report)


def run_part(name: str, size: str, part: str, path: Path, folder: Path) -> int:
    """Run one part of a file of tests; return the exit code of pytest, or of the signal that ended it."""
    new = path.with_suffix(".new")
    command = [
        *(sys.executable, "-m", "pytest", "-n", "0", str(TESTS / f"test_{name}.py")),
        *("--fuzz-size", size, "--fuzz-part", part, "--fuzz-report", str(new), "--fuzz-keep", str(folder)),
    ]
    with path.with_suffix(".log").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log, start_new_session=True)
        try:
            code = process.wait(LONGEST_PART)
        except (subprocess.TimeoutExpired, KeyboardInterrupt) as error:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            if isinstance(error, KeyboardInterrupt):
                raise
            code = -signal.SIGKILL
    if new.exists():
        new.replace(path)  # whole, or not at all
    return code


def said(name: str, path: Path, code: int) -> str:
    """Return one line about a part that ended."""
    if code not in (0, 1) or not path.exists():
        return f"{name}: ended with {code}; see {path.with_suffix('.log')}"
    tests = json.loads(path.read_text("utf-8"))["tests"]
    count = sum(count for test in tests for _, count, _ in test["counts"])
    failed = [test for test in tests if test["outcome"] != "passed"]
    repeat = "".join(f"\n    {test['repeat']}" for test in failed)
    return f"{name}: {count:,} examined, {len(failed)} of {len(tests)} tests failed{repeat}"


def summed(paths: list[Path]) -> dict[str, Any]:
    """Return one report of many: counts and seconds added up for each test."""
    total: dict[str, Any] = {}
    tests: dict[str, dict[str, Any]] = {}
    for path in paths:
        report = json.loads(path.read_text("utf-8"))
        total = {**report, "part": "0/1", "date": max(report["date"], total.get("date", ""))}
        for test in report["tests"]:
            known = tests.setdefault(test["test"], {**test, "counts": [], "seconds": 0.0})
            known["seconds"] = round(known["seconds"] + test["seconds"], 2)
            if test["outcome"] != "passed":
                known.update(outcome=test["outcome"], repeat=test["repeat"], case=test["case"])
            sums = {what: [count, wrong] for what, count, wrong in known["counts"]}
            for what, count, wrong in test["counts"]:
                before = sums.get(what, [0, 0])
                sums[what] = [before[0] + count, before[1] + wrong]
            known["counts"] = [[what, *numbers] for what, numbers in sums.items()]
    return {**total, "tests": [tests[name] for name in sorted(tests)]}


def print_sums(report: dict[str, Any]) -> int:
    """Print what was examined in all; return 1 if anything failed."""
    for test in report["tests"]:
        for what, count, wrong in test["counts"]:
            print(f"{count:>14,} {wrong:>6,} wrong  {what}")
    failed = [test for test in report["tests"] if test["outcome"] != "passed"]
    for test in failed:
        print(f"repeat: {test['repeat']}")
    print(f"{len(report['tests'])} tests, {len(failed)} failed")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
