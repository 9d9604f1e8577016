"""The module `naoqi` of Python scripts: ALProxy, ALBroker and ALModule."""

from __future__ import annotations

from typing import Any

from pepper_kin.naoqi.shims import qi as qi
from pepper_kin.naoqi.shims.futures import current_broker
from pepper_kin.naoqi.shims.proxy import Post, Proxy, find_module

__all__ = ["ALBehavior", "ALBroker", "ALModule", "ALProxy", "createModule", "qi"]


class ALProxy(Proxy):
    """A module of the twin; the address is ignored: ALProxy("ALMotion", "pepper.local", 9559)."""

    def __init__(self, name: str, *_: Any) -> None:
        super().__init__(find_module(name))
        self.__dict__["post"] = Post(self._module)
        self.__dict__["pCall"] = self._module.pCall if hasattr(self._module, "pCall") else None


class ALBroker:
    """A broker of a script, with the modules of the twin."""

    def __init__(self, name: str = "pythonBroker", *_: Any) -> None:
        current_broker()
        self._name = name

    def shutdown(self) -> None:
        """Do nothing: the twin's modules remain."""

    def getName(self) -> str:
        """Return the name of the broker."""
        return self._name

    def isModulePresent(self, name: str) -> bool:
        """Return whether a module is registered."""
        return name in current_broker().module_names


class ALModule:
    """Base class of the scripts' modules, whose methods events can call."""

    def __init__(self, name: str = "") -> None:
        self._name = name
        current_broker().add_module(name, self)

    def getName(self) -> str:
        """Return the name of the module."""
        return str(self._name)

    def exit(self) -> None:
        """Remove the module from the broker."""
        current_broker().remove_module(self._name)

    def version(self) -> str:
        """Return the version of the module."""
        return "0"

    def setModuleDescription(self, description: str) -> None:
        """Accept a description, without effect."""

    def functionName(self, *_: Any) -> None:
        """Accept a description of a function, without effect."""

    addParam = setReturn = functionName


class ALBehavior(ALModule):
    """Base class of Choregraphe's boxes."""


def createModule(name: str) -> ALModule:
    """Return a new module with a name."""
    return ALModule(name)
