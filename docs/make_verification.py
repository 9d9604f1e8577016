"""Write docs/verification.md from reports of fuzz tests.

    pytest tests/fuzz --fuzz-size middle --fuzz-report build/fuzz/middle.json
    python docs/make_verification.py build/fuzz/middle.json

The reports given, of what lies in tests/fuzz, take the place of those of their size in docs/verification/;
without any, the page is written of those that are there.  With `--compare` nothing is written: where the page
promises more than a report has is printed, and the exit code is 1.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

FOLDER = Path(__file__).parent
REPORTS = FOLDER / "verification"
SIZES = ("small", "middle", "long")
NEAR = 0.2
"""Share by which counts may fall short of the page's: of ties, and of searches that run out of time."""
HEAD = """# What is verified, how, and how often

Written by `python docs/make_verification.py` from the reports of the fuzz tests; no number is by hand.
Continuous integration compares the columns of the small and the middle size with its own runs.
Each property is asked of random cases: by a law, or by code that shares nothing with what it examines.
The same test has three sizes:

| size | when | how |
|---|---|---|
| small | in continuous integration, two minutes | `pytest tests/fuzz` |
| middle | in continuous integration, minutes | `pytest tests/fuzz --fuzz-size middle` |
| long | before a release, hours | `python tests/fuzz/long_run.py --hours 8` |

`--fuzz-seed N` asks about other cases, `--fuzz-report FILE` writes what was examined. A test that fails
prints the command that repeats it, and keeps its seed and inputs in `build/fuzz/`. The long run goes in
parts (`--parts 20`): it prints a line for each that ends, and goes on where it was interrupted. Its
report is `build/fuzz/long/report.json`. The parts below ran over several days, each on its day's code.

Two kinds of tests ask about memory. *Guard pages*: jobs of the whole core run in a process in which every
array ends at a page that may not be touched, then in one in which every array begins behind one; new
memory is full of NaN, freed memory is unmapped, and results must be those of ordinary memory to the last
bit. *Checks of bounds*: the same jobs run with `NUMBA_BOUNDSCHECK=1`, for which the core is compiled
again, with a test of every index; it works with any program. To run one job by hand:

```bash
python tests/fuzz/core_job.py '{"jobs": ["ik"], "count": 12, "seed": 0, "guard": "after"}'
NUMBA_BOUNDSCHECK=1 python tests/fuzz/core_job.py '{"jobs": ["ik"], "count": 12, "seed": 0}'
```

## Where it was run

| system | what was run | result |
|---|---|---|
| Debian 12, x86_64, Python 3.11.7 | continuous integration: everything | as below |
| Debian 12, Python 3.12.1 (2026-11-24) | tests of eight packages | 2,821 passed, 1 failed (1) |
| Debian 13 in a folder, Python 3.13.5 (2026-11-24) | tests of five packages | 1,599 passed (2) |
| no home, read-only install; ASCII locale; `-O`, `-OO`; spaces in names | demo and more | as elsewhere |
| pools of four processes beside a busy thread | batches of IK and plans | the same rows (3) |

(1) A list of machine code, of a source being edited. (2) Without libgomp 2,692 of eight packages passed, and
81 failed for want of it (D1). (3) One of 43 by spawn gave no answer in 300 s: not seen again, cause unknown.
Not run: macOS, Windows, other processors than x86-64 with AVX2, Python 3.14 and free-threaded Python.

Published numbers, other engines: [Validation](validation.md); faults and their tests: [Faults](faults.md).
"""


class Row(NamedTuple):
    """One property in one report."""

    what: str
    oracle: str
    count: int
    wrong: int


def main(paths: list[str]) -> None:
    """Keep reports and write the page, or compare a report with it."""
    if paths[:1] == ["--compare"]:
        found = [
            line for path in paths[1:] for line in differences(json.loads(Path(path).read_text("utf-8")))
        ]
        sys.exit("\n".join(found) if found else 0)
    REPORTS.mkdir(exist_ok=True)
    for path in paths:
        report = json.loads(Path(path).read_text("utf-8"))
        report["tests"] = [test for test in report["tests"] if test["test"].startswith("tests/fuzz/")]
        (REPORTS / f"{report['size']}.json").write_text(in_lines(report), "utf-8")
    files = {size: REPORTS / f"{size}.json" for size in SIZES}
    reports = {size: json.loads(file.read_text("utf-8")) for size, file in files.items() if file.exists()}
    (FOLDER / "verification.md").write_text(HEAD + page(reports), encoding="utf-8")


