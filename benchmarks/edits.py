"""A developer's edits, timed: an edited comment, docstring or constant of the core, until there is an answer.

Each edit is made in a copy of its own, with nothing compiled by earlier ones (an empty cache folder), and the
program runs in a new process.  With `--before COMMIT` the same is done in a copy of that commit, interleaved.
With `--growth` a constant of one function is edited in a clone, the shipped files are made anew, and the
packed repository is weighed.  Prints Markdown.

    python benchmarks/edits.py --before 95bd4e3
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


def units_made(package: Path, cache: Path) -> int:
    """Return how many files of machine code the run left in the cache folder."""
    return len(list(cache.glob("*.code")))


def growth() -> tuple[int, int]:
    """Return the size of the packed repository before and after a function's change [bytes]."""
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "clone"

        def git(*words: str) -> str:
            name = ["-c", "user.name=Nobody", "-c", "user.email=nobody@example.org"]
            return subprocess.run(
                ["git", *name, *words], cwd=clone, check=True, capture_output=True, text=True
            ).stdout

        def packed() -> int:
            git("gc", "--quiet", "--prune=now")
            return sum(path.stat().st_size for path in (clone / ".git/objects/pack").iterdir())

        subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", str(HERE), str(clone)], check=True)
        before = packed()
        edited(clone, LOCAL, "RAISE = 4.0", "RAISE = 4.5")
        layout = copy_of(None, Path(folder) / "copy")
        edited(layout, LOCAL, "RAISE = 4.0", "RAISE = 4.5")
        variables = os.environ | {"PYTHONPATH": str(layout), "PEPPER_KIN_CACHE": f"{folder}/cache"}
        output = clone / "pepper_kin/kernels/data"
        subprocess.run(
            [sys.executable, "-m", "pepper_kin.jobs.shipping", "-o", str(output)],
            cwd=layout, env=variables, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        git("commit", "--quiet", "-am", "Edit one function")
        return before, packed()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--before", help="a commit to compare with")
    parser.add_argument("--growth", action="store_true", help="weigh the repository as well")
    options = parser.parse_args()
    print("| edited | in | program | which | wall [s] | processor [s] | made |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for words, file, old, new, what, program in EDITS:
        for which, commit in (("before", options.before), ("now", None)):
            if which == "before" and commit is None:
                continue
            with tempfile.TemporaryDirectory() as folder:
                package, cache = copy_of(commit, Path(folder) / "copy"), Path(folder) / "cache"
                edited(package, file, old, new)
                wall, processor = timed(package, program, cache)
                made = units_made(package, cache)
            place = file or "-"
            print(
                f"| {words} | {place} | {what} | {which} | {wall:.1f} | {processor:.1f} | {made} |",
                flush=True,
            )
    if options.growth:
        before, after = growth()
        print(f"\nOne edited function: the packed repository grows by {after - before} bytes.")


if __name__ == "__main__":
    main()
