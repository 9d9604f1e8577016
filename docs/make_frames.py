"""The drawing of the conventions, from the model: `docs/pictures/frames.svg`.

python docs/make_frames.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from make_axes import SCALE, circle, line, silhouette

import pepper_kin as pk

PICTURE = Path(__file__).parent / "pictures" / "frames.svg"
AXES = (("x", "#c0392b"), ("y", "#2e7d32"), ("z", "#1f77b4"))
LENGTH = 0.11  # of an axis [m]
NOTE = "#37474f"
# View -> the world's directions to the right and up in the picture, its middle, and frames with the places of
# their names.
VIEWS = {
    "from the left": (
        ((1, 0, 0), (0, 0, 1)), (260, 610),
        {
            "base_footprint": (-84, -8), "torso": (-46, 4),
            "CameraTop_frame": (70, 22), "LArm_effector": (-70, -14),
        },
    ),
    "from above": (
        ((0, -1, 0), (1, 0, 0)), (800, 370),
        {"base_footprint": (-4, 26), "LArm_effector": (74, 4)},
    ),
}  # fmt: skip


def main() -> None:
    """Write the picture."""
    pepper = pk.load_pepper()
    q = pepper.joint_vector(
        {"LShoulderPitch": 0.5, "LElbowRoll": -0.9, "LElbowYaw": -1.0, "LShoulderRoll": 0.25}
    )
    width, height = 1080, 680
    parts = [f'<rect width="{width}" height="{height}" fill="#fff"/>']
    for title, ((right, up), middle, frames) in VIEWS.items():
        plane, place = np.array([right, up], dtype=float) * [[1], [-1]] * SCALE, np.array(middle, dtype=float)
        parts.append(words(np.array([place[0], 24]), title, 16, "#1c2b33", True))
        parts += silhouette(pepper, q, plane, place)
        parts += wheels(plane, place)
        hand = plane @ pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3] + place
        dashes = f'stroke="{NOTE}" stroke-width="1.6" stroke-dasharray="6 4"'
        parts.append(f'<path d="M{line([place, hand])}" {dashes}/>')
        for name, shift in frames.items():
            parts += frame(pk.kinematics.frame_pose(pepper, q, name), name, np.array(shift), plane, place)
    parts.append(
        words(
            np.array([540, 646]), "dashed: transform_hand_to_world[:3, 3], where the hand is in the world", 13
        )
    )
    parts.append(
        words(
            np.array([540, 668]),
            "dotted: the triangle of the wheels, in which the zero-moment point stays",
            13,
        )
    )
    PICTURE.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">\n'
        "<title>The world, and frames of the robot</title>\n"
        "<style>text{font-family:sans-serif;text-anchor:middle}</style>\n" + "\n".join(parts) + "\n</svg>\n",
        encoding="utf-8",
    )


def frame(pose: np.ndarray, name: str, shift: np.ndarray, plane: np.ndarray, middle: np.ndarray) -> list[str]:
    """Return the axes of a frame, with its name; an axis along the line of sight is a ring."""
    start, parts = plane @ pose[:3, 3] + middle, []
    for (letter, color), direction in zip(AXES, pose[:3, :3].T, strict=True):
        along = LENGTH * plane @ direction
        length = float(np.linalg.norm(along))
        if length < 12:
            parts.append(circle(start, 6, color, "none"))
            continue
        end, unit = start + along, along / length
        side = 4 * np.array([-unit[1], unit[0]])
        parts.append(f'<path d="M{line([start, end])}" stroke="{color}" stroke-width="2.4"/>')
        parts.append(
            f'<path d="M{line([end, end - 10 * unit + side, end - 10 * unit - side])}Z" fill="{color}"/>'
        )
        parts.append(words(end + 11 * unit + [0, 4], letter, 13, color))
    return [*parts, circle(start, 3, NOTE, NOTE), words(start + shift, name, 12, "#1c2b33", True)]


def wheels(plane: np.ndarray, middle: np.ndarray) -> list[str]:
    """Return the triangle of the wheels' contacts with the floor."""
    corners = [
        plane @ np.append(contact, 0.0) + middle for contact in np.asarray(pk.dynamics.WHEEL_CONTACTS)[:, :2]
    ]
    return [
        f'<path d="M{line(corners)}Z" fill="none" stroke="{NOTE}" stroke-width="2" stroke-dasharray="2 4"/>'
    ]


def words(place: np.ndarray, text: str, size: int, color: str = NOTE, bold: bool = False) -> str:
    """Return a text around a point."""
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{place[0]:.1f}" y="{place[1]:.1f}" font-size="{size}" fill="{color}"{weight}>{text}</text>'
    )


if __name__ == "__main__":
    main()
