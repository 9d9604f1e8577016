"""Errors that this library raises on misuse.

Every child of `PepperKinError` carries what was wrong as attributes, so that a program can react to it, and
says it in one sentence that also lists what would have been right.  "Not found" (no IK solution, no path) is
never raised: it is a status in a result.

    PepperKinError                            the base of all errors
    InvalidValueError, UnknownNameError, LimitError   a value that is not allowed
    CallError                                 an argument that a function does not take, a module called
    ModelError, FileFormatError, InfeasibleError, MissingDependencyError
    ModelWarning, OvershootWarning, FileFormatWarning
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterable
from typing import Any

__all__ = [
    "CallError",
    "FileFormatError",
    "FileFormatWarning",
    "InfeasibleError",
    "InvalidValueError",
    "LimitError",
    "MissingDependencyError",
    "ModelError",
    "ModelWarning",
    "OvershootWarning",
    "PepperKinError",
    "UnknownNameError",
]

LONGEST_VALUE = 80
"""Characters of a bad value that a message shows at most."""


def shortened(value: object) -> str:
    """Return a value as text on one line, cut at `LONGEST_VALUE` characters with "..." at the end."""
    try:
        text = " ".join(str(value).split())
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, lists without end
        text = f"a value of type {type(value).__name__} that is too long to be shown"
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


LONGEST_REASON = 600
"""Characters of a reason that a message gives at most; the middle of a longer one is left out."""


def _within_reason(reason: str) -> str:
    """Return a reason whose middle is left out where it is longer than LONGEST_REASON."""
    if len(reason) <= LONGEST_REASON:
        return reason
    half = LONGEST_REASON // 2
    return f"{reason[:half]} ... {reason[-half:]}"


def beside_limits(value: float, *limits: float, outside: bool = False, digits: int = 4) -> list[str]:
    """Return a value and its limits as text, all with the same number of digits.

    Rounded alike, a value within its limits reads as within them.

    Args:
        value: The value.
        limits: Its limits.
        outside: Whether the value is beyond one of them: as many digits are shown as tell it from each.
        digits: Least number of significant digits.
    """
    for count in range(digits, 17):
        text, *others = (f"{number:.{count}g}" for number in (value, *limits))
        if not outside or text not in others:
            break
    return [text, *others]


def did_you_mean(name: object, available: Iterable[object]) -> str:
    """Return " (did you mean 'HeadYaw'?)" with the known name that is most like a wrong one; "" if none is.

    Args:
        name: The wrong name.
        available: All known names; upper and lower case count as alike.
    """
    from difflib import get_close_matches

    if len(str(name)) > LONGEST_VALUE:
        return ""  # comparing takes time in proportion to both lengths
    known = {str(other).lower(): str(other) for other in reversed(tuple(available))}
    match = get_close_matches(str(name).lower(), known, n=1, cutoff=0.7)
    return f" (did you mean {known[match[0]]!r}?)" if match else ""


class PepperKinError(Exception):
    """Base of all errors of pepper_kin."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel between processes with the sentence and the attributes, not through `__init__`."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(
    kind: type[PepperKinError], args: tuple[Any, ...], attributes: dict[str, Any]
) -> PepperKinError:
    error = kind.__new__(kind, *args)
    error.args = args  # those that are an OSError too take them in `__init__` alone
    error.__dict__.update(attributes)
    return error


class InvalidValueError(PepperKinError, ValueError):
    """A value has the wrong type, shape or range, or is NaN or infinite.

    Attributes:
        quantity: Name of the argument.
        value: The value refused (or the part of it that is wrong); the message shows 80 characters of it.
        allowed: What would have been accepted, in words.
    """

    def __init__(self, quantity: str, value: object, allowed: str) -> None:
        self.quantity, self.value, self.allowed = quantity, value, allowed
        super().__init__(f"{_within_reason(quantity)}: got {shortened(value)}, expected {allowed}")


class UnknownNameError(PepperKinError, KeyError):
    """A joint, frame, posture, group, ... has no such name; the message suggests the one most like it.

    Attributes:
        kind: What was looked up ("joint", "frame", ...).
        name: The unknown name.
        available: All known names.

    Args:
        advice: Added to the message, with what separates it: what to do where no name is known.
    """

    def __init__(self, kind: str, name: object, available: Iterable[str], advice: str = "") -> None:
        self.kind, self.name, self.available = kind, name, tuple(available)
        hint = did_you_mean(name, self.available)
        known = ", ".join(self.available) or "(none)"
        super().__init__(f"unknown {kind} {shortened(repr(name))}{hint}; available: {known}{advice}")

    def __str__(self) -> str:
        """Return the sentence itself (KeyError would quote it)."""
        return str(self.args[0])


