"""The fast solver: the compiled search over a kernel made for the tasks at hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.ik.fast.search import Rows, alternatives, search_compiled, solutions_from
    from pepper_kin.ik.fast.structure import KINDS, structures_of

_MODULES = {
    "KINDS": "structure",
    "Rows": "search",
    "alternatives": "search",
    "search_compiled": "search",
    "solutions_from": "search",
    "structures_of": "structure",
}

__all__ = ["KINDS", "Rows", "alternatives", "search_compiled", "solutions_from", "structures_of"]

__getattr__, __dir__ = lazily(__name__, _MODULES)
