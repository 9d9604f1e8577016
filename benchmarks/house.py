"""What the package costs who starts with it or edits it, how large it is, and whether answers stay."""

from __future__ import annotations

import ast
import itertools
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from importlib.metadata import Distribution, distribution
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import numpy as np
from harness import HERE, figures, laid_out, python
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

LOADER = SourceFileLoader("check_sizes", str(HERE / ".ci" / "check_sizes"))
CHECK = module_from_spec(spec_from_loader(LOADER.name, LOADER))
LOADER.exec_module(CHECK)
HIDDEN = "PYTHONPATH", "VIRTUAL_ENV", "PYTHONDONTWRITEBYTECODE"
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
    ("a docstring", ALGEBRA, '"""Return', '"""At once return', "home page's program", HOME),
    ("a constant", LOCAL, "RAISE = 4.0", "RAISE = 4.5", "one IK", IK),
    ("a constant", BALLS, "1.0 + 2.0**-22", "1.0 + 2.0**-21", "home page's program", HOME),
]
"""Words, file, what it has, what it gets, program."""


def edited(package: Path, file: str | None, old: str, new: str) -> None:
    """Edit a file; it must have the text."""
    if file is not None:
        path = package / "pepper_kin" / file
        text = path.read_text("utf-8")
        assert old in text, (file, old)
        path.write_text(text.replace(old, new, 1), "utf-8")


def spent(
    command: list[str], where: Path, variables: dict[str, str], hidden: tuple[str, ...] = HIDDEN[2:]
) -> tuple[float, float]:
    """Run a command; return wall-clock time and processor time, that of processes it started included [s].

    What it says is shown only where it fails.
    """
    kept = {name: value for name, value in os.environ.items() if name not in hidden}
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, cwd=where, env=kept | variables, capture_output=True, text=True)
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed with {done.returncode}:\n{done.stdout}{done.stderr}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def of_program(package: Path, program: str, cache: Path) -> tuple[float, float]:
    """Return the times of a program that uses the package of a folder [s]."""
    variables = {"PYTHONPATH": str(package), "PEPPER_KIN_CACHE": str(cache)}
    return spent([sys.executable, "-c", program], package, variables)


def units_made(cache: Path) -> int:
    """Return how many files of machine and portable code a cache folder has."""
    return len(list(cache.glob("*.code")))


def made(package: Path, cache: Path) -> Path:
    """Make all machine code of a copy, and what the programs need besides; return the cache folder."""
    for program in ("import pepper_kin as pk; pk.jobs.warm_up()", IK, HOME):
        of_program(package, program, cache)
    return cache


@figures("benchmarks/edits.md", edits=1)
def edits(before: str = "", edits: int = len(EDITS)) -> Iterator[tuple]:
    """Edits, timed: an edited comment, docstring or constant of the core, until there is an answer.

    Each edit is made in a copy of its own, whose machine code was all made before the edit, and the program
    runs in a new process.  With `--before COMMIT` the same is done in a copy of that commit, interleaved.
    """
    commits = {"before": before, "now": None} if before else {"now": None}
    with tempfile.TemporaryDirectory() as place:
        whole = {which: laid_out(commit, Path(place) / which) for which, commit in commits.items()}
        caches = {which: made(package, Path(place) / f"{which} code") for which, package in whole.items()}
        for (words, file, old, new, what, program), which in itertools.product(EDITS[:edits], commits):
            # Processes that make the rest of the machine code may outlive the program by a moment.
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                package = Path(shutil.copytree(whole[which], Path(folder) / "copy"))
                cache = Path(shutil.copytree(caches[which], Path(folder) / "code"))
                count = units_made(cache)
                edited(package, file, old, new)
                times = of_program(package, program, cache)
                count = units_made(cache) - count
            yield (
                "edited | in | program | which | wall [s] {:.1f} | processor [s] {:.1f} | made",
                words, file or "-", what, which, *times, count,
            )  # fmt: skip


