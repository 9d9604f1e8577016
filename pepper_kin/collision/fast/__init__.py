"""Collision checks in machine code, with the verdicts of coal.

Names are loaded at their first use: parts of this package are useful without the rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.collision.fast.checker import FastChecker, fast_checker_for
    from pepper_kin.collision.fast.compiled import CompiledValidity, StaticLoads

__all__ = ["CompiledValidity", "FastChecker", "StaticLoads", "fast_checker_for"]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "compiled": "CompiledValidity StaticLoads",
        "checker": "FastChecker fast_checker_for",
    },
)
