"""Generator of the visual meshes and their xacro file."""

from __future__ import annotations

from .build import MESH_FOLDER, write


def main() -> None:
    """Write the files and say how large they are."""
    paths = write()
    size = sum(path.stat().st_size for path in paths)
    print(f"wrote {len(paths)} files, {size / 1e6:.2f} MB, meshes in {MESH_FOLDER}")


if __name__ == "__main__":
    main()
