"""Pepper's description, expanded from the xacro sources ahead of time: expanding takes 0.2 s.

After a change of `urdf/xacro`, write the texts again:

    python -m pepper_kin.model.expanded_urdf

Texts are used only if the checksum beside them is the checksum of the present sources.
"""

from __future__ import annotations

import zlib
from pathlib import Path

from pepper_kin import urdf
from pepper_kin.file_access.atomic_file import write_text

BASES = ("fixed", "planar")
HANDS = ("locked", "mimic", "independent")
DEFAULTS = {"base": "fixed", "hands": "locked"}
_CHECKSUM = "sources.crc32"


def urdf_folder() -> Path:
    """Return the folder of the package `pepper_kin.urdf`."""
    return Path(urdf.__path__[0])


def expand(**arguments: str) -> str:
    """Expand the xacro sources to a URDF text.

    Args:
        **arguments: xacro arguments: name, prefix, base, hands, mesh_dir.
    """
    import xacro

    source = str(urdf_folder() / "xacro" / "pepper.urdf.xacro")
    text = str(xacro.process_file(source, mappings=arguments).toprettyxml(indent="  "))
    return text.replace(
        source, "pepper.urdf.xacro", 1
    )  # in a comment: without the path, the text is the same on every machine


def expanded(base: str, hands: str) -> str | None:
    """Return the text expanded ahead of time, or None if it is missing or the sources have changed."""
    folder = urdf_folder() / "expanded"
    try:
        if (folder / _CHECKSUM).read_text(encoding="ascii").strip() != sources_checksum():
            return None
        return _place(folder, base, hands).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None


def sources_checksum() -> str:
    """Return a CRC-32 of all xacro sources, independent of line endings; `hashlib` takes 6 ms to import."""
    checksum = 0
    for path in sorted((urdf_folder() / "xacro").glob("*.xacro")):
        content = path.read_bytes().replace(b"\r\n", b"\n")
        checksum = zlib.crc32(f"{path.name} {len(content)}\n".encode() + content, checksum)
    return f"{checksum:08x}"


def write_expanded() -> list[Path]:
    """Write the texts of all bases and hands, then the checksum of the sources; return the texts' files."""
    folder = urdf_folder() / "expanded"
    folder.mkdir(exist_ok=True)
    written = []
    for base in BASES:
        for hands in HANDS:
            written.append(_place(folder, base, hands))
            write_text(written[-1], expand(base=base, hands=hands))
    write_text(folder / _CHECKSUM, sources_checksum() + "\n")
    return written


def _place(folder: Path, base: str, hands: str) -> Path:
    return folder / f"pepper_{base}_{hands}.urdf"


if __name__ == "__main__":
    print("\n".join(map(str, write_expanded())))
