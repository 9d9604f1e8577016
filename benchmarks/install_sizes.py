"""Size of the installed library by dependency, each with what it alone brings: for `docs/platforms.md`.

Run it in a fresh environment with nothing but the library: `python benchmarks/install_sizes.py`.
"""

from __future__ import annotations

from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def size(found: Distribution) -> float:
    """Return the bytes of a package's files [MB]."""
    paths = (Path(str(found.locate_file(file))) for file in found.files or ())
    return sum(path.lstat().st_size for path in paths if path.exists()) / 1e6


def needed(name: str) -> list[str]:
    """Return what a package requires here, without extras."""
    rows = [Requirement(text) for text in distribution(name).requires or ()]
    return [canonicalize_name(r.name) for r in rows if r.marker is None or r.marker.evaluate({"extra": ""})]


def reached(names: list[str]) -> set[str]:
    """Return packages and all that they require."""
    found: set[str] = set()
    todo = list(names)
    while todo:
        name = todo.pop()
        if name not in found:
            found.add(name)
            todo += needed(name)
    return found


def main() -> None:
    """Print a row for each dependency, and what several share."""
    direct = needed("pepper-kin")
    everything = reached(direct)
    sizes = {name: size(distribution(name)) for name in everything}
    counted: set[str] = set()
    rows = []
    for name in direct:
        alone = reached([name]) - reached([other for other in direct if other != name]) | {name}
        counted |= alone
        rows.append((sum(sizes[part] for part in alone), name, sorted(alone - {name})))
    for megabytes, name, others in sorted(rows, reverse=True):
        print(f"{megabytes:7.1f} MB  {name:<20} {', '.join(others)}")
    shared = sorted(everything - counted, key=sizes.__getitem__, reverse=True)
    print(f"{sum(sizes[part] for part in shared):7.1f} MB  shared by several: {', '.join(shared)}")
    print(f"{size(distribution('pepper-kin')):7.1f} MB  the library itself")
    print(f"{sum(sizes.values()) + size(distribution('pepper-kin')):7.1f} MB  together")


if __name__ == "__main__":
    main()
