"""The fast solver: compiled search with a kernel made for the tasks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.ik.fast.search import BatchSearch, alternatives, search_compiled, solutions_from

__all__ = ["BatchSearch", "alternatives", "search_compiled", "solutions_from"]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "search": "BatchSearch alternatives search_compiled solutions_from",
    },
)
