"""Sizes, parts, seeds and counts of fuzz tests: one property, three sizes by one argument (`--fuzz-size`).

A test that fails writes its seed and the values of its variables to a file in `--fuzz-keep`, and the command
that repeats it.  `python tests/fuzz/long_run.py` runs the long size in parts that can be interrupted.
"""

import json
import os
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SIZES = ("small", "middle", "long")
HERE = Path(__file__).parent
MOST_VALUES = 100_000
"""Arrays with more values are left out of the file of a case that failed."""

_asked = pytest.StashKey[list[list[int]]]()
_began = pytest.StashKey[float]()
_printed = pytest.StashKey[float]()


def part_of(config: pytest.Config) -> tuple[int, int]:
    """Return number and count of `--fuzz-part K/N`."""
    match = re.fullmatch(r"(\d+)/(\d+)", config.getoption("--fuzz-part"))
    if match is None or int(match[1]) >= int(match[2]):
        raise pytest.UsageError("--fuzz-part K/N: K from 0 to N - 1, such as 3/20")
    return int(match[1]), int(match[2])


@pytest.fixture(scope="session")
def amount(request: pytest.FixtureRequest) -> Callable[[int, int, int], int]:
    """Return the number of cases for the size asked: `amount(small, middle, long)`, or of one part of it."""
    config = request.config
    index, (_, parts) = SIZES.index(config.getoption("--fuzz-size")), part_of(config)

    def pick(small: int, middle: int, long: int) -> int:
        config.stash.setdefault(_asked, []).append([small, middle, long])
        return -(-(small, middle, long)[index] // parts)

    return pick


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Return the random generator of a test; `--fuzz-seed` and `--fuzz-part` change all of them."""
    seed, (part, parts) = request.config.getoption("--fuzz-seed"), part_of(request.config)
    return np.random.default_rng(seed if parts == 1 else (seed, part))


@pytest.fixture
def tried(
    request: pytest.FixtureRequest, record_property: Callable[[str, object], None]
) -> Callable[..., None]:
    """Count what a test has examined: `tried("IK answers", 1000, wrong=0)`; the summary adds these up.

    It may be called again and again: the sums are kept, and in the long size printed once in ten seconds.
    A test with wrong cases fails even where it asserts nothing.
    """
    sums: dict[str, list[int]] = {}
    config, item = request.config, request.node
    terminal, capture = (
        config.pluginmanager.getplugin(name) for name in ("terminalreporter", "capturemanager")
    )

    def add(what: str, count: int, wrong: int = 0) -> None:
        before = ("fuzz", (what, *sums.get(what, ())))
        if before in item.user_properties:
            item.user_properties.remove(before)
        known = sums.setdefault(what, [0, 0])
        known[0], known[1] = known[0] + int(count), known[1] + int(wrong)
        record_property("fuzz", (what, *known))
        late = time.monotonic() - config.stash.get(_printed, time.monotonic() - 9.0) > 10.0
        if (
            config.getoption("--fuzz-size") == "long"
            and late
            and terminal is not None
            and capture is not None
        ):
            config.stash[_printed] = time.monotonic()
            with capture.global_and_fixture_disabled():
                terminal.write_line(f"{item.name}: {known[0]:,} {what}, {known[1]:,} wrong")

    return add


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Note the processor time and the sizes of a test."""
    item.config.stash[_asked] = []
    item.stash[_began] = processor_seconds()
    yield
    item.stash[_began] = processor_seconds() - item.stash[_began]


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Note what ran; fail what counted wrong cases; keep the inputs of what failed."""
    if call.when != "call":
        yield
        return
    wrong = sum(value[2] for name, value in item.user_properties if name == "fuzz")
    failed = call.excinfo is not None and not call.excinfo.errisinstance(pytest.skip.Exception)
    command = repeat_command(item) if failed or wrong else None
    path = keep_case(item, call, command) if failed and command else None
    noted = {
        "oracle": oracle_of(item),
        "seconds": round(item.stash.get(_began, 0.0), 2),
        "sizes": item.config.stash.get(_asked, []),
        "repeat": command,
        "case": str(path) if path else None,
    }
    item.user_properties.append(("fuzz run", noted))
    outcome: Any = yield
    report = outcome.get_result()
    if wrong and report.outcome == "passed":
        report.outcome, report.longrepr = "failed", f"{wrong} wrong cases"
    if command:
        kept = f"\nits seed and inputs: {path}" if path else ""
        report.sections.append(("repeat", f"{command}{kept}"))


def processor_seconds() -> float:
    """Return the processor time of this process and of its children that ended [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def oracle_of(item: pytest.Item) -> str:
    """Return the first paragraph of a test's docstring, or of its module's: what is asked of what."""
    own = getattr(getattr(item, "function", None), "__doc__", None)
    module = getattr(getattr(item, "module", None), "__doc__", None)
    return " ".join((own or module or "").strip().partition("\n\n")[0].split())


def repeat_command(item: pytest.Item) -> str:
    """Return the command that repeats a test with the same cases."""
    options = (
        f"--fuzz-{name} {item.config.getoption(f'--fuzz-{name}')}" for name in ("size", "seed", "part")
    )
    return f"pytest -n 0 '{item.nodeid}' {' '.join(options)}"


def keep_case(item: pytest.Item, call: pytest.CallInfo[None], command: str) -> Path | None:
    """Write the variables of the test's functions, where it failed, as JSON; numbers come back exactly."""
    assert call.excinfo is not None
    frames = [entry for entry in call.excinfo.traceback if Path(entry.path).is_relative_to(HERE)]
    case = {
        "repeat": command,
        "error": f"{call.excinfo.typename}: {call.excinfo.value}"[:2000],
        "variables": {
            f"{frame.name}:{frame.lineno + 1}": {
                name: value
                for name, value in ((n, plain(v)) for n, v in frame.frame.f_locals.items())
                if value is not None and not name.startswith("@")  # pytest's, for its assertions
            }
            for frame in frames
        },
    }
    name = re.sub(r"\W+", "-", item.nodeid.removeprefix("tests/fuzz/")).strip("-")[:100]
    seed, (part, _) = item.config.getoption("--fuzz-seed"), part_of(item.config)
    path = Path(item.config.getoption("--fuzz-keep")) / f"{name}-{seed}-{part}.json"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(case, indent=1), encoding="utf-8")
    except OSError:
        return None
    return path


def plain(value: object, depth: int = 0) -> Any:
    """Return a value as JSON has it; None for what has no such form."""
    if isinstance(value, np.ndarray):
        return value.tolist() if value.size <= MOST_VALUES and value.dtype.kind in "biufU" else None
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, bytes):
        return {"hex": value[:MOST_VALUES].hex()}
    if depth < 4 and isinstance(value, (list, tuple)) and len(value) <= 1000:
        return [plain(part, depth + 1) for part in value]
    if depth < 4 and isinstance(value, dict) and len(value) <= 1000:
        return {str(key): plain(part, depth + 1) for key, part in value.items()}
    return None
