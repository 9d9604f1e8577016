"""Collision in machine code, with the verdicts of coal.

What is named here is loaded when it is first asked for: parts of this room are of use without the rest.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pepper_kin.collision.fast.checker import FastChecker, fast_checker_for
    from pepper_kin.collision.fast.compiled import CompiledValidity

_MODULES = {"CompiledValidity": "compiled", "FastChecker": "checker", "fast_checker_for": "checker"}

__all__ = ["CompiledValidity", "FastChecker", "fast_checker_for"]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
