"""A newcomer's first quarter of an hour, timed: clone, environment, install, demonstration, first program.

Everything is new: the clone, the environment, the folders for machine code.  The program is
that of the documentation's home page.  Packages come from where pip finds them, its download cache included.
Then new processes are timed to their first answers, each several times.  With a wheel that brings machine
code the program runs from it as well, with an empty folder each time.  Prints Markdown.

python benchmarks/first_start.py [--repository ADDRESS] [--python PYTHON] [--wheel FILE]
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
HIDDEN = ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONDONTWRITEBYTECODE")
START = "import pepper_kin as pk; pepper = pk.load_pepper()"
IK = "tasks = [pk.ik.HandPosition('left', (0.38, 0.22, 0.82)), pk.ik.LookAt((0.38, 0.22, 0.82))]"
SCENE = "scene = pk.Scene().add_box('table', size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))"
PROGRAMS = {
    "an empty program": "pass",
    "`import numpy`": "import numpy",
    "`load_pepper()`": START,
    "first answer of `ik.solve`": f"{START}; {IK}; assert pk.ik.solve(pepper, tasks).success",
    "the same, `collisions=False`": (
        f"{START}; {IK}; assert pk.ik.solve(pepper, tasks, collisions=False).success"
    ),
    "first `plan`": f"{START}; {IK}; {SCENE}; assert pk.plan(pepper, pepper.neutral(), tasks, scene).success",
}
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--repository", default=str(HERE), help="what to clone; this repository if left out")
    parser.add_argument("--python", default=sys.executable, help="the interpreter of the new environment")
    parser.add_argument("--wheel", type=Path, help="a wheel that brings machine code")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        print("| step | wall [s] | processor [s] |")
        print("|---|---|---|", flush=True)
        total = 0.0
        for step, command, where in steps(options.repository, options.python, place):
            seconds, processor = timed(command, where, environment(place))
            total += seconds
            print(f"| {step} | {seconds:.1f} | {processor:.1f} |", flush=True)
        print(f"| together | {total:.0f} | |")
        print("\n| new process, median of 9 | wall [s] | processor [s] |")
        print("|---|---|---|", flush=True)
        new = str(place / "clone" / "env" / "bin" / "python")
        for words, program in PROGRAMS.items():
            runs = [timed([new, "-c", program], place, environment(place)) for _ in range(9)]
            wall, processor = (statistics.median(values) for values in zip(*runs, strict=True))
            print(f"| {words} | {wall:.2f} | {processor:.2f} |", flush=True)
        if options.wheel:
            wall, processor = from_wheel(options, place)
            print(f"| the home page's Python from the wheel, nothing kept | {wall:.2f} | {processor:.2f} |")


def from_wheel(options: argparse.Namespace, place: Path) -> tuple[float, float]:
    """Install the wheel in an environment; return the median times of the program, in an empty home each."""
    new = place / "installed" / "bin" / "python"
    timed([options.python, "-m", "venv", str(place / "installed")], place, environment(place))
    timed([str(new), "-m", "pip", "install", "--quiet", str(options.wheel)], place, environment(place))
    runs = []
    for k in range(5):
        variables = environment(place) | {"PEPPER_KIN_CACHE": str(place / f"empty {k}")}
        runs.append(timed([str(new), "home.py"], place / "work", variables))
    wall, processor = (statistics.median(values) for values in zip(*runs, strict=True))
    return wall, processor


def steps(repository: str, python: str, place: Path) -> list[tuple[str, list[str], Path]]:
    """Return what a newcomer does: words, command, folder."""
    clone, script = place / "clone", place / "work" / "home.py"
    script.parent.mkdir()
    new = str(clone / "env" / "bin" / "python")
    program = str(clone / "env" / "bin" / "pepper-kin")
    text = BLOCK.findall((HERE / "docs" / "index.md").read_text(encoding="utf-8"))[0]
    script.write_text(text, encoding="utf-8")
    return [
        ("`git clone`", ["git", "clone", "--quiet", repository, str(clone)], place),
        ("`python3 -m venv env`", [python, "-m", "venv", "env"], clone),
        ("`pip install -e .`", [new, "-m", "pip", "install", "--quiet", "-e", "."], clone),
        ("`pepper-kin demo`, interpreted", [program, "demo"], clone),
        ("the home page's Python, which makes its machine code", [new, str(script)], script.parent),
        ("`pepper-kin warm-up`, which makes the rest", [program, "warm-up"], clone),
        ("`pepper-kin demo` again", [program, "demo"], clone),
        ("the home page's Python again", [new, str(script)], script.parent),
    ]


def environment(place: Path) -> dict[str, str]:
    """Return the variables of the processes: no machine code of earlier runs is found."""
    kept = {name: value for name, value in os.environ.items() if name not in HIDDEN}
    return {
        **kept,
        "PEPPER_KIN_CACHE": str(place / "kernels"),
        "NUMBA_CACHE_DIR": str(place / "numba"),
        "MPLCONFIGDIR": str(place / "matplotlib"),
    }


def timed(command: list[str], where: Path, variables: dict[str, str]) -> tuple[float, float]:
    """Return wall and processor time of a command; what it says is shown only where it fails."""
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=where, env=variables, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed with {done.returncode}:\n{done.stdout}{done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begin, processor


if __name__ == "__main__":
    main()
