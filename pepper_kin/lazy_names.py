"""Names and modules that are loaded at their first use (PEP 562)."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable, Mapping
from functools import cache
from types import ModuleType
from typing import Any

from pepper_kin.call_errors import name_options, with_named_options


def lazily(
    package: str, names_of: Mapping[str, str] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return a package's `__getattr__` and `__dir__`.

    Args:
        package: `__name__` of the package.
        names_of: Module -> names of the module, separated by blanks. The module is below the package unless
            it begins with `pepper_kin.`; the module's own name stands for the module. If omitted, names and
            modules are read from the imports under `if TYPE_CHECKING:` in the package's source.
    """

    @cache
    def homes() -> dict[str, str]:
        if names_of is None:
            return _homes_in_source(package)
        return {name: home for home, names in names_of.items() for name in names.split()}

    def get(name: str) -> Any:
        if name not in homes():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = homes()[name]
        module = importlib.import_module(home if home.startswith("pepper_kin.") else f"{package}.{home}")
        value = module if home == name else with_named_options(getattr(module, name), package)
        setattr(sys.modules[package], name, value)
        for other, where in homes().items():  # wrap classes of returned values, too
            kind = vars(sys.modules[where]).get(other) if where in sys.modules else None
            if isinstance(kind, type):
                with_named_options(kind, package)
        return value

    def listed() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes()})

    name_options(package)
    return get, listed


def _homes_in_source(package: str) -> dict[str, str]:
    """Return name -> module of a package's imports for type checking; its own modules map to themselves."""
    loader: Any = sys.modules[package].__loader__
    homes = {}
    for block in ast.parse(loader.get_source(package)).body:
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING":
            for found in block.body:
                assert isinstance(found, ast.ImportFrom)
                names = [alias.name for alias in found.names]
                homes.update({name: name if found.module == package else str(found.module) for name in names})
    return homes


class _Later(ModuleType):
    """Placeholder of a module that becomes the module at the first access to an attribute."""

    def __getattr__(self, name: str) -> Any:
        module = importlib.import_module(self.__name__)
        vars(self).update(vars(module))
        self.__class__ = ModuleType  # type: ignore[assignment]
        return getattr(module, name)


def lazy_module(name: str) -> Any:
    """Return a placeholder of a module that takes long to import, and import the module at its first use.

    After loading, access costs no more than with the module itself.

    Args:
        name: Full name of the module.
    """
    return _Later(name)
