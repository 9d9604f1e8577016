"""Public functions called with one wrong argument, in a separate process.

    python misuse_job.py '{"package": "ik", "count": 30, "seed": 0}'

Public functions and constructors of a package, or methods of a group of objects, have a call that works
(`misuse_calls.py`); then one argument at a time is replaced by what does not belong there.  What comes of it
must be an error of the library, or a TypeError or an AttributeError about an object of another type, or a
result without NaN.  Prints each call before it is made, so that the last one is known if the process ends,
and a line of JSON for each finding.
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
from misuse_calls import METHODS, Values

from pepper_kin.exceptions import PepperKinError

faulthandler.enable()
CHECKED = 20 if os.environ.get("NUMBA_BOUNDSCHECK") else 1
"""Factor of time where indices are checked, as machine code is then made in calls."""
MOST_SECONDS, MOST_MEMORY = 20 * CHECKED, (12 if CHECKED > 1 else 6) << 30
OURS = re.compile(r"/(pepper_kin|planners)/")
Call = tuple[str, Callable[..., Any], dict[str, Any]]


class Hangs(BaseException):
    """A call took too long."""


WRONG: tuple[Any, ...] = (
    math.nan, math.inf, -math.inf, -1, 0, -0.5, 1e300, -1e300, 10**400, 2**63, True, None, 1j,
    "", "no such thing", "nan", "1", "\0", "\ud800", "x" * 5000, b"bytes", [], {}, object(), int,
    [[1.0, 2.0], [3.0]], np.zeros(0), np.zeros((2, 3, 4)), np.array("text"), np.array([None, 1.0]),
    [math.nan], {"no such thing": 1.0}, {1: 2}, ["no such thing"], [None], range(3), lambda *_: None,
    np.array(["2020-01-01"], "datetime64[D]"),
)  # fmt: skip
"""What belongs in no place, or hardly."""


def wrong_values(valid: Any) -> Iterator[Any]:
    """Yield what does not belong in the place of a valid argument."""
    yield from WRONG
    if isinstance(valid, np.ndarray) and valid.dtype.kind == "f" and valid.size:
        for bad in (math.nan, math.inf, 1e300, -1e300):
            changed = valid.copy()
            changed.flat[valid.size // 2] = bad
            yield changed
        yield from (valid[..., :-1], np.concatenate([valid, valid], axis=-1), valid[None][None])
        yield from (valid[:-1], valid[:1], valid[:0], valid[1:2], np.concatenate([valid, valid]))
        yield from (valid.astype(complex), valid.astype(str), valid.astype(object))
        yield np.ma.masked_array(valid, np.ones(valid.shape, bool))


LEFT_OUT = {
    "plan_batch", "run_real_time", "clear_cache", "release_memory", "kept_while_private", "compiled",
    "CompiledFunction", "Kernel", "Integrator", "Recorder", "Recording", "load_recording", "load_run",
    "ompl_plan", "RobotMemory", "CompiledMotionValidator", "CompiledManifold", "PepperModel", "state_data",
    "over_states", "all_over_states", "kernel_ir", "compile_function", "read_choregraphe",
    "read_naoqi_export", "read_joint_states", "read_log", "check_logs", "plot", "manifold_of",
    "Push", "Semantics",
}  # fmt: skip
"""Processes, clocks, caches; values that only the library makes; readers, which have separate fuzz tests."""
RESULTS = (
    "Result", "Status", "Certificate", "Check", "Report", "Run", "Error", "Step", "State", "Pair", "Pairs",
)  # fmt: skip
"""Endings of the names of classes whose objects only the library makes."""
NAN_MEANS_NOTHING = {"PlacementMap.score_at", "Camera.project", "Integrator.step", "Integrator.run"}
"""Where the documentation says so: outside of a map or a picture, or of a state that diverges."""


def made_by_users(value: Any) -> bool:
    """Whether a public value is a function, or a class whose objects users make."""
    if not inspect.isclass(value):
        return callable(value) and hasattr(value, "__module__")
    of_library = issubclass(value, BaseException) or inspect.isabstract(value)
    members = any(hasattr(value, name) for name in ("__members__", "_fields"))
    protocol = getattr(value, "_is_protocol", False)
    return not (of_library or members or protocol or value.__name__.endswith(RESULTS))


def calls_of(package: str, values: Values) -> Iterator[Call]:
    """Yield name, function and valid arguments of what a package offers, or of a group of methods."""
    if package in METHODS:
        for name, (make, methods) in METHODS[package](values.samples).items():
            for method, arguments in methods.items():
                yield f"{name}.{method}", on_new_object(make, method), arguments
        return
    module = importlib.import_module(f"pepper_kin.{package}")
    for name in module.__all__:
        function = getattr(module, name)
        if name in LEFT_OUT or not made_by_users(function):
            continue
        try:
            parameters = inspect.signature(function).parameters.values()
        except ValueError:
            continue
        found = {
            p.name: values.of(name, p)
            for p in parameters
            if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD) and not p.name.startswith("_")
        }
        if not any(value is inspect.Parameter.empty for value in found.values()):
            yield name, used(name, function, values), found


def on_new_object(make: Callable[[], Any], method: str) -> Callable[..., Any]:
    """Return a function that makes an object and calls a method of it."""
    return lambda **arguments: getattr(make(), method)(**arguments)


def used(name: str, function: Callable[..., Any], values: Values) -> Callable[..., Any]:
    """Return a function, or one that also uses the value, where this checks the value's attributes."""
    if name == "PlanProblem":
        return lambda **arguments: function(**arguments).solve()
    if name == "Leg":
        plan_legs, s = importlib.import_module("pepper_kin.motion").plan_legs, values.samples
        return lambda **arguments: plan_legs(s.robot, s.stand, [function(**arguments)], s.scene)
    return function