class CallError(PepperKinError, TypeError):
    """A function does not take an argument of this name, or what is called is no function.

    Attributes:
        name: The unknown name; of a module, its own.
        available: What could be given, or called.
    """

    def __init__(self, reason: str, name: str, available: Iterable[str]) -> None:
        self.name, self.available = name, tuple(available)
        hint = did_you_mean(name, self.available)
        super().__init__(f"{reason}{hint}; available: {', '.join(self.available) or '(none)'}")


def suspect_degrees(value: float, unit: str = "rad") -> str:
    """Return a question about an angle beyond a whole turn [rad]; empty for others."""
    return "; degrees? use numpy.radians" if unit == "rad" and 2 * math.pi < abs(value) <= 360 else ""


def suspect_millimeters(length: float) -> str:
    """Return a question about a length beyond 50 m; empty for others."""
    return "positions are in meters; millimeters?" if abs(length) > 50.0 else ""


class LimitError(PepperKinError, ValueError):
    """A joint's value lies outside its limits.

    Attributes:
        quantity: What was checked ("start position", "goal velocity", ...).
        joint: Name of the joint.
        value: Its value.
        lower: Lower limit.
        upper: Upper limit.
        unit: Unit of the three numbers.
    """

    def __init__(
        self, quantity: str, joint: str, value: float, lower: float, upper: float, unit: str = "rad"
    ) -> None:
        self.quantity, self.joint, self.value = quantity, joint, value
        self.lower, self.upper, self.unit = lower, upper, unit
        text, *limits = beside_limits(value, lower, upper, outside=True, digits=6)
        super().__init__(
            f"{quantity}: {joint} = {text} {unit} is outside [{', '.join(limits)}] {unit}"
            f"{suspect_degrees(value, unit)}"
        )


class ModelError(PepperKinError):
    """A robot description cannot be used; the message says which element and why."""

    def __init__(self, reason: str) -> None:
        super().__init__(_within_reason(reason))


class ModelWarning(UserWarning):
    """A part of a robot description was left out; the message says which, and the robot can be used."""


class OvershootWarning(UserWarning):
    """A trajectory through samples leaves their range or the limits in between; the message says where."""


class FileFormatError(PepperKinError):
    """A file cannot be read or does not hold what it should.

    Attributes:
        path: The file.
        reason: What is wrong with it.
        line: Line number, where one is to blame.
    """

    def __init__(self, path: object, reason: str, line: int | None = None) -> None:
        self.path, self.reason, self.line = str(path), reason, line
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {_within_reason(reason)}")


class FileFormatWarning(UserWarning):
    """A part of a file was not read, or not written; the message says which part, and why."""


class InfeasibleError(PepperKinError):
    """A request has no solution and the caller asked for a value rather than for a result with a status.

    Attributes:
        quantity: What cannot be had ("trajectory", ...).
        reason: Why, naming joint, value and limit where one is to blame.
        advice: What to try.
    """

    def __init__(self, quantity: str, reason: str, advice: str) -> None:
        self.quantity, self.reason, self.advice = quantity, reason, advice
        super().__init__(f"no {quantity}: {reason}; {advice}")


class MissingDependencyError(PepperKinError, ImportError):
    """An optional part needs a package that is not installed.

    Attributes:
        package: The package.
        command: The command that installs it.
    """

    def __init__(self, package: str, command: str, purpose: str) -> None:
        self.package, self.command = package, command
        super().__init__(f"{purpose} needs {package!r}; install it with: {command}")


def optional(module: str, *, need: str, extra: str = "", package: str = "", command: str = "") -> Any:
    """Import a module whose package may not be installed, and return it.

    Args:
        module: Its full name.
        need: What it is for, for the error.
        extra: The extra of this package that brings it.
        package: Its package, if that has another name than the module's first part.
        command: What installs it, if no extra does; `pip install` with the package if omitted.

    Raises:
        MissingDependencyError: where it cannot be imported.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = package or module.partition(".")[0]
        command = command or (f'pip install "pepper_kin[{extra}]"' if extra else f"pip install {package}")
        raise MissingDependencyError(package, command, need) from error
