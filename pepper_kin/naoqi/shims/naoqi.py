"""The module `naoqi` of Python scripts: ALProxy, ALBroker and ALModule."""

from __future__ import annotations

from typing import Any

from pepper_kin.naoqi.shims import qi as qi
from pepper_kin.naoqi.shims.futures import current_broker
from pepper_kin.naoqi.shims.proxy import Post, Proxy, find_module

__all__ = ["ALBehavior", "ALBroker", "ALModule", "ALProxy", "createModule", "qi"]


class ALProxy(Proxy):
    """A module of the twin, whatever address is named: ALProxy("ALMotion", "pepper.local", 9559)."""

    def __init__(self, name: str, *_: Any) -> None:
        super().__init__(find_module(name))
        self.__dict__["post"] = Post(self._module)
        self.__dict__["pCall"] = self._module.pCall if hasattr(self._module, "pCall") else None


class ALBroker:
    """A broker of a script; its modules are those of the twin."""

    def __init__(self, name: str = "pythonBroker", *_: Any) -> None:
        current_broker()
        self._name = name

    def shutdown(self) -> None:
        """Leave the twin's modules as they are."""

    def getName(self) -> str:
        """Return the name."""
        return self._name

    def isModulePresent(self, name: str) -> bool:
        """Return whether there is a module."""
        return name in current_broker().module_names


class ALModule:
    """Base of modules of scripts, whose methods events can call."""

    def __init__(self, name: str = "") -> None:
        self._name = name
        current_broker().add_module(name, self)

    def getName(self) -> str:
        """Return the name."""
        return str(self._name)

    def exit(self) -> None:
        """Leave the broker."""
        current_broker().remove_module(self._name)

    def version(self) -> str:
        """Return the version."""
        return "0"

    def setModuleDescription(self, description: str) -> None:
        """Accept a description."""

    def functionName(self, *_: Any) -> None:
        """Accept a description of a function."""

    addParam = setReturn = functionName


class ALBehavior(ALModule):
    """Base of the boxes of Choregraphe."""


def createModule(name: str) -> ALModule:
    """Return a new module."""
    return ALModule(name)