def has_nan(value: Any, depth: int = 0) -> bool:
    """Whether a result holds NaN: in numbers, arrays, tuples and public attributes of frozen objects."""
    if isinstance(value, (float, np.floating)):
        return math.isnan(value)
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fc" and bool(np.isnan(value).any())
    if depth > 2 or isinstance(value, (str, bytes)):
        return False
    if not isinstance(value, (tuple, list)):
        value = (value if isinstance(value, dict) else getattr(value, "__dict__", {})).values()
    return any(has_nan(part, depth + 1) for part in value)


def outcome(function: Callable[..., Any], arguments: dict[str, Any]) -> tuple[str, Any]:
    """Call a function; return "result", "refused" or what went wrong, and result or error."""
    signal.alarm(MOST_SECONDS)
    try:
        return "result", function(**arguments)
    except (PepperKinError, TypeError) as error:
        return "refused", error
    except Hangs as error:
        return f"takes more than {MOST_SECONDS} s", error
    except BaseException as error:
        return type(error).__name__, error
    finally:
        signal.alarm(0)


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
    rng, values = np.random.default_rng(options["seed"]), Values()
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    tried, functions = 0, 0
    for name, function, arguments in calls_of(options["package"], values):
        kind, result = outcome(function, arguments)
        if kind != "result":
            print(json.dumps({"no call that works": name, "error": f"{kind}: {result}"[:300]}), flush=True)
            continue
        functions += 1
        nan_is_usual = name in NAN_MEANS_NOTHING or has_nan(result)
        cases = [
            (p, w) for p, valid in arguments.items() for w in (*wrong_values(valid), *values.others(valid))
        ]
        for place in sorted(rng.permutation(len(cases))[: options["count"]]):
            parameter, wrong = cases[place]
            call = f"{options['package']}.{name}({parameter}={text_of(wrong)})"
            print(f"# {call}", file=sys.stderr, flush=True)
            kind, result = outcome(function, {**arguments, parameter: wrong})
            tried += 1
            if kind == "result" and is_number(arguments[parameter]) and not nan_is_usual and has_nan(result):
                kind = "silent NaN"
            if kind in ("result", "refused") or is_about_type(kind, result, wrong):
                continue
            where = said = ""
            if isinstance(result, BaseException):
                said = f"{type(result).__name__}: {str(result)[:150]}"
                frames = [f for f in traceback.extract_tb(result.__traceback__) if OURS.search(f.filename)]
                where = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
            print(json.dumps({"call": call, "wrong": kind, "error": said, "where": where}), flush=True)
    print(json.dumps({"tried": tried, "functions": functions}))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
