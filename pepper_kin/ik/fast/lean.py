"""How the functions of the search are compiled that only read and write arrays of others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core import options

# Numba counts the references to every array and every slice, one locked instruction each: a third of the time
# of a step here.  Functions that neither make arrays nor keep any may do without.  The option is not part of
# Numba's promises; where it is missing, references are counted.
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
if hasattr(options.DefaultOptions, "_nrt"):
    _OPTIONS["_nrt"] = False


def lean(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no array, without counting references, and always inline it."""
    return njit(forceinline=True, **_OPTIONS)(function)


def lean_alone(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no array, without counting references."""
    return njit(**_OPTIONS)(function)