START = "import pepper_kin as pk; pepper = pk.load_pepper()"
TASKS = "tasks = [pk.ik.HandPosition('left', (0.38, 0.22, 0.82)), pk.ik.LookAt((0.38, 0.22, 0.82))]"
SCENE = "scene = pk.Scene().add_box('table', size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))"
PROGRAMS = {
    "an empty program": "pass",
    "`import numpy`": "import numpy",
    "`load_pepper()`": START,
    "first answer of `ik.solve`": f"{START}; {TASKS}; assert pk.ik.solve(pepper, tasks).success",
    "the same, `collisions=False`": (
        f"{START}; {TASKS}; assert pk.ik.solve(pepper, tasks, collisions=False).success"
    ),
    "first `plan`": f"{START}; {TASKS}; {SCENE}; "
    "assert pk.plan(pepper, pepper.neutral(), tasks, scene).success",
}


def steps(repository: str, python: str, place: Path) -> list[tuple[str, list[str], Path]]:
    """Return what a newcomer does: words, command, folder."""
    clone, script = place / "clone", place / "work" / "home.py"
    script.parent.mkdir()
    new = str(clone / "env" / "bin" / "python")
    program = str(clone / "env" / "bin" / "pepper-kin")
    script.write_text(HOME, encoding="utf-8")
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


@figures("benchmarks/first_start.md", "pip's packages", runs=1)
def first_start(
    repository: str = str(HERE), interpreter: str = sys.executable, wheel: Path | None = None, runs: int = 9
) -> Iterator[tuple]:
    """A newcomer's first quarter of an hour: clone, environment, install, demonstration, first program.

    Everything is new: the clone of the repository, the environment of the interpreter, the folders for
    machine code.  The program is that of the documentation's home page.  Packages come from where pip finds
    them, its download cache included.  Then new processes are timed to their first answers, each several
    times.  With a wheel that brings machine code the program runs from it as well, with an empty folder each
    time.
    """
    with tempfile.TemporaryDirectory() as folder:
        place, total = Path(folder), 0.0
        kept = {"PEPPER_KIN_CACHE": "kernels", "NUMBA_CACHE_DIR": "numba", "MPLCONFIGDIR": "matplotlib"}
        kept = {name: str(place / value) for name, value in kept.items()}
        for step, command, where in steps(repository, interpreter, place):
            times = spent(command, where, kept, HIDDEN)
            total += times[0]
            yield "step | wall [s] {:.1f} | processor [s] {:.1f}", step, *times
        yield "step | wall [s] {:.1f} | processor [s] {:.1f}", "together", total, ""
        head = "new process, median of 9 | wall [s] {:.2f} | processor [s] {:.2f}"
        new = str(place / "clone" / "env" / "bin" / "python")
        for words, program in PROGRAMS.items():
            found = [spent([new, "-c", program], place, kept, HIDDEN) for _ in range(runs)]
            yield head, words, *np.median(found, axis=0)
        if wheel:
            new, found = str(place / "installed" / "bin" / "python"), []
            spent([interpreter, "-m", "venv", str(place / "installed")], place, kept, HIDDEN)
            spent([new, "-m", "pip", "install", "--quiet", str(wheel)], place, kept, HIDDEN)
            for k in range(5):
                empty = kept | {"PEPPER_KIN_CACHE": str(place / f"empty {k}")}
                found.append(spent([new, "home.py"], place / "work", empty, HIDDEN))
            words = "the home page's Python from the wheel, nothing kept"
            yield head, words, *np.median(found, axis=0)


def size(found: Distribution) -> float:
    """Return the bytes of a package's files [MB]."""
    paths = (Path(str(found.locate_file(file))) for file in found.files or ())
    return sum(path.lstat().st_size for path in paths if path.exists()) / 1e6


def needed(name: str) -> list[str]:
    """Return what a package requires here, without extras."""
    rows = [Requirement(text) for text in distribution(name).requires or ()]
    return [canonicalize_name(r.name) for r in rows if r.marker is None or r.marker.evaluate({"extra": ""})]


def reached(names: list[str]) -> set[str]:
    """Return packages and all that they require."""
    found: set[str] = set()
    todo = list(names)
    while todo:
        name = todo.pop()
        if name not in found:
            found.add(name)
            todo += needed(name)
    return found


