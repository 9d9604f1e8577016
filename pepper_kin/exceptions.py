"""Errors that this library raises on misuse.

Every subclass of `PepperKinError` has attributes, so that a program can react, and a message of one sentence
that also lists the allowed values.  "Not found" (no IK solution, no path) is never raised: it is a status in
a result.

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
"""Maximum number of characters of an invalid value in a message."""


def shortened(value: object) -> str:
    """Return a value as text on one line, cut at `LONGEST_VALUE` characters with "..." at the end."""
    try:
        text = " ".join(str(value).split())
    except (ValueError, RecursionError):  # integers of thousands of digits, lists that contain themselves
        text = f"a value of type {type(value).__name__} that is too long to be shown"
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


LONGEST_REASON = 600
"""Maximum number of characters of a reason in a message; the middle of a longer one is left out."""


def _within_reason(reason: str) -> str:
    """Return a reason, without its middle if it is longer than LONGEST_REASON."""
    if len(reason) <= LONGEST_REASON:
        return reason
    half = LONGEST_REASON // 2
    return f"{reason[:half]} ... {reason[-half:]}"


def beside_limits(value: float, *limits: float, outside: bool = False, digits: int = 4) -> list[str]:
    """Return a value and its limits as text, all with the same number of digits.

    With equal rounding, a value within its limits also reads as within them.

    Args:
        value: The value.
        limits: Limits of the value.
        outside: Whether the value is beyond a limit: then it gets enough digits to differ from each limit.
        digits: Minimum number of significant digits.
    """
    for count in range(digits, 17):
        text, *others = (f"{number:.{count}g}" for number in (value, *limits))
        if not outside or text not in others:
            break
    return [text, *others]


def did_you_mean(name: object, available: Iterable[object]) -> str:
    """Return " (did you mean 'HeadYaw'?)" with the known name most similar to a wrong one; "" without one.

    Args:
        name: The wrong name.
        available: All known names; case is ignored.
    """
    from difflib import get_close_matches

    if len(str(name)) > LONGEST_VALUE:
        return ""  # the time of comparing is proportional to both lengths
    known = {str(other).lower(): str(other) for other in reversed(tuple(available))}
    match = get_close_matches(str(name).lower(), known, n=1, cutoff=0.7)
    return f" (did you mean {known[match[0]]!r}?)" if match else ""


class PepperKinError(Exception):
    """Base of all errors of pepper_kin."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by message and attributes instead of the arguments of `__init__`."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(
    kind: type[PepperKinError], args: tuple[Any, ...], attributes: dict[str, Any]
) -> PepperKinError:
    """Return a pickled error with its message and attributes."""
    error = kind.__new__(kind, *args)
    error.args = args  # errors that are an OSError as well set it only in `__init__`
    error.__dict__.update(attributes)
    return error


class InvalidValueError(PepperKinError, ValueError):
    """A value has the wrong type, shape or range, or is NaN or infinite.

    Attributes:
        quantity: Name of the argument.
        value: Refused value, or its wrong part; the message shows 80 characters.
        allowed: Allowed values in words.
    """

    def __init__(self, quantity: str, value: object, allowed: str) -> None:
        self.quantity, self.value, self.allowed = quantity, value, allowed
        super().__init__(f"{_within_reason(quantity)}: got {shortened(value)}, expected {allowed}")


class UnknownNameError(PepperKinError, KeyError):
    """A name of a joint, frame, posture, group, ... is unknown; the message suggests the most similar one.

    Attributes:
        kind: Kind of the name ("joint", "frame", ...).
        name: The unknown name.
        available: All known names.

    Args:
        advice: Text appended to the message with its separator, such as advice if no name is known.
    """

    def __init__(self, kind: str, name: object, available: Iterable[str], advice: str = "") -> None:
        self.kind, self.name, self.available = kind, name, tuple(available)
        hint = did_you_mean(name, self.available)
        known = ", ".join(self.available) or "(none)"
        super().__init__(f"unknown {kind} {shortened(repr(name))}{hint}; available: {known}{advice}")

    def __str__(self) -> str:
        """Return the message without the quotes of KeyError."""
        return str(self.args[0])


class CallError(PepperKinError, TypeError):
    """A function does not take an argument of a name, or a module is called.

    Attributes:
        name: Unknown name of the argument, or name of the module.
        available: Known arguments, or functions of the module.
    """

    def __init__(self, reason: str, name: str, available: Iterable[str]) -> None:
        self.name, self.available = name, tuple(available)
        hint = did_you_mean(name, self.available)
        super().__init__(f"{reason}{hint}; available: {', '.join(self.available) or '(none)'}")


def suspect_degrees(value: float, unit: str = "rad") -> str:
    """Return a question about an angle beyond a whole turn [rad]; empty for other values."""
    return "; degrees? use numpy.radians" if unit == "rad" and 2 * math.pi < abs(value) <= 360 else ""


def suspect_millimeters(length: float) -> str:
    """Return a question about a length beyond 50 m; empty for other values."""
    return "positions are in meters; millimeters?" if abs(length) > 50.0 else ""


class LimitError(PepperKinError, ValueError):
    """A joint's value lies outside its limits.

    Attributes:
        quantity: Checked quantity ("start position", "goal velocity", ...).
        joint: Name of the joint.
        value: Value of the joint.
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
    """A file cannot be read or has invalid contents.

    Attributes:
        path: The file.
        reason: Fault of the file.
        line: Line number of the fault, or None.
    """

    def __init__(self, path: object, reason: str, line: int | None = None) -> None:
        self.path, self.reason, self.line = str(path), reason, line
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {_within_reason(reason)}")


class FileFormatWarning(UserWarning):
    """A part of a file was not read, or not written; the message says which part, and why."""


class InfeasibleError(PepperKinError):
    """A request for a value has no solution; calls that return a status do not raise this error.

    Attributes:
        quantity: Requested quantity ("trajectory", ...).
        reason: Reason, with joint, value and limit if known.
        advice: Advice on what to try.
    """

    def __init__(self, quantity: str, reason: str, advice: str) -> None:
        self.quantity, self.reason, self.advice = quantity, reason, advice
        super().__init__(f"no {quantity}: {reason}; {advice}")


class MissingDependencyError(PepperKinError, ImportError):
    """An optional part needs a package that is not installed.

    Attributes:
        package: Name of the package.
        command: Command that installs the package.
    """

    def __init__(self, package: str, command: str, purpose: str) -> None:
        self.package, self.command = package, command
        super().__init__(f"{purpose} needs {package!r}; install it with: {command}")


def optional(module: str, *, need: str, extra: str = "", package: str = "", command: str = "") -> Any:
    """Import a module whose package may not be installed, and return it.

    Args:
        module: Full name of the module.
        need: Purpose of the module, for the error.
        extra: Extra of this library that installs the package.
        package: Name of the package, if it differs from the module's first part.
        command: Command that installs the package without an extra; `pip install` with the package if
            omitted.

    Raises:
        MissingDependencyError: if the module cannot be imported.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = package or module.partition(".")[0]
        command = command or (f'pip install "pepper_kin[{extra}]"' if extra else f"pip install {package}")
        raise MissingDependencyError(package, command, need) from error
