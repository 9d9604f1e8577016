"""Fixtures that several packages share: Chromium, a kernel cache, commands and examples in process."""

import contextlib
import ctypes
import fcntl
import gc
import importlib
import io
import json
import os
import platform
import resource
import runpy
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any
from unittest import mock

import pytest

with contextlib.suppress(ImportError):  # before coal, with whose Boost it crashes where a connection is lost
    import qi  # noqa: F401

import pepper_kin as pk
from pepper_kin.cli import main
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.parallel_build import compiled_modules
from pepper_kin.kernels.store import cache_folder, is_known, kept_name
from pepper_kin.kernels.warm_up import Build
from pepper_kin.viewer import find_chromium
from pepper_kin.viewer.browser import CHROMIUM_FLAGS, CHROMIUM_VARIABLE

LARGE_PROCESS = 600e6
"""Memory from which on robots forget what is kept for them [bytes]."""
forget_from = [LARGE_PROCESS]
"""The same, and higher where not so much was forgotten the last time."""
NO_BROWSER = (
    "no Chromium, and none could be installed: pages, pictures and films were not tried; install one "
    "(Debian: apt-get install chromium) or name its program in PEPPER_KIN_CHROMIUM"
)


if sys.platform == "linux":
    # Arrays of 0.5 MB and more are given back when they go: glibc would raise this limit to 32 MB, and a
    # worker would keep the largest moment of every test.  Two arenas serve all threads.
    ctypes.CDLL(None).mallopt(-3, 1 << 19)
    ctypes.CDLL(None).mallopt(-8, 2)


class PatientSys:
    """`sys`, whose `settrace` tries again where another thread installs its trace function at the moment.

    Python 3.11 raises a RuntimeError there (CPython issue 98257): measured by coverage, the new thread would
    end before it began, and whoever waits for what it does would wait for ever.
    """

    def __getattr__(self, name: str) -> Any:
        return getattr(sys, name)

    @staticmethod
    def settrace(function: Any) -> None:
        """Install a trace function in this thread."""
        for _ in range(1000):
            with contextlib.suppress(RuntimeError):
                return sys.settrace(function)
            time.sleep(0.001)
        return sys.settrace(function)


if sys.version_info < (3, 12) and "coverage.collector" in sys.modules:
    threading._sys = sys.modules["coverage.collector"].sys = PatientSys()  # type: ignore[attr-defined]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the fuzz tests (`tests/fuzz`), and of continuous integration."""
    parser.addoption("--allowed-skips", metavar="FILE", help="fail on a skip whose reason is no line of FILE")
    group = parser.getgroup("fuzz", "fuzz tests: one property, three sizes")
    group.addoption(
        "--fuzz-size", choices=("small", "middle", "long"), default="small", help="seconds, minutes, hours"
    )
    group.addoption("--fuzz-seed", type=int, default=0, help="another seed is another set of cases")
    group.addoption(
        "--fuzz-part", default="0/1", metavar="K/N", help="one of N parts of the size, with its own cases"
    )
    group.addoption("--fuzz-report", metavar="FILE", help="write what was examined as JSON")
    group.addoption(
        "--fuzz-keep", metavar="DIR", default="build/fuzz", help="folder of the cases that failed"
    )


def other_skips(config: pytest.Config) -> list[str]:
    """Return the tests that were skipped for a reason that `--allowed-skips` does not list."""
    path = config.getoption("--allowed-skips")
    if not path:
        return []
    allowed = {line.strip() for line in Path(path).read_text(encoding="utf-8").splitlines()}
    skipped = config.pluginmanager.get_plugin("terminalreporter").stats.get("skipped", ())
    reasons = [(report.nodeid, report.longrepr[2].removeprefix("Skipped: ")) for report in skipped]
    return [f"{test}: {reason}" for test, reason in reasons if reason not in allowed]


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Let the run fail where a skip is not allowed; workers leave that to the process that started them."""
    if not hasattr(session.config, "workerinput") and other_skips(session.config):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print skips that are not allowed, and what the fuzz tests examined; write it with `--fuzz-report`."""
    if skips := other_skips(config):
        terminalreporter.section(f"skips that are not in {config.getoption('--allowed-skips')}", red=True)
        terminalreporter.write_line("\n".join(skips))
    tests = [found for outcome in ("passed", "failed") for found in fuzz_results(terminalreporter, outcome)]
    path = config.getoption("--fuzz-report")
    if path:
        report = {
            "format": 1,
            "version": pk.__version__,
            "date": time.strftime("%Y-%m-%d", time.gmtime()),
            "machine": f"Python {platform.python_version()}, {platform.machine()}",
            **{name: config.getoption(f"--fuzz-{name}") for name in ("size", "seed", "part")},
            "tests": sorted(tests, key=lambda test: test["test"]),
        }
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    if not tests:
        return
    write = terminalreporter.write_line
    terminalreporter.section(f"examined by the fuzz tests, size {config.getoption('--fuzz-size')}")
    properties: dict[str, list[float]] = {}
    for test in tests:
        for what, count, wrong in test["counts"]:
            sums = properties.setdefault(what, [0, 0, 0.0])
            # A test that counts several things spends its time on all of them: it is shared out evenly.
            for place, value in enumerate((count, wrong, test["seconds"] / len(test["counts"]))):
                sums[place] += value
    write(f"{'examined':>12} {'wrong':>7} {'seconds':>8}  property")
    for what, (count, wrong, seconds) in sorted(properties.items()):
        write(f"{count:>12,} {wrong:>7,} {seconds:>8.1f}  {what}")
    total = sum(test["seconds"] for test in tests)
    wrong = sum(sums[1] for sums in properties.values())
    write(f"{len(tests)} tests, {wrong:,} wrong cases, {total:.0f} s of processor time")
    for test in tests:
        if test["repeat"]:
            write(f"repeat: {test['repeat']}")


