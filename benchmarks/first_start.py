"""A newcomer's first quarter of an hour, timed: clone, environment, install, demonstration, README.

Everything is new: the clone, the environment, the folders for machine code.  Packages come from where pip
finds them, its download cache included.  Prints Markdown.

python benchmarks/first_start.py [--repository ADDRESS] [--python PYTHON]
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--repository", default=str(HERE), help="what to clone; this repository if left out")
    parser.add_argument("--python", default=sys.executable, help="the interpreter of the new environment")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        print("| step | time [s] |")
        print("|---|---|", flush=True)
        total = 0.0
        for step, command, where in steps(options.repository, options.python, place):
            seconds = timed(command, where, environment(place))
            total += seconds
            print(f"| {step} | {seconds:.0f} |", flush=True)
        print(f"| together | {total:.0f} |")


def steps(repository: str, python: str, place: Path) -> list[tuple[str, list[str], Path]]:
    """Return what a newcomer does: words, command, folder."""
    clone, script = place / "clone", place / "work" / "readme.py"
    script.parent.mkdir()
    new = str(clone / "env" / "bin" / "python")
    program = str(clone / "env" / "bin" / "pepper-kin")
    text = BLOCK.findall((HERE / "README.md").read_text(encoding="utf-8"))[0]
    script.write_text(text, encoding="utf-8")
    return [
        ("`git clone`", ["git", "clone", "--quiet", repository, str(clone)], place),
        ("`python3 -m venv env`", [python, "-m", "venv", "env"], clone),
        ("`pip install -e .`", [new, "-m", "pip", "install", "--quiet", "-e", "."], clone),
        ("`pepper-kin demo`", [program, "demo"], clone),
        ("`pepper-kin demo` again", [program, "demo"], clone),
        ("the README's Python, compiling", [new, str(script)], script.parent),
        ("the README's Python again", [new, str(script)], script.parent),
    ]


def environment(place: Path) -> dict[str, str]:
    """Return the variables of the processes: no machine code of earlier runs is found."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return {
        **kept,
        "PEPPER_KIN_CACHE": str(place / "kernels"),
        "NUMBA_CACHE_DIR": str(place / "numba"),
        "MPLCONFIGDIR": str(place / "matplotlib"),
    }


def timed(command: list[str], where: Path, variables: dict[str, str]) -> float:
    """Return the wall time of a command; what it says is shown only where it fails."""
    begin = time.perf_counter()
    done = subprocess.run(command, cwd=where, env=variables, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed with {done.returncode}:\n{done.stdout}{done.stderr}")
    return time.perf_counter() - begin


if __name__ == "__main__":
    main()
