"""Answers to calls that Python refuses without saying what is right: unknown options, no robot, modules."""

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
"""Arguments with a default from which on a function's calls are looked at: those without run as they are."""


_QUICK = {f"pepper_kin.{name}" for name in ("batch", "collision", "dynamics", "kinematics")}
"""Packages whose functions take a few microseconds, and half as much again if they answered."""
_STEPS = {"step"}
"""Methods of loops."""


class AnsweringPackage(ModuleType):
    """A package that names its functions where it is called as if it were one of them."""

    def __call__(self, *args: object, **kwargs: object) -> NoReturn:
        """Refuse it.

        Raises:
            CallError: with the package's functions.
        """
        names = [name for name in self.__all__ if name.islower()]
        short = self.__name__.rpartition(".")[2]
        raise CallError(f"{short} is a module, not a function: call {short}.NAME(...)", short, names)


def name_options(package: str) -> None:
    """Let calls of a package's public functions and classes name their options, and where the robot belongs.

    A call costs some 1 µs more.  Functions that take no more than a few are left as they are, and so are
    those without a robot and with fewer than two options.

    Args:
        package: Its `__name__`; names of `__all__` that it does not have yet are left to `lazily`.
    """
    module = sys.modules[package]
    module.__class__ = AnsweringPackage
    for name in getattr(module, "__all__", ()):
        if name in vars(module):
            setattr(module, name, with_named_options(getattr(module, name), package))


def with_named_options(value: Any, package: str) -> Any:
    """Return a function that answers as `name_options` says; a class gets such methods, others stay."""
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
    code = function.__code__
    count = len(function.__defaults__ or ()) + len(function.__kwdefaults__ or ())
    takes_robot = "pepper" in code.co_varnames[: min(2, code.co_argcount)]
    return not hasattr(function, "__wrapped__") and (
        takes_robot or count >= _OPTIONS or bool(code.co_flags & inspect.CO_VARKEYWORDS)
    )


def _answering(function: FunctionType, package: str) -> Any:
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
    """Return the error that names what may be given; None where something else is wrong."""
    found, trace = _UNKNOWN.match(str(error)), error.__traceback__
    if type(error) is not TypeError or found is None or trace is None or found[2] not in kwargs:
        return None
    parameters = dict(inspect.signature(function).parameters)
    if trace.tb_next is not None:  # options that it passes on
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
    """Return the error that says where the robot belongs; None where it is there."""
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
