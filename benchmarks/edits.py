"""A developer's edits, timed: an edited comment, docstring or constant of the core, until there is an answer.

Each edit is made in a copy of its own, whose machine code was all made before the edit, and the program runs
in a new process.  With `--before COMMIT` the same is done in a copy of that commit, interleaved.  Prints
Markdown.

    python benchmarks/edits.py --before HEAD~1
"""

from __future__ import annotations

import argparse
import io
import os
import re
import resource
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
IK = """
import pepper_kin as pk
pepper = pk.load_pepper()
point = (0.38, 0.22, 0.82)
assert pk.ik.solve(pepper, [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]).success
"""
HOME = re.search(r"^```python\n(.*?)^```", (HERE / "docs" / "index.md").read_text("utf-8"), re.M | re.S)[1]
LOCAL = "core/inverse_kinematics/local_solver.py"
BALLS = "core/collision/ball_check.py"
ALGEBRA = "core/linear_algebra.py"
EDITS = [
    ("nothing", None, "", "", "home page's program", HOME),
    ("a comment", ALGEBRA, "import math\n", "import math  # a comment\n", "home page's program", HOME),
    ("a docstring", ALGEBRA, '"""Return sum', '"""Return the sum', "home page's program", HOME),
    ("a constant", LOCAL, "RAISE = 4.0", "RAISE = 4.5", "one IK", IK),
    ("a constant", BALLS, "1.0 + 2.0**-22", "1.0 + 2.0**-21", "home page's program", HOME),
]
"""Words, file, what it has, what it gets, program."""


def copy_of(commit: str | None, folder: Path) -> Path:
    """Lay the package out as a wheel does: as it is here, or as a commit has it."""
    for name, place in (("pepper_kin", ""), ("planners", "pepper_kin/"), ("urdf", "pepper_kin/")):
        if commit is None:
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(HERE / name, folder / f"{place}{name}", ignore=ignored)
        else:
            packed = subprocess.run(
                ["git", "archive", commit, name], cwd=HERE, capture_output=True, check=True
            ).stdout
            with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
                archive.extractall(folder / place, filter="data")
    return folder


def edited(package: Path, file: str | None, old: str, new: str) -> None:
    """Edit a file; it must have the text."""
    if file is not None:
        path = package / "pepper_kin" / file
        text = path.read_text("utf-8")
        assert old in text, (file, old)
        path.write_text(text.replace(old, new, 1), "utf-8")


def timed(package: Path, program: str, cache: Path) -> tuple[float, float]:
    """Run a program; return wall-clock time and processor time, that of processes it started included [s]."""
    variables = os.environ | {"PYTHONPATH": str(package), "PEPPER_KIN_CACHE": str(cache)}
    variables.pop("PYTHONDONTWRITEBYTECODE", None)
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", program], cwd=package, env=variables, check=True, capture_output=True
    )
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def units_made(cache: Path) -> int:
    """Return how many files of machine and portable code a cache folder has."""
    return len(list(cache.glob("*.code")))


def made(package: Path, cache: Path) -> Path:
    """Make all machine code of a copy, and what the programs need besides; return the cache folder."""
    for program in ("import pepper_kin as pk; pk.jobs.warm_up()", IK, HOME):
        timed(package, program, cache)
    return cache


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--before", help="a commit to compare with")
    options = parser.parse_args()
    print("| edited | in | program | which | wall [s] | processor [s] | made |")
    print("|---|---|---|---|---|---|---|", flush=True)
    commits = {"before": options.before, "now": None} if options.before else {"now": None}
    with tempfile.TemporaryDirectory() as place:
        whole = {which: copy_of(commit, Path(place) / which) for which, commit in commits.items()}
        caches = {which: made(package, Path(place) / f"{which} code") for which, package in whole.items()}
        for words, file, old, new, what, program in EDITS:
            for which in commits:
                # Processes that make the rest of the machine code may outlive the program by a moment.
                with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                    package = Path(shutil.copytree(whole[which], Path(folder) / "copy"))
                    cache = Path(shutil.copytree(caches[which], Path(folder) / "code"))
                    count = units_made(cache)
                    edited(package, file, old, new)
                    wall, processor = timed(package, program, cache)
                    count = units_made(cache) - count
                row = (words, file or "-", what, which, f"{wall:.1f}", f"{processor:.1f}", count)
                print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