@figures("platforms.md", "a fresh environment with nothing but the library")
def install_sizes() -> Iterator[tuple]:
    """Size of the installed library by dependency, each with what it alone brings, and what several share."""
    direct = needed("pepper-kin")
    everything = reached(direct)
    sizes = {name: size(distribution(name)) for name in everything}
    counted: set[str] = set()
    rows = []
    for name in direct:
        alone = reached([name]) - reached([other for other in direct if other != name]) | {name}
        counted |= alone
        rows.append((sum(sizes[part] for part in alone), name, ", ".join(sorted(alone - {name}))))
    shared = sorted(everything - counted, key=sizes.__getitem__, reverse=True)
    own, several = size(distribution("pepper-kin")), sum(sizes[part] for part in shared)
    rows = [*sorted(rows, reverse=True), (several, "shared by several", ", ".join(shared))]
    for row in (*rows, (own, "the library itself", ""), (sum(sizes.values()) + own, "together", "")):
        yield "MB {:.1f} | package | with", *row


LOADS = re.compile(r"(load|store)_\w+|(word|single|double|integer|byte|float|lanes|row)s?_at")
"""Functions whose first argument is an address."""
CALLS = """
import sys
import numpy as np
import pepper_kin as pk

pepper, point = pk.load_pepper().with_requirements("limits"), (0.38, 0.22, 0.82)
tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
stand, goal = pepper.posture("Stand"), pk.ik.solve(pepper, tasks, scene=scene).q
servo = pk.servo.Servo(pepper, stand)
servo.set_target(tasks)
calls = {
    "`plan`, goal of tasks": lambda: pk.plan(pepper, stand, tasks, scene, timeout=60.0),
    "`plan`, goal of joints": lambda: pk.plan(pepper, stand, goal, scene, timeout=60.0),
    "`ik.solve`": lambda: pk.ik.solve(pepper, tasks),
    "`Servo.step`": lambda: servo.step(),
}
if hasattr(pk.motion, "LiveMotion"):  # a commit that has both
    from pepper_kin.learning import PepperVectorEnv

    env, live = PepperVectorEnv(8, "Reach"), pk.motion.LiveMotion(pepper, stand)
    env.reset(seed=0)
    live.set_goal(goal)
    moves = np.zeros(env.action_space.shape, np.float32)
    calls["`env.step`"] = lambda: env.step(moves)
    calls["`LiveMotion`, a cycle"] = lambda: (live.set_scene(scene, 0.0), live.step(0.0))
for name, call in calls.items():
    call()
    files = set()
    sys.setprofile(lambda frame, event, _: event == "call" and files.add(frame.f_code.co_filename))
    call()
    sys.setprofile(None)
    print(f"{name}|{len([file for file in files if '/pepper_kin/' in file])}")
"""


def modules(package: Path) -> dict[str, ast.Module]:
    """Return the syntax trees of the package by the names of its modules."""
    trees = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        trees[name] = ast.parse(path.read_text("utf-8"))
        trees[name].is_package, trees[name].path = parts[-1] == "__init__", path
    return trees


def imports(name: str, tree: ast.Module, known: set[str]) -> Iterator[tuple[set[str], bool, bool]]:
    """Yield modules that an import names, whether it is in a function, and whether for types alone."""

    def within(*kinds: type, test: str = "") -> set[int]:
        outer = (n for n in ast.walk(tree) if isinstance(n, kinds))
        return {id(i) for n in outer if not test or ast.unparse(n.test) == test for i in ast.walk(n)}

    functions = within(ast.FunctionDef, ast.AsyncFunctionDef)
    typed = within(ast.If, test="TYPE_CHECKING")
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                up = name.split(".")[: (1 - node.level if tree.is_package else -node.level) or None]
                base = ".".join([*up, *filter(None, [base])])
            if base.partition(".")[0] == "pepper_kin":
                found = {f"{base}.{alias.name}" for alias in node.names} & known
                yield found or {base}, id(node) in functions, id(node) in typed


def circles(arrows: dict[str, set[str]]) -> list[set[str]]:
    """Return the largest sets of modules each of which leads to every other one."""

    def reached(name: str) -> set[str]:
        visited, open_ = set(), [name]
        while open_:
            open_ += [
                new for new in arrows.get(open_.pop(), ()) if new not in visited and not visited.add(new)
            ]
        return visited

    after = {name: reached(name) for name in arrows}
    rings = {frozenset(other for other in after[name] if name in after.get(other, ())) for name in arrows}
    return sorted((set(ring) for ring in rings if len(ring) > 1), key=len, reverse=True)


def byte_offsets(tree: ast.Module) -> int:
    """Return how many addresses of loads and stores end with a literal number of bytes."""
    return sum(
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and LOADS.fullmatch(node.func.id) is not None
        and bool(node.args)
        and isinstance(node.args[0], ast.BinOp)
        and any(isinstance(side, ast.Constant) for side in (node.args[0].left, node.args[0].right))
        for node in ast.walk(tree)
    )