def fuzz_results(terminalreporter: Any, outcome: str) -> Iterator[dict[str, Any]]:
    """Yield what `tests/fuzz/conftest.py` noted of each test with an outcome."""
    for report in terminalreporter.stats.get(outcome, ()):
        noted = dict(report.user_properties)
        if "fuzz run" in noted:
            counts = [list(value) for name, value in report.user_properties if name == "fuzz"]
            yield {"test": report.nodeid, "outcome": report.outcome, **noted["fuzz run"], "counts": counts}


def pytest_configure(config: pytest.Config) -> None:
    """Keep bytecode even where the environment says otherwise, and machine code apart from the user's.

    Assertions take long to rewrite.  All processes share a folder of machine code that is kept from run to
    run, from before modules of tests are imported: some compute then.  Files are named by a hash of all that
    their code depends on, so a stale one is never read; `--cache-clear` empties the folder.
    """
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    kept = getattr(config, "cache", None)
    folder = Path(tempfile.mkdtemp(prefix="kernels-") if kept is None else kept.mkdir("kernels"))
    if not hasattr(config, "workerinput"):
        copy_code(cache_folder(), folder)
    os.environ["PEPPER_KIN_CACHE"] = str(folder)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Make the compiled functions that are missing, once for all processes, on all cores."""
    config = session.config
    if not hasattr(config, "workerinput") and not config.option.collectonly:
        missing = [name for name in compiled_modules() if not is_known(key_of(name))]
        if missing:
            print(f"making machine code: {len(missing)} parts", flush=True)
            Build(missing, only=True).finish(lambda progress: None)


def key_of(name: str) -> str:
    """Return the key of the machine code of a module."""
    importlib.import_module(name)
    return unit_of(name).key()


def copy_code(source: Path, folder: Path, names: Iterable[str] | None = None) -> Path:
    """Copy machine code to another folder, all of it or files of some names; return the folder."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    for path in source.glob("*.code") if names is None else (source / name for name in names):
        if not (folder / path.name).exists():
            shutil.copy(path, folder)
    return folder


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark what is solved by placo."""
    parameters = getattr(item, "callspec", None)
    if parameters is not None and parameters.params.get("solver") == "placo":
        item.add_marker("placo")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put tests in a browser first: one process then has them all, and no two browsers draw at once.

    Runs of hours are not ended by the time limit of a test.
    """
    items.sort(key=lambda item: item.get_closest_marker("browser") is None)
    for item in items if config.getoption("--fuzz-size") == "long" else ():
        item.add_marker(pytest.mark.timeout(0))


@pytest.fixture(scope="session")
def kernel_cache() -> Path:
    """The folder of machine code; tests of what a first use does have an empty one of their own."""
    return Path(os.environ["PEPPER_KIN_CACHE"])


@pytest.fixture(scope="session")
def made_code(kernel_cache: Path, child: Callable[..., CompletedProcess[str]]) -> Callable[[Path], Path]:
    """Let a folder have the machine code of the package, and that of kernels of everyday calls."""
    child("import pepper_kin as pk; pk.jobs.warm_up()")
    return lambda folder: copy_code(kernel_cache, folder)


@pytest.fixture(scope="session")
def made_units(kernel_cache: Path) -> Callable[[Path], Path]:
    """Let a folder have the machine code of the package's compiled functions, and no kernels."""
    names = [kept_name(key_of(name)) for name in compiled_modules()]
    return lambda folder: copy_code(kernel_cache, folder, names)


def memory_of_this_process() -> float:
    """Return what is resident [bytes]; 0 where the system does not tell."""
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * resource.getpagesize() if statm.exists() else 0.0


@pytest.fixture(autouse=True)
def small_process() -> Iterator[None]:
    """Let robots forget what is kept for them after tests that make a process large.

    Up to 64 checkers of scenes are kept for each robot, 2 to 13 MB each, and modules share robots.
    """
    yield
    if memory_of_this_process() > forget_from[0]:
        for thing in gc.get_objects():
            if issubclass(type(thing), pk.PepperModel):  # `isinstance` would ask proxies of what is gone
                vars(thing).get("kept", {}).clear()  # one whose construction failed has none
        gc.collect()
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
        forget_from[0] = max(LARGE_PROCESS, memory_of_this_process() + 100e6)


