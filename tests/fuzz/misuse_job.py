"""Public functions called with one wrong argument, in a separate process.

    python misuse_job.py '{"package": "ik", "count": 30, "seed": 0}'

Public functions and constructors of a package have a call that works (`misuse_values.Values`); then one
argument at a time is replaced by what does not belong there.  What comes of it must be an error of the
library, or a TypeError or an AttributeError about an object of another type, or a result without NaN.  Prints
each call before it is made, so that the last one is known if the process ends, and a line of JSON for each
finding.
"""

from __future__ import annotations

import faulthandler
import importlib
import inspect
import json
import math
import os
import re
import resource
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from misuse_methods import methods_of
from misuse_values import Values

faulthandler.enable()
MOST_MEMORY = 6 << 30
MOST_SECONDS = 20
"""For a call; 20 times as much where indices are checked, as machine code is then made in calls."""
if os.environ.get("NUMBA_BOUNDSCHECK"):
    MOST_SECONDS, MOST_MEMORY = 20 * MOST_SECONDS, 2 * MOST_MEMORY
OURS = re.compile(r"/(pepper_kin|planners)/")


class Hangs(BaseException):
    """A call took too long."""


def wrong_values(valid: Any) -> Iterator[Any]:
    """Yield what does not belong in the place of a valid argument, or hardly."""
    yield from (math.nan, math.inf, -math.inf, -1, 0, -0.5, 1e300, -1e300, 10**400, 2**63, True, None, 1j)
    yield from ("", "no such thing", "nan", "1", "\0", "\ud800", "x" * 5000, b"bytes", [], {}, object(), int)
    yield from (
        [[1.0, 2.0], [3.0]],
        np.zeros(0),
        np.zeros((2, 3, 4)),
        np.array("text"),
        np.array([None, 1.0]),
    )
    yield from (
        [math.nan],
        {"no such thing": 1.0},
        {1: 2},
        ["no such thing"],
        [None],
        range(3),
        lambda *_: None,
    )
    yield np.array(["2020-01-01"], "datetime64[D]")
    if isinstance(valid, np.ndarray) and valid.dtype.kind == "f" and valid.size:
        for bad in (math.nan, math.inf, 1e300, -1e300):
            changed = valid.copy()
            changed.flat[valid.size // 2] = bad
            yield changed
        yield valid[..., :-1]
        yield np.concatenate([valid, valid], axis=-1)
        yield from (valid[:-1], valid[:1], valid[:0], valid[1:2], np.concatenate([valid, valid]))
        yield from (valid.astype(complex), valid.astype(str), valid.astype(object), valid[None][None])
        yield np.ma.masked_array(valid, np.ones(valid.shape, bool))


LEFT_OUT = {
    "plan_batch",
    "run_real_time",
    "clear_cache",
    "release_memory",
    "kept_while_private",
    "compiled",
    "CompiledFunction",
    "Kernel",
    "Integrator",
    "Recorder",
    "Recording",
    "load_recording",
    "load_run",
    "ompl_plan",
    "RobotMemory",
    "CompiledMotionValidator",
    "CompiledManifold",
    "PepperModel",
    "state_data",
    "over_states",
    "all_over_states",
    "kernel_ir",
    "compile_function",
    "read_choregraphe",
    "read_naoqi_export",
    "read_joint_states",
    "plot",
    "manifold_of",
    "Push",
    "Semantics",
}
"""Processes, clocks, caches; values that only the library makes; readers, which have separate fuzz tests."""


NAN_MEANS_NOTHING = {"PlacementMap.score_at", "Camera.project", "Integrator.step", "Integrator.run"}
"""Where the documentation says so: outside of a map or a picture, or of a state that diverges."""

CHECKED_LATER: dict[str, Callable[[Any, Values], Any]] = {
    "PlanProblem": lambda problem, _: problem.solve(),
    "Leg": lambda leg, values: plan_leg(leg, values),
}
"""Values whose attributes are checked where they are used, and that use."""


def plan_leg(leg: Any, values: Values) -> Any:
    """Plan a motion of one leg."""
    from pepper_kin.motion import plan_legs

    return plan_legs(values.samples.robot, values.samples.stand, [leg], values.samples.scene)


def calls_of(package: str, values: Values) -> Iterator[tuple[str, Callable[..., Any], dict[str, Any]]]:
    """Yield name, function and valid arguments by name of what a package offers, or of methods of objects."""
    if package.startswith("of_"):
        yield from methods_of(package, values.samples)
        return
    module = importlib.import_module(f"pepper_kin.{package}")
    for name in module.__all__:
        value = getattr(module, name)
        if (
            name in LEFT_OUT
            or not callable(value)
            or not hasattr(value, "__module__")
            or not made_by_users(value)
        ):
            continue
        for _, function, arguments in with_arguments(name, value, values):
            yield name, used(name, function, values), arguments


def used(name: str, function: Callable[..., Any], values: Values) -> Callable[..., Any]:
    """Return a function, or one that also uses the value that it makes."""
    use = CHECKED_LATER.get(name)
    return function if use is None else lambda **arguments: use(function(**arguments), values)


def made_by_users(value: Any) -> bool:
    """Whether a public name is a function, or a class whose objects users make."""
    if not inspect.isclass(value):
        return True
    if (
        issubclass(value, BaseException)
        or hasattr(value, "__members__")
        or getattr(value, "_is_protocol", False)
    ):
        return False
    results = (
        "Result",
        "Status",
        "Certificate",
        "Check",
        "Report",
        "Run",
        "Error",
        "Step",
        "State",
        "Pair",
        "Pairs",
    )
    return not (inspect.isabstract(value) or value.__name__.endswith(results) or hasattr(value, "_fields"))


def with_arguments(
    name: str, function: Callable[..., Any], values: Values
) -> Iterator[tuple[str, Callable[..., Any], dict[str, Any]]]:
    """Yield a function with its valid arguments, where all are known."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError:
        return
    arguments: dict[str, Any] = {}
    for parameter in parameters:
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD) or parameter.name.startswith(
            "_"
        ):
            continue
        arguments[parameter.name] = values.of(name, parameter)
    if not any(value is inspect.Parameter.empty for value in arguments.values()):
        yield name, function, arguments


def has_nan(value: Any, depth: int = 0) -> bool:
    """Whether a result holds NaN: in numbers, arrays, tuples and public attributes of frozen objects."""
    if isinstance(value, (float, np.floating)):
        return math.isnan(value)
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fc" and bool(np.isnan(value).any())
    if depth > 2 or isinstance(value, (str, bytes)):
        return False
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (tuple, list)):
        return any(has_nan(part, depth + 1) for part in value)
    inside = getattr(value, "__dict__", None)
    return inside is not None and any(has_nan(part, depth + 1) for part in inside.values())


def outcome(function: Callable[..., Any], arguments: dict[str, Any]) -> tuple[str, Any]:
    """Call a function; return "result", "refused" or what went wrong, and result or error."""
    from pepper_kin.exceptions import PepperKinError

    signal.alarm(MOST_SECONDS)
    try:
        result = function(**arguments)
        signal.alarm(0)
        return "result", result
    except (PepperKinError, TypeError) as error:
        signal.alarm(0)
        return "refused", error
    except Hangs as error:
        return f"takes more than {MOST_SECONDS} s", error
    except BaseException as error:
        signal.alarm(0)
        return type(error).__name__, error


def is_about_type(kind: str, error: Any, wrong: Any) -> bool:
    """Whether an error is what Python or NumPy says of an object of another type.

    That is what the wrong argument itself, or its parts, lack; or an array in the place of a flag or a name.
    """
    if kind == "ValueError":
        return isinstance(wrong, np.ndarray) and "truth value of an" in str(error)
    if kind != "AttributeError" or "has no attribute" not in str(error):
        return False
    items = wrong.ravel().tolist() if isinstance(wrong, np.ndarray) else wrong
    parts = [wrong, *(list(items)[:3] if isinstance(items, (list, tuple, str, bytes, dict, range)) else ())]
    return any((part if inspect.isclass(part) else type(part)).__name__ in str(error) for part in parts)


def is_number(value: Any) -> bool:
    """Whether a valid argument is a number, or numbers."""
    return not isinstance(value, (bool, str)) and isinstance(value, (int, float, np.ndarray, tuple))


def text_of(value: Any) -> str:
    """Return a short text for a value."""
    try:
        return " ".join(repr(value).split())[:120]
    except Exception as error:
        return f"<{type(value).__name__}: {type(error).__name__}>"


def raise_hangs(*_: Any) -> None:
    raise Hangs


def main(options: dict[str, Any]) -> None:
    """Make the calls and print what was found."""
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, raise_hangs)
    rng = np.random.default_rng(options["seed"])
    values = Values()
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    tried, functions = 0, 0
    for name, function, arguments in calls_of(options["package"], values):
        kind, result = outcome(function, arguments)
        if kind != "result":
            print(json.dumps({"no call that works": name, "error": f"{kind}: {result}"[:300]}), flush=True)
            continue
        functions += 1
        nan_before = has_nan(result)
        cases = [
            (p, w) for p, valid in arguments.items() for w in (*wrong_values(valid), *values.others(valid))
        ]
        chosen = rng.permutation(len(cases))[: options["count"]]
        for place in sorted(chosen):
            parameter, wrong = cases[place]
            call = f"{options['package']}.{name}({parameter}={text_of(wrong)})"
            print(f"# {call}", file=sys.stderr, flush=True)
            kind, result = outcome(function, {**arguments, parameter: wrong})
            tried += 1
            if is_about_type(kind, result, wrong):
                kind = "refused"
            nan_is_new = not nan_before and name not in NAN_MEANS_NOTHING and has_nan(result)
            if kind == "result" and is_number(arguments[parameter]) and nan_is_new:
                kind = "silent NaN"
            if kind not in ("result", "refused"):
                where = ""
                if isinstance(result, BaseException):
                    frames = [
                        f for f in traceback.extract_tb(result.__traceback__) if OURS.search(f.filename)
                    ]
                    where = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
                said = (
                    f"{type(result).__name__}: {str(result)[:150]}"
                    if isinstance(result, BaseException)
                    else ""
                )
                print(json.dumps({"call": call, "wrong": kind, "error": said, "where": where}), flush=True)
    print(json.dumps({"tried": tried, "functions": functions}))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