def lines(folder: Path) -> int:
    """Return the lines of all Python files of a folder."""
    return sum(path.read_bytes().count(b"\n") for path in folder.rglob("*.py"))


def code_lines(path: Path, tree: ast.Module) -> tuple[int, int]:
    """Return the lines with code, as `.ci/check_sizes` counts them, and how many of them are imports."""
    code = CHECK.code_lines(path.read_text("utf-8"), tree)
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    imports = {line for node in nodes for line in range(node.lineno, node.end_lineno + 1)}
    return len(code), len(code & imports)


def counted_of(commit: str | None) -> dict[str, int]:
    """Return each row's number for a commit, or for the sources here."""
    with tempfile.TemporaryDirectory() as place:
        layout = laid_out(commit, Path(place) / "copy")
        package, others = layout / "pepper_kin", HERE
        if commit is not None:
            others = laid_out(commit, Path(place), "tests", "benchmarks")
        trees = modules(package)
        arrows = {name: list(imports(name, tree, set(trees))) for name, tree in trees.items()}
        run = {name: set().union(*(to for to, _, typed in f if not typed)) for name, f in arrows.items()}
        every = {name: set().union(*(to for to, _, _ in found)) for name, found in arrows.items()}
        own = [code_lines(t.path, t) for name, t in trees.items() if not name.startswith("pepper_kin.urdf")]
        classes = Counter(n.name for t in trees.values() for n in ast.walk(t) if isinstance(n, ast.ClassDef))
        result = {
            "lines of library and planners": lines(package) - lines(package / "urdf"),
            "lines with code of library and planners": sum(code for code, _ in own),
            "share of imports in them [%]": round(
                100 * sum(i for _, i in own) / sum(code for code, _ in own), 1
            ),
            "lines of tests": lines(others / "tests"),
            "lines of benchmarks": lines(others / "benchmarks"),
            "class names that stand twice": sum(count > 1 for count in classes.values()),
            "imports of our own in functions": sum(inside for f in arrows.values() for _, inside, _ in f),
            "circles of files": len(circles(run)),
            "circles of files, imports for types counted": len(circles(every)),
            "literal byte offsets in `core/`": sum(
                byte_offsets(tree) for name, tree in trees.items() if name.startswith("pepper_kin.core")
            ),
        }
        printed = python(CALLS, PYTHONPATH=str(layout), PEPPER_KIN_CACHE=f"{place}/cache")
        for line in printed.splitlines():
            name, _, number = line.partition("|")
            result[f"files in which {name} runs"] = int(number)
        return result


@figures("benchmarks/edits.md")
def house(commits: tuple[str, ...] = ("95bd4e3", "10c88739")) -> Iterator[tuple]:
    """The size and the structure of the package, counted beside earlier commits.

    Lines of Python, imports of our own in functions, circles of files that import each other, literal byte
    offsets in addresses of the core's loads and stores, the files that a second call runs.
    """
    columns = [counted_of(commit) for commit in (*commits, None)]
    for name in columns[-1]:
        yield f"counted | {' | '.join(commits)} | now", name, *(column.get(name, "-") for column in columns)


