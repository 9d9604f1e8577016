"""Common parts of benchmarks: registration, options, runs in turn with peers, one Markdown table.

A benchmark is a generator under `@figures(page)`.  Its parameters are the options of its command; it yields
the lines and the table rows that `show` prints.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import inspect
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[1]
LOGS = Path(os.environ.get("PEPPER_KIN_ROBOT_LOGS", HERE.parent / "shared" / "robot_logs"))
TYPES = {"int": int, "float": float, "str": str, "Path": Path}
ROBOTS = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ur_description/srdf/ur5.srdf"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "talos_data/srdf/talos.srdf"),
}


@dataclass(frozen=True)
class Figures:
    """A registered benchmark: function, page in `docs/`, its requirements, and options for a quick run."""

    make: Callable[..., Iterable[tuple | str] | None]
    page: str
    needs: str
    quick: dict[str, Any]


REGISTERED: dict[str, Figures] = {}


def figures(page: str, needs: str = "", **quick: Any) -> Callable:
    """Register a function under its name; `quick` holds its smallest sizes, which `--quick` uses."""

    def register(make: Callable) -> Callable:
        REGISTERED[make.__name__] = Figures(make, page, needs, quick)
        return make

    return register


def listed() -> dict[str, tuple[str, str, str]]:
    """Return module, page and requirements of each benchmark by name, without importing any."""
    found = {}
    for file in sorted(Path(__file__).parent.glob("*.py")):
        for node in ast.parse(file.read_text("utf-8")).body:
            for call in node.decorator_list if isinstance(node, ast.FunctionDef) else ():
                if isinstance(call, ast.Call) and ast.unparse(call.func) == "figures":
                    page, needs = ([ast.literal_eval(argument) for argument in call.args] + [""])[:2]
                    found[node.name] = file.stem, page, needs
    return found


def options_of(name: str, words: list[str]) -> dict[str, Any]:
    """Return the options of a benchmark from the words of its command, or exit with a message."""
    importlib.import_module(listed()[name][0])
    one = REGISTERED[name]
    parser = argparse.ArgumentParser(
        prog=f"run_all.py {name}", description=inspect.cleandoc(one.make.__doc__ or ""),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true", help=f"at its smallest: {one.quick}")
    parser.add_argument("words", nargs="*", help="values of the options, in their order")
    kinds, needed = {}, []
    for key, parameter in inspect.signature(one.make).parameters.items():
        default, option = parameter.default, {"default": argparse.SUPPRESS, "dest": key}
        if default is parameter.empty:
            needed.append(key)
        if default is False:
            parser.add_argument(f"--{key.replace('_', '-')}", action="store_true", **option)
            continue
        first = (default or ("",))[0] if isinstance(default, tuple) else default
        kinds[key] = (
            TYPES[str(parameter.annotation).split(" ")[0]]
            if first is None or first is parameter.empty
            else Path if isinstance(first, Path) else type(first)
        )  # fmt: skip
        many = {"nargs": "*"} if isinstance(default, tuple) else {}
        said = None if default is parameter.empty else f"({default})"
        parser.add_argument(f"--{key.replace('_', '-')}", type=kinds[key], help=said, **many, **option)
    given = vars(parser.parse_intermixed_args(words))
    options = one.quick if given.pop("quick") else {}
    words, parameters = given.pop("words"), inspect.signature(one.make).parameters
    for key, kind in kinds.items():
        if words and isinstance(parameters[key].default, tuple):
            options, words = options | {key: [kind(word) for word in words]}, []
        elif words:
            options, words = options | {key: kind(words[0])}, words[1:]
    options = options | given
    if missing := [key for key in needed if key not in options]:
        parser.error(f"missing: {', '.join(missing)}")
    return options


def run(name: str, words: list[str]) -> None:
    """Run a benchmark with the words of its command and print its tables."""
    options = options_of(name, words)
    show(REGISTERED[name].make(**options) or ())


def show(rows: Iterable[tuple | str]) -> None:
    """Print rows as Markdown, each as soon as it is available."""
    head: str | None = ""
    for row in rows:
        if isinstance(row, str):
            print(row if head is None else f"\n{row}", flush=True)
            head = None
            continue
        columns = [column.partition("{") for column in row[0].split(" | ")]
        if row[0] != head:
            head = row[0]
            print(f"\n| {' | '.join(name.strip() for name, *_ in columns)} |\n{'|---' * len(columns)}|")
        cells = zip(columns, row[1:], strict=True)
        print(
            f"| {' | '.join(_cell(value, brace + form) for (_, brace, form), value in cells)} |", flush=True
        )


def _cell(value: Any, form: str) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "**no**"
    return form.format(value) if form and not isinstance(value, str) else str(value)


def both_clocks() -> np.ndarray:
    """Return wall time and processor time [s]."""
    return np.array([time.perf_counter(), time.process_time()])


class Times(defaultdict):
    """Times of calls by name [s]: `answer = times("plan", function, ...)`."""

    def __init__(self, clock: Callable[[], float] = time.process_time) -> None:
        super().__init__(list)
        self.clock = clock

    def __call__(self, name: str, function: Callable, *arguments: Any, **options: Any) -> Any:
        begin = self.clock()
        try:
            return function(*arguments, **options)
        finally:
            self[name].append(self.clock() - begin)

    def at(self, name: str, *percents: float, unit: float = 1e3) -> Any:
        """Return percentiles of the times of a name, the median if none is named, in ms or another unit."""
        found = unit * np.percentile(self[name], percents or 50)
        return found if percents else float(found)


def timed(
    function: Callable, *arguments: Any, clock: Callable[[], float] = time.process_time, **options: Any
):
    """Return the result of a call, and its time [s]."""
    begin = clock()
    found = function(*arguments, **options)
    return found, clock() - begin


def in_turn(
    jobs: dict[str, Callable[[], object]], rounds: int, clock: Callable[[], float] = time.process_time
) -> dict[str, np.ndarray]:
    """Return times of jobs run in turn, after one untimed run each [s], shapes (rounds,) or (rounds, 2)."""
    times = Times(clock)
    for job in jobs.values():
        job()
    for _ in range(rounds):
        for name, job in jobs.items():
            times(name, job)
    return {name: np.array(spent) for name, spent in times.items()}


class Served:
    """A process of another interpreter that answers each JSON line with one; it may send one first."""

    def __init__(self, *command: object, **options: Any) -> None:
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - open as long as the process
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self._errors}
        self._process = subprocess.Popen([*map(str, command)], text=True, **pipes, **options)

    def ask(self, question: Any) -> Any:
        """Return the answer to a question."""
        print(json.dumps(question), file=self._process.stdin, flush=True)
        return self.read()

    def read(self) -> Any:
        """Return the next answer.

        Raises:
            RuntimeError: The process ended.
        """
        line = self._process.stdout.readline()
        if not line:
            self._errors.seek(0)
            raise RuntimeError(f"the process ended: {self._errors.read()[-300:]}")
        return json.loads(line)

    def close(self) -> None:
        self._process.communicate()
        self._errors.close()


def peer(make: Callable, *arguments: Any, **options: Any) -> Any:
    """Return a peer, or None, with a printed message, if it is not available."""
    try:
        return make(*arguments, **options)
    except (ImportError, RuntimeError, OSError) as error:
        print(f"{make.__name__} is left out: {error}")
        return None


def python(code: str, *words: str, **variables: str) -> str:
    """Return the output of a new process of this interpreter; raise if the process fails."""
    done = subprocess.run(
        [sys.executable, "-c", code, *words], env=os.environ | variables, stdout=subprocess.PIPE, text=True,
        check=True,
    )  # fmt: skip
    return done.stdout


def example_robot(name: str) -> Any:
    """Return a robot of example-robot-data by name, or Pepper."""
    import pepper_kin as pk

    if name == "pepper":
        return pk.load_pepper()
    share = Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share")))
    urdf, srdf = (share / "example-robot-data" / "robots" / file for file in ROBOTS[name])
    return pk.load_robot(urdf, srdf, [share])


@cache
def table() -> Any:
    """Return a scene with the table over which most benchmarks reach."""
    import pepper_kin as pk

    return pk.Scene().add_box("table", (0.40, 0.80, 0.03), (0.47, 0.05, 0.715))


def laid_out(commit: str | None, folder: Path, *names: str) -> Path:
    """Write the package, or the named paths, of a commit into a folder, or the package of this work tree.

    The package has the layout of a wheel.
    """
    places = dict.fromkeys(names, "") or {"pepper_kin": "", "planners": "pepper_kin/", "urdf": "pepper_kin/"}
    for name, place in places.items():
        if commit is None:
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(HERE / name, folder / f"{place}{name}", ignore=ignored)
            continue
        packed = subprocess.check_output(["git", "archive", commit, name], cwd=HERE)
        with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
            archive.extractall(folder / place, filter="data")
    return folder


def pairs(rows: Any) -> list:
    """Return successive pairs of rows: first and second, third and fourth, ..."""
    return list(zip(rows[::2], rows[1::2], strict=False))
