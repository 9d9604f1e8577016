"""Immutable ordered mapping of names to items that is extended by one item at constant cost."""

from __future__ import annotations

import threading
from collections.abc import ItemsView, Iterator, Mapping, ValuesView
from itertools import islice
from typing import Generic, TypeVar

Item = TypeVar("Item")

_lock = threading.Lock()


class NamedItems(Mapping[str, Item], Generic[Item]):
    """A read-only dictionary, in the order of addition.

    Versions that are extensions of one another share their items: each has its own count.

    Args:
        items: Name -> item.
    """

    __slots__ = ("_count", "_items", "_names", "_places")

    def __init__(self, items: Mapping[str, Item]) -> None:
        self._names, self._items = list(items), list(items.values())
        self._places = {name: place for place, name in enumerate(self._names)}
        self._count = len(self._names)

    def and_one(self, name: str, item: Item) -> NamedItems[Item]:
        """Return these items and one more, with a new name."""
        with _lock:
            grown: NamedItems[Item] = object.__new__(NamedItems)
            if len(self._names) == self._count:
                grown._names, grown._items, grown._places = self._names, self._items, self._places
            else:  # this version has been extended before
                grown._names, grown._items = self._names[: self._count], self._items[: self._count]
                grown._places = {known: place for place, known in enumerate(grown._names)}
            grown._names.append(name)
            grown._items.append(item)
            grown._places[name] = self._count
            grown._count = self._count + 1
            return grown

    def replaced(self, changed: Mapping[str, Item]) -> NamedItems[Item]:
        """Return these items with some replaced, by name."""
        found: NamedItems[Item] = object.__new__(NamedItems)
        found._names, found._places, found._count = self._names, self._places, self._count
        found._items = self._items[: self._count]
        for name, item in changed.items():
            found._items[self._places[name]] = item
        return found

    def __getitem__(self, name: str) -> Item:
        place = self._places[name]
        if place >= self._count:
            raise KeyError(name)
        return self._items[place]

    def __contains__(self, name: object) -> bool:
        return self._places.get(name, self._count) < self._count  # type: ignore[call-overload]

    def __iter__(self) -> Iterator[str]:
        return islice(self._names, self._count)

    def __len__(self) -> int:
        return self._count

    def __repr__(self) -> str:
        return repr(dict(self))

    def values(self) -> ValuesView[Item]:
        """Return the items."""
        return _Values(self)

    def items(self) -> ItemsView[str, Item]:
        """Return names and items."""
        return _Items(self)


class _Values(ValuesView[Item]):
    _mapping: NamedItems[Item]

    def __iter__(self) -> Iterator[Item]:
        return islice(self._mapping._items, len(self._mapping))


class _Items(ItemsView[str, Item]):
    _mapping: NamedItems[Item]

    def __iter__(self) -> Iterator[tuple[str, Item]]:
        return islice(zip(self._mapping._names, self._mapping._items, strict=False), len(self._mapping))