PROGRAM = r"""
import sys, warnings
import numpy as np
import pepper_kin as pk

warnings.simplefilter("ignore")
counts = dict(zip(("verdicts", "ik", "plans", "timings", "runs"), map(int, sys.argv[2:])))
pepper, found = pk.load_pepper().with_requirements("limits"), {}
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
scene = scene.add_sphere("lamp", 0.06, (0.3, -0.3, 1.0)).add_cylinder("post", 0.05, 1.0, (0.2, 0.5, 0.5))
lower, upper = np.maximum(pepper.lower_limits, -3.0), np.minimum(pepper.upper_limits, 3.0)
stand = pepper.posture("Stand")
arms = [pepper.joint_index(name) for name in pepper.joint_names if name.startswith(("L", "R", "Head"))]


def postures(seed, count):
    q = np.tile(stand, (count, 1))
    q[:, arms] = np.random.default_rng(seed).uniform(lower[arms], upper[arms], (count, len(arms)))
    return q


q = np.random.default_rng(1).uniform(lower, upper, (counts["verdicts"], pepper.n))
found["verdicts"] = np.packbits(pk.collision.in_collision(pepper, q, scene))

rng, solved, where = np.random.default_rng(2), [], []
for k in range(counts["ik"]):
    side, point = ("left", "right")[k % 2], rng.uniform((0.1, -0.5, 0.4), (0.6, 0.5, 1.3))
    tasks = [pk.ik.HandPosition(side, point)] + [pk.ik.LookAt(point)] * (k % 3 == 0)
    result = pk.ik.solve(pepper, tasks, scene=scene if k % 4 == 0 else None)
    solved.append(result.status.value)
    where.append(result.q)
found["ik_status"], found["ik_q"] = np.array(solved), np.array(where)

free = [p for p in postures(3, 8 * counts["plans"]) if not pk.collision.in_collision(pepper, p, scene)]
planned, lengths = [], []
for k in range(counts["plans"]):
    start, goal = free[2 * k % len(free)], free[(2 * k + 1) % len(free)]
    plan = pk.plan(pepper, start, goal, scene, seed=k, timeout=30.0)
    planned.append(plan.status.value)
    lengths.append(plan.length if plan.success else 0.0)
found["plan_status"], found["plan_length"] = np.array(planned), np.array(lengths)

durations, shapes, trajectories = [], [], []
paths = postures(4, 5 * counts["timings"]).reshape(counts["timings"], 5, pepper.n)
for path in paths:
    trajectory = pk.retime(pepper, path)
    durations.append(trajectory.duration)
    shapes.append(trajectory(np.linspace(0.0, trajectory.duration, 33)).position)
    trajectories.append(trajectory)
found["duration"], found["position"] = np.array(durations), np.array(shapes)

states = []
for trajectory in trajectories[: counts["runs"]]:
    run = pk.Twin(pepper, timestep=0.001).execute(trajectory)
    states.append(np.concatenate([run.position[-1], run.velocity[-1], np.abs(run.torque).max(axis=0)]))
found["run"] = np.array(states)
np.savez(sys.argv[1], **found)
"""
TOLERANCE = 1e-6
COUNTS = (1_000_000, 10_000, 500, 1_000, 100)


def answers(commit: str | None, counts: tuple[int, ...], folder: Path) -> dict[str, np.ndarray]:
    """Compute with a commit, or with the sources as they are."""
    variables = {"PYTHONPATH": laid_out(commit, folder / "copy"), "PEPPER_KIN_CACHE": folder / "cache"}
    file = folder / "answers.npz"
    python(PROGRAM, str(file), *map(str, counts), **{name: str(value) for name, value in variables.items()})
    with np.load(file) as found:
        return dict(found)


@figures("benchmarks/edits.md", share=1e-3)
def reproduced(commit: str = "HEAD", share: float = 1.0) -> Iterator[tuple]:
    """Answers of an earlier commit beside those of the sources here: IK, plans, timings, runs.

    Both compute the same random problems, a share of those of the page, in new processes of this interpreter.
    Verdicts and statuses are counted where they differ; numbers are compared by their largest difference.
    Where an algorithm was changed on purpose in between, answers differ, and both are right: that is told
    apart by the tolerance that each quantity has, and by what both answers reach.
    """
    sizes = tuple(max(int(share * count), 2) for count in COUNTS)
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        old, new = answers(commit, sizes, Path(first)), answers(None, sizes, Path(second))
    head = f"answers | compared {{:,}} | other than at {commit} | largest difference of the others"
    verdicts = int(np.unpackbits(old["verdicts"] ^ new["verdicts"]).sum())
    yield head, "verdicts of collision", sizes[0], verdicts, ""
    for words, status, values, unit in (
        ("`ik.solve`", "ik_status", "ik_q", "rad"),
        ("`plan`, length of the path", "plan_status", "plan_length", "rad"),
        ("`retime`, duration", None, "duration", "s"),
        ("`retime`, positions", None, "position", "rad"),
        ("`Twin.execute`, last state and largest torques", None, "run", "SI"),
    ):
        gap = np.abs(old[values] - new[values]).reshape(len(old[values]), -1).max(axis=1)
        other = gap > TOLERANCE
        if status is not None:
            other |= old[status] != new[status]
            words += f", status of {int((old[status] != new[status]).sum())}"
        yield head, words, len(gap), int(other.sum()), f"{gap[~other].max(initial=0.0):.1e} {unit}"
