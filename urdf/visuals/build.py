"""Visual geometry of all links, and its generated files."""

from __future__ import annotations

from pathlib import Path

from . import arm, head, leg, torso
from .macros import macros_file
from .part import Part
from .stl import to_bytes

URDF_FOLDER = Path(__file__).resolve().parent.parent
MESH_FOLDER = URDF_FOLDER / "meshes"
MACROS_FILE = URDF_FOLDER / "xacro" / "visuals.xacro"


def visuals() -> dict[str, list[Part]]:
    """Return the visuals of every link by its name; `phalanx` and `fingertip` serve all fingers."""
    left = {
        "LBicep": arm.left_bicep(),
        "LForeArm": arm.left_forearm(),
        "l_wrist": arm.left_wrist(),
    }
    right = {
        name.replace("L", "R", 1).replace("l_", "r_", 1): [part.mirrored() for part in parts]
        for name, parts in left.items()
    }
    shoulder, elbow, wheel = arm.shoulder(), arm.elbow(), leg.wheel()
    return {
        "Tibia": leg.tibia(),
        "Pelvis": leg.pelvis(),
        "Hip": leg.hip(),
        "torso": torso.torso(),
        "Neck": head.neck(),
        "Head": head.head(),
        **left,
        **right,
        **dict.fromkeys(("LShoulder", "RShoulder"), shoulder),
        **dict.fromkeys(("LElbow", "RElbow"), elbow),
        **dict.fromkeys(("WheelFL_link", "WheelFR_link", "WheelB_link"), wheel),
        "phalanx": arm.phalanx(),
        "fingertip": arm.fingertip(),
    }


def files() -> dict[Path, bytes]:
    """Return the content of every generated file by its path."""
    links = visuals()
    content = {
        MESH_FOLDER / f"{part.name}.stl": to_bytes(part.mesh) for parts in links.values() for part in parts
    }
    content[MACROS_FILE] = macros_file(links).encode()
    return content


def write() -> list[Path]:
    """Write every generated file, remove meshes that no link uses any more, and return the paths written."""
    content = files()
    for folder in {path.parent for path in content}:
        folder.mkdir(parents=True, exist_ok=True)
    for path, data in content.items():
        path.write_bytes(data)
    for stale in set(MESH_FOLDER.glob("*.stl")) - set(content):
        stale.unlink()
    return sorted(content)
