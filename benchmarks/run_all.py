"""Every figure of the docs by one command each, and operations beside an earlier commit.

`NAME [--quick] ...` runs a benchmark and prints its tables as the page has them, `NAME --help` tells its
options, and `--list` tells names, pages and what each needs.  With `--at COMMIT` right behind the name it
runs with the package of an earlier commit.  Without a name operations are compared: two processes, one with
each commit's package, take turns at every operation of `operations.py`; a peer takes its turn in the newer
one.  Ratios of processor time are compared, so that other load and the machine's speed cancel out.  A
ratio fell where it is below one by more than three standard errors of its median and by more than 4 %,
twice in a row, the second time over three times as many turns; then the exit code is 1.  With `--keep` the
ratios are appended to `history.csv`, which tells what has become faster or slower since its first commit.

    python benchmarks/run_all.py ik_rows --rows 5000
    python benchmarks/run_all.py --beside 6fe442b5 --keep
    python benchmarks/run_all.py trajectory --at 6fe442b5 --certificate
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path

import numpy as np
from harness import HERE, Served, laid_out, listed, run, show
from operations import OPERATIONS, Operation

HISTORY = HERE / "benchmarks" / "history.csv"
SHARE, ERRORS = 0.04, 3.0


@dataclass(frozen=True)
class Compared:
    """An operation at two commits: a row of the history; microseconds are processor time of this machine.

    The newer commit has "+" behind it where files were changed since; the ratio is the time at the earlier
    commit over that now, nan where the earlier one cannot do it, with the standard error of its median;
    `over_peer` is the peer's time over ours.
    """

    commit: str
    beside: str
    operation: str
    microseconds: float
    ratio: float
    error: float
    peer: str = ""
    over_peer: float = float("nan")

    @property
    def fell(self) -> bool:
        return self.ratio < 1.0 - max(ERRORS * self.error, SHARE)


class Side(Served):
    """A process that serves operations with the package of one commit, its machine code kept in a folder."""

    def __init__(self, package: Path, folder: Path) -> None:
        command = sys.executable, HERE / "benchmarks" / "operations.py"
        super().__init__(*command, env=environment(package, folder))

    def ask(self, words: str) -> float:
        """Return the answer; nan where the operation cannot be done."""
        answer = super().ask(words)
        if isinstance(answer, str):
            print(f"<!-- {words}: {answer} -->")
            return float("nan")
        return float(answer)


def environment(package: Path, folder: Path) -> dict[str, str]:
    """Return the variables of a process that uses the package of a folder, on one thread."""
    variables = {"PYTHONPATH": str(package), "PEPPER_KIN_CACHE": str(folder), "OPENBLAS_NUM_THREADS": "1"}
    return os.environ | variables


def compared(name: str, commits: tuple[str, str], sides: list[Side], turns: int) -> Compared:
    """Let both sides, and a peer where there is one, take turns."""
    before, now = sides
    with_peer = now.ask(f"make {name}") == 1.0
    can = not np.isnan(before.ask(f"make {name}"))
    rows = []
    for turn in range(turns):
        order = [(before, "ours"), (now, "ours")][:: 1 if turn % 2 else -1]
        spent = {side: side.ask(word) if can or side is now else np.nan for side, word in order}
        rows.append((spent[before], spent[now], now.ask("peer") if with_peer else np.nan))
    old, new, peer = np.array(rows).T
    ratio = old / new
    spread = 1.4826 * np.median(np.abs(ratio - np.median(ratio)))
    said = OPERATIONS[name].peer
    return Compared(
        commits[1], commits[0], name, round(1e6 * float(np.median(new)), 3),
        round(float(np.median(ratio)), 3), round(float(1.253 * spread / np.sqrt(turns)), 4),
        f"{said[0]} {version(said[1])}" if said else "", round(float(np.median(peer / new)), 2),
    )  # fmt: skip


def history() -> list[Compared]:
    """Return the rows that are kept."""
    if not HISTORY.exists():
        return []
    kinds = {field.name: float if field.type == "float" else str for field in fields(Compared)}
    with HISTORY.open(encoding="utf-8", newline="") as file:
        return [Compared(**{k: kinds[k](v) for k, v in row.items()}) for row in csv.DictReader(file)]


def keep(rows: list[Compared]) -> None:
    """Append rows to the history."""
    new = not HISTORY.exists()
    with HISTORY.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Compared)], lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def operations(beside: str, turns: int, only: str, folder: Path) -> list[Compared]:
    """Print the table of all operations and return its rows."""
    git = ["git", "-C", str(HERE)]
    head = subprocess.check_output([*git, "rev-parse", "--short=8", "HEAD"], text=True).strip()
    changed = subprocess.check_output([*git, "status", "--porcelain", "pepper_kin", "planners", "urdf"])
    commits = beside, head + ("+" if changed else "")
    packages = [laid_out(beside, folder / "before"), laid_out(None, folder / "now")]
    sides = [Side(package, folder / f"{package.name} cache") for package in packages]
    past, rows = history(), []

    def cells() -> Iterator[tuple]:
        for name, operation in OPERATIONS.items():
            if re.search(only, f"{name} {operation.page}"):
                row = compared(name, commits, sides, turns)
                if row.fell:  # other programs can do that once
                    row = compared(name, commits, sides, 3 * turns)
                rows.append(row)
                yield cells_of(row, operation, past)

    show(cells())
    for side in sides:
        side.close()
    return rows


def cells_of(row: Compared, operation: Operation, past: list[Compared]) -> tuple:
    """Return a row of the table."""
    chain = [kept.ratio for kept in past if kept.operation == row.operation and np.isfinite(kept.ratio)]
    ratio = f"{row.ratio:.3f} +- {row.error:.3f}" if np.isfinite(row.ratio) else "new"
    return (
        f"operation | page | now [us] {{:.2f}} | at {row.beside} over now | since the first kept {{:.2f}} | "
        "peer over now | ",
        operation.words, operation.page, row.microseconds, ratio,
        np.prod([*chain, row.ratio]) if chain else "-",
        f"{row.over_peer:.1f} ({row.peer})" if row.peer else "-", "**slower**" if row.fell else "",
    )  # fmt: skip


def at(commit: str, name: str, words: list[str]) -> int:
    """Run a benchmark with the package of an earlier commit."""
    with tempfile.TemporaryDirectory() as folder:
        package = laid_out(commit, Path(folder) / "copy")
        command = [sys.executable, __file__, name, *words]
        return subprocess.run(command, env=environment(package, Path(folder) / "cache")).returncode


def main() -> int:
    """Print the tables; return 1 where a ratio fell."""
    if sys.argv[1:] and sys.argv[1] in listed():
        name, *words = sys.argv[1:]
        if words[:1] == ["--at"]:
            return at(words[1], name, words[2:])
        run(name, words)
        return 0
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--beside", help="the earlier commit; the last one of the history if left out")
    parser.add_argument("--turns", type=int, default=11)
    parser.add_argument("--only", default="", help="pattern of the operations' names and pages")
    parser.add_argument("--keep", action="store_true", help="append to the history")
    parser.add_argument("--list", action="store_true", help="names, pages and needs of all benchmarks")
    options = parser.parse_args()
    if options.list:
        rows = listed().items()
        show(("name | page | needs", name, page, needs) for name, (_, page, needs) in rows)
        return 0
    past = history()
    beside = options.beside or (past[-1].commit.rstrip("+") if past else "HEAD~1")
    with tempfile.TemporaryDirectory() as folder:
        rows = operations(beside, options.turns, options.only, Path(folder))
    if options.keep:
        keep(rows)
    return int(any(row.fell for row in rows))


if __name__ == "__main__":
    sys.exit(main())
