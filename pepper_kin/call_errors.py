"""Helpful errors for wrong calls: unknown options, a missing robot, modules called as functions."""

from __future__ import annotations

import functools
import inspect
import re
import sys
from types import FunctionType, ModuleType
from typing import Any, NoReturn

from pepper_kin.exceptions import CallError, InvalidValueError

_UNKNOWN = re.compile(r"(?:.*\.)?(\w+)\(\) got an unexpected keyword argument '(\w+)'")
_OPTIONS = 2
"""Minimum number of arguments with a default for which a function without a robot is wrapped."""


_QUICK = {f"pepper_kin.{name}" for name in ("batch", "collision", "dynamics", "kinematics")}
"""Packages that are not wrapped: their functions take a few microseconds, and wrapping adds half as much."""
_STEPS = {"step"}
"""Methods that are not wrapped, since loops call them."""


class AnsweringPackage(ModuleType):
    """A package that raises an error with its functions if it is called."""

    def __call__(self, *args: object, **kwargs: object) -> NoReturn:
        """Refuse the call.

        Raises:
            CallError: with the names of the package's functions.
        """
        names = [name for name in self.__all__ if name.islower()]
        short = self.__name__.rpartition(".")[2]
        raise CallError(f"{short} is a module, not a function: call {short}.NAME(...)", short, names)


def name_options(package: str) -> None:
    """Wrap a package's public functions and classes so that wrong calls name their options or the robot.

    A wrapped call costs about 1 µs more. Functions that take only a few microseconds, and functions without a
    robot and with fewer than two options, are not wrapped.

    Args:
        package: `__name__` of the package; names in `__all__` that are not loaded yet are left to `lazily`.
    """
    module = sys.modules[package]
    module.__class__ = AnsweringPackage
    for name in getattr(module, "__all__", ()):
        if name in vars(module):
            setattr(module, name, with_named_options(getattr(module, name), package))


def with_named_options(value: Any, package: str) -> Any:
    """Return a function, or a class with methods, wrapped as in `name_options`; other values unchanged."""
    if isinstance(value, FunctionType) and package not in _QUICK and _takes_options(value):
        return _answering(value, package)
    if inspect.isclass(value) and value.__module__.startswith("pepper_kin"):
        for name, member in list(vars(value).items()):
            function = getattr(member, "__func__", member)
            is_public = name == "__init__" or not (name.startswith("_") or name in _STEPS)
            if is_public and isinstance(function, FunctionType) and _takes_options(function):
                answering = _answering(function, function.__module__)
                setattr(value, name, answering if member is function else type(member)(answering))
    return value


def _takes_options(function: FunctionType) -> bool:
    """Whether a function has options or a robot as an argument, and is not wrapped yet."""
    code = function.__code__
    count = len(function.__defaults__ or ()) + len(function.__kwdefaults__ or ())
    takes_robot = "pepper" in code.co_varnames[: min(2, code.co_argcount)]
    return not hasattr(function, "__wrapped__") and (
        takes_robot or count >= _OPTIONS or bool(code.co_flags & inspect.CO_VARKEYWORDS)
    )


def _answering(function: FunctionType, package: str) -> Any:
    """Return a function that raises a more helpful error for an unknown option or a missing robot."""

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except Exception as error:
            answer = _unknown_option(error, function, kwargs) or _no_robot(function, args)
            if answer is None:
                raise
        raise answer

    call.__module__ = package
    return call


def _unknown_option(error: Exception, function: FunctionType, kwargs: dict[str, Any]) -> CallError | None:
    """Return an error with the known arguments if an argument is unknown; else None."""
    found, trace = _UNKNOWN.match(str(error)), error.__traceback__
    if type(error) is not TypeError or found is None or trace is None or found[2] not in kwargs:
        return None
    parameters = dict(inspect.signature(function).parameters)
    if trace.tb_next is not None:  # the function passes its options to another one
        while trace.tb_next is not None:
            trace = trace.tb_next
        called = trace.tb_frame.f_globals.get(found[1])
        if not callable(called):
            return None
        parameters |= inspect.signature(called).parameters
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    named = [name for name, p in parameters.items() if name not in ("self", "cls") and p.kind in kinds]
    what = function.__qualname__.removesuffix(".__init__")
    return CallError(f"{what}() takes no argument {found[2]!r}", found[2], named)


def _no_robot(function: FunctionType, args: tuple[Any, ...]) -> InvalidValueError | None:
    """Return an error that says where the robot belongs if it is missing; else None."""
    names = function.__code__.co_varnames
    place = int(names[0] != "pepper")
    if names[place : place + 1] != ("pepper",) or len(args) <= place or args[place] is None:
        return None
    if hasattr(type(args[place]), "joint_group"):
        return None
    what = function.__qualname__.removesuffix(".__init__")
    return InvalidValueError(
        "pepper", f"a {type(args[place]).__name__}", f"a robot, which comes first: {what}(pepper, ...)"
    )