@pytest.fixture(scope="session")
def pepper() -> pk.PepperModel:
    """The default Pepper; tests that change its Pinocchio model load one of their own."""
    return pk.load_pepper()


PLAYWRIGHT = [
    [sys.executable, "-m", "playwright", "install", "chromium"],
    [
        sys.executable, "-c",
        "from playwright.sync_api import sync_playwright as start\n"
        "with start() as playwright: print(playwright.chromium.executable_path)",
    ],
]  # fmt: skip
APT = [
    ["apt-get", "-q", "update"],
    ["apt-get", "-qy", "-o", "DPkg::Lock::Timeout=120", "--no-install-recommends", "install", "chromium"],
    ["which", "chromium"],
]


def install_chromium() -> str:
    """Install Chromium, by apt-get as root and else by Playwright; return the path of its program.

    Raises:
        LookupError: Neither could; the text has the last line of each.
    """
    failures = []
    for commands in [APT, PLAYWRIGHT] if os.geteuid() == 0 and shutil.which("apt-get") else [PLAYWRIGHT]:
        try:
            for words in commands:
                path = command_output(words)
            command_output([path, "--version"])  # Playwright's needs libraries of the system
            return path
        except OSError as error:
            failures.append(str(error))
    raise LookupError("; ".join(failures))


def command_output(words: list[str]) -> str:
    """Return the last line that a command writes; raise `OSError` with it where the command fails."""
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    done = subprocess.run(
        words, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    lines = (done.stdout if done.returncode == 0 else done.stderr + done.stdout).strip().splitlines() or [""]
    if done.returncode:
        raise OSError(f"{' '.join(words[:4])}: {lines[-1]}")
    return lines[-1]


@pytest.fixture(scope="session")
def chromium_path(kernel_cache: Path) -> str:
    """Path of a Chromium, which is installed where there is none; tests are skipped where it cannot be."""
    with (kernel_cache.parent / "chromium.lock").open("w") as lock:  # one process installs, the others wait
        fcntl.flock(lock, fcntl.LOCK_EX)
        if (path := find_chromium()) is None:
            try:
                path = install_chromium()
            except LookupError as error:
                pytest.skip(f"{NO_BROWSER} ({error})")
            warnings.warn(f"no Chromium was found: installed {path} for tests in a browser", stacklevel=1)
            os.environ[CHROMIUM_VARIABLE] = path
    return path


@pytest.fixture(autouse=True)
def chromium_where_marked(request: pytest.FixtureRequest) -> None:
    """Let tests with the marker `browser` have a Chromium even where they only call what needs it."""
    if request.node.get_closest_marker("browser"):
        request.getfixturevalue("chromium_path")


@pytest.fixture(scope="session")
def browser(chromium_path: str) -> Iterator[object]:
    """A headless Chromium, driven by playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = [flag for flag in CHROMIUM_FLAGS if flag != "--headless"]
        chromium = playwright.chromium.launch(executable_path=chromium_path, args=arguments)
        yield chromium
        chromium.close()


def said(
    words: list[str], action: Callable[[], object], cwd: Path | str, environment: dict[str, str]
) -> CompletedProcess[str]:
    """What an action says in a folder, and how it ends, told as of a process with these words."""
    out, error, code = io.StringIO(), io.StringIO(), 0
    with (
        contextlib.chdir(cwd),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(error),
        mock.patch.object(sys, "argv", words),
        mock.patch.object(sys.modules["__main__"], "__package__", None),  # not `python -m pytest`
        mock.patch.dict(os.environ, environment),
    ):
        try:
            action()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
    return CompletedProcess(words, code, out.getvalue(), error.getvalue())


@pytest.fixture(scope="session")
def run() -> Callable[..., CompletedProcess[str]]:
    """Run `pepper-kin` in this process, which spares a test the start of another.

    That a process of its own ends likewise is seen in `tests/cli/test_cli_contract.py`.
    """

    def run_command(*arguments: str, cwd: Path | str, **environment: str) -> CompletedProcess[str]:
        return said(["pepper-kin", *arguments], main, cwd, environment)

    return run_command


@pytest.fixture(scope="session")
def child() -> Callable[..., CompletedProcess[str]]:
    """Run code by Python in a process of its own, which has to end well."""

    def run_code(code: str, *arguments: Any, text: str = "", **environment: Any) -> CompletedProcess[str]:
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, arguments)], input=text, capture_output=True, text=True,
            env={**os.environ, **{name: str(value) for name, value in environment.items()}}, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-3000:]
        return done

    return run_code


@pytest.fixture(scope="session")
def run_example() -> Callable[..., CompletedProcess[str]]:
    """Run a script of the folder `examples` in this process, as the main module that it is."""
    folder = Path(__file__).parents[1] / "examples"

    def run_script(name: str, *arguments: str, cwd: Path | str) -> CompletedProcess[str]:
        path = str(folder / name)
        return said([path, *arguments], lambda: runpy.run_path(path, run_name="__main__"), cwd, {})

    return run_script
