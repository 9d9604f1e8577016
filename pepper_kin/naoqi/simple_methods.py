"""Methods of `data/simple_methods.csv`, which keep or return a value, do nothing, or delegate."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pepper_kin.naoqi.tables import rows

if TYPE_CHECKING:
    from pepper_kin.naoqi.module import Module

Do = Callable[["Module", tuple[Any, ...]], Any]
"""Implementation of a method, called with the module and the method's arguments."""


def simple_methods(module: str) -> dict[str, Callable[..., Any]]:
    """Return the methods of a module in the table, by name.

    A value is kept in `Module.kept` by the row's `place` and the preceding arguments: ("ability", "blink").
    """
    return {row["method"]: _method(row) for row in rows("simple_methods") if row["module"] == module}


def _method(row: dict[str, str]) -> Callable[..., Any]:
    """Return the function of a row, with the row's name, parameters and description."""
    parameters = row["parameters"]
    names = "".join(f"{one.partition('=')[0].strip()}, " for one in parameters.split(";") if one)
    head = ", ".join(["self", *filter(None, (one.strip() for one in parameters.split(";")))])
    space: dict[str, Any] = {"do": _DOES[row["does"]](row["method"], row["place"], row["value"])}
    exec(f"def {row['method']}({head}):\n    return do(self, ({names}))", space)
    method: Callable[..., Any] = space[row["method"]]
    method.__qualname__, method.__doc__ = f"{row['module']}.{row['method']}", row["doc"]
    return method


def _set(method: str, place: str, kind: str) -> Do:
    def do(module: Module, values: tuple[Any, ...]) -> None:
        *key, value = values
        module.kept[place, *key] = (
            module.number(method, place, value) if kind == "number" else _KINDS[kind](value)
        )

    return do


def _confirm(method: str, place: str, kind: str) -> Do:
    keep = _set(method, place, kind)
    return lambda module, values: keep(module, values) is None


def _keep(method: str, place: str, value: str) -> Do:
    return lambda module, values: module.kept.update({(place,): json.loads(value)})


def _get(method: str, place: str, default: str) -> Do:
    return lambda module, values: module.kept.get((place, *values), json.loads(default))


def _return(method: str, place: str, value: str) -> Do:
    return lambda module, values: json.loads(value)


def _accept(method: str, place: str, value: str) -> Do:
    return lambda module, values: None


def _call(method: str, place: str, more: str) -> Do:
    added = [json.loads(more)] if more else []
    return lambda module, values: getattr(module, place)(method, *values, *added)


_DOES = {
    "call": _call,
    "set": _set,
    "confirm": _confirm,
    "keep": _keep,
    "get": _get,
    "return": _return,
    "accept": _accept,
}
_KINDS: dict[str, Callable[[Any], Any]] = {"any": lambda value: value, "bool": bool, "int": int, "str": str}
