"""Modules that only keep the values that were set: autonomous movements, extractors, sound, the tablet."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

from pepper_kin.naoqi.errors import NotSimulatedError
from pepper_kin.naoqi.memory import MemorySignal
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.tables import table


class StateModule(Module):
    """A module whose `set...` and `get...` keep values; other listed methods are accepted or answered.

    `set` and `get` methods are created when they are called, so that every `get` returns the set value.
    """

    accepted: tuple[str, ...] = ()
    answers: dict[str, Any] = {}  # noqa: RUF012
    defaults: dict[str, Any] = {}  # noqa: RUF012
    signals: tuple[str, ...] = ()

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._values: dict[str, Any] = dict(self.defaults)
        vars(self).update({name: MemorySignal() for name in self.signals})

    def getMethodList(self) -> list[str]:
        """Return the names of all listed methods."""
        kept = [f"{prefix}{what}" for what in self.defaults for prefix in ("set", "get", "is")]
        listed = (*self.accepted, *self.answers, *self.not_simulated, *kept)
        return sorted({*super().getMethodList(), *listed})

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Return the function of a listed, `set`, `get` or `is` method."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self.accepted:
            return lambda *values: self._done(name, values)
        if name in self.answers:
            return lambda *_: copy.copy(self.answers[name])
        for prefix in ("set", "get", "is"):
            what = name[len(prefix) :]
            if name.startswith(prefix) and what[:1].isupper():
                return self._setter(what) if prefix == "set" else self._getter(name, what)
        return super().__getattr__(name)

    def _done(self, name: str, values: tuple[Any, ...]) -> bool:
        self.broker.log(f"{self.name}.{name}({', '.join(map(repr, values))})")
        return True

    def _setter(self, what: str) -> Callable[..., bool]:
        def keep(*values: Any) -> bool:
            *key, value = values or (True,)
            self._values["/".join([what, *map(str, key)])] = value
            return True

        return keep

    def _getter(self, name: str, what: str) -> Callable[..., Any]:
        def read(*key: Any) -> Any:
            place = "/".join([what, *map(str, key)])
            if place not in self._values:
                raise NotSimulatedError(self.name, name, "nobody has set it before")
            return self._values[place]

        return read


def _state_module(name: str) -> type[StateModule]:
    """Create the class of a module from its entry in `data/modules.json`."""
    modules = table("modules")
    entry = modules["kept"][name]
    accepted = (*entry.get("accepts", ()), *(modules["extractor"] if entry.get("extractor") else ()))
    defaults = entry.get("keeps", {})
    content = {
        "name": name,
        "__doc__": entry["doc"],
        "accepted": accepted,
        "answers": entry.get("answers", {}),
        "defaults": defaults,
        "signals": tuple(entry.get("signals", ())),
        "not_simulated": entry.get("refuses", {}),
    }
    return type(name, (StateModule,), content)


class ALTabletService(_state_module("ALTabletService")):  # type: ignore[misc]
    """The tablet, which logs what it would show."""

    def robotIp(self) -> str:
        """Return the robot's address in the network of the tablet."""
        return "198.18.0.1"


class RefusedModule(Module):
    """A module of the robot that the twin does not simulate: its methods raise NotSimulatedError."""

    def getMethodList(self) -> list[str]:
        """Return the names of the methods that clients see."""
        return sorted({*super().getMethodList(), *table("modules")["refused"][self.name].get("methods", ())})

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Return a function that raises NotSimulatedError."""
        if name.startswith("_"):
            raise AttributeError(name)

        def refuse(*_: object) -> None:
            raise NotSimulatedError(self.name, name, table("modules")["refused"][self.name]["why"])

        return refuse


def _refused(name: str, why: str) -> type[RefusedModule]:
    return type(name, (RefusedModule,), {"name": name, "__doc__": f"Not simulated: {why}."})


MODULES: tuple[type[Module], ...] = (
    ALTabletService,
    *(_state_module(name) for name in table("modules")["kept"] if name != ALTabletService.name),
    *(_refused(name, entry["why"]) for name, entry in table("modules")["refused"].items()),
)