def in_lines(report: dict[str, Any]) -> str:
    """Return a report as JSON, with a line for each test, so that changes are read and merged by test."""
    rest = json.dumps({name: value for name, value in report.items() if name != "tests"})
    return f'{rest[:-1]},\n "tests": [\n' + ",\n".join(map(json.dumps, report["tests"])) + "\n]}\n"


def page(reports: dict[str, Any]) -> str:
    """Return the tables of reports by size."""
    titles = "size | last run | tests | failed | cases | wrong | processor time"
    text = f"\n## When\n\n| {titles} |\n{7 * '|---'}|\n"
    for size, report in reports.items():
        tests = report["tests"]
        failed = sum(test["outcome"] != "passed" for test in tests)
        cases, wrong = (sum(row[k] for row in rows(report)) for k in (2, 3))
        seconds = sum(test["seconds"] for test in tests)
        when = f"{report['date']}, {report['version']}, {report['machine']}"
        text += f"| {size} | {when} | {len(tests)} | {failed} |"
        text += f" {cases:,} | {wrong:,} | {spent(seconds)} |\n"
    by_file: dict[str, dict[str, dict[str, Row]]] = {}
    for size, report in reports.items():
        for (title, what), row in sums(report).items():
            by_file.setdefault(title, {}).setdefault(what, {})[size] = row
    for title in sorted(by_file):
        text += (
            f"\n## {Path(title).stem.removeprefix('test_').replace('_', ' ').capitalize()}\n\n`{title}`\n\n"
        )
        text += "| property | asked of | small | middle | long | wrong |\n|---|---|---|---|---|---|\n"
        for what, known in sorted(by_file[title].items()):
            counts = (f"{known[size].count:,}" if size in known else "–" for size in SIZES)
            wrong = sum(row.wrong for row in known.values())
            oracle = next(reversed(known.values())).oracle.replace("|", "\\|")
            text += f"| {what} | {oracle} | {' | '.join(counts)} | {wrong:,} |\n"
    return text


def sums(report: dict[str, Any]) -> dict[tuple[str, str], Row]:
    """Return the sums of a report by file and property."""
    found: dict[tuple[str, str], Row] = {}
    for test in report["tests"]:
        for row in rows({"tests": [test]}):
            key = test["test"].partition("::")[0], row.what
            before = found.get(key, row._replace(count=0, wrong=0))
            found[key] = before._replace(count=before.count + row.count, wrong=before.wrong + row.wrong)
    return found


def differences(report: dict[str, Any]) -> list[str]:
    """Return in words where the page's column of the report's size promises more than the report has.

    Numbers of wrong cases must be equal; counts may fall short by `NEAR` of the page's, and may grow: more
    calls and cases than the page states come with each change of the code that they examine.
    """
    size = report["size"]
    kept = sums(json.loads((REPORTS / f"{size}.json").read_text("utf-8")))
    found = {key: row for key, row in sums(report).items() if key[0].startswith("tests/fuzz/")}
    lines = [f"{file}: {what}: not examined now" for file, what in kept.keys() - found.keys()]
    lines += [f"{file}: {what}: not on the page ({size})" for file, what in found.keys() - kept.keys()]
    for key in kept.keys() & found.keys():
        was, now = kept[key], found[key]
        if was.wrong != now.wrong or was.count - now.count > max(5, NEAR * was.count):
            numbers = (
                f"{now.count:,}, {now.wrong} wrong; the page ({size}) has {was.count:,}, {was.wrong} wrong"
            )
            lines.append(f"{key[0]}: {key[1]}: {numbers}")
    return sorted(lines)


def rows(report: dict[str, Any]) -> Iterator[Row]:
    """Yield what each test of a report counted."""
    for test in report["tests"]:
        for what, count, wrong in test["counts"]:
            yield Row(what, test["oracle"], count, wrong)


def spent(seconds: float) -> str:
    """Return a time for people."""
    for unit, size in (("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


if __name__ == "__main__":
    main(sys.argv[1:])
