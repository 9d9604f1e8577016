"""What `pip install -e .` does not bring, hidden from pages that name no extra."""

import re
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, metadata, packages_distributions, requires

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

EXTRA = re.compile(r"\.\[\w+\]|pepper_kin\[\w+\]|\bextras? `\w+`")
DEVELOPMENT = {"test", "docs", "dev"}


def required(name: str, extra: str = "") -> set[str]:
    """Return what a package requires here, with an extra; nothing of one that is not installed."""
    try:
        rows = [Requirement(text) for text in requires(name) or ()]
    except PackageNotFoundError:
        return set()
    return {
        canonicalize_name(row.name)
        for row in rows
        if row.marker is None or row.marker.evaluate({"extra": extra})
    }


def core() -> set[str]:
    """Return the packages that the library brings without extras."""
    found, todo = set(), {"pepper-kin"}
    while todo:
        found |= todo
        todo = {other for name in todo for other in required(name)} - found
    return found


@cache
def extra_modules() -> frozenset[str]:
    """Return the modules of the packages that only extras for users bring."""
    extras = set(metadata("pepper_kin").get_all("Provides-Extra")) - DEVELOPMENT
    names = set().union(*(required("pepper-kin", extra) for extra in extras)) - core()
    owners = packages_distributions()
    modules = {one for one, packages in owners.items() if names & {canonicalize_name(p) for p in packages}}
    return frozenset(name for name in modules | names if name.isidentifier())  # placo lies in cmeel's folder


def hide_extras(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let imports of what extras bring fail, unless a page's text names an extra."""
    if EXTRA.search(text):
        return
    hidden = extra_modules()
    loaded = {name for name in sys.modules if name.partition(".")[0] in hidden}
    for name in hidden | loaded:
        monkeypatch.setitem(sys.modules, name, None)
