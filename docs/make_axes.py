"""The drawing of the robot's named axes, from the model: `docs/pictures/axes.svg`, and their table.

python docs/make_axes.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

import pepper_kin as pk
from pepper_kin.model import Box, Capsule, Sphere

PICTURE = Path(__file__).parent / "pictures" / "axes.svg"
WHITE = "#fff"
SCALE = 430.0  # picture units a meter
LENGTH = 0.12  # of an arrow [m]
COLORS = {
    "palm": "#c0392b",
    "fingers": "#1f77b4",
    "thumb": "#6a3d9a",
    "camera": "#b15928",
    "sonar": "#00796b",
}
OTHERS = "#37474f"
VIEWS = {
    # Name -> the world's directions to the right and up in the picture, and the axes that are shown.
    "from the left": ((1, 0, 0), (0, 0, 1), ("left", "camera", "sonar", "shovel", "tablet", "front laser")),
    "from the front": ((0, 1, 0), (0, 0, 1), ("left palm", "left thumb", "left fingers", "right")),
    "from above": ((0, -1, 0), (1, 0, 0), ("laser", "sonar", "palm", "thumb", "fingers")),
}
HIDDEN = {"from the left": ("left laser",), "from the front": ("right laser",), "from above": ("shovel",)}


def main() -> None:
    """Write the picture and print the table."""
    pepper = pk.load_pepper()
    left, right = (0.9, 0.25, -1.2, -0.6, 0.0), (0.9, -0.25, 1.2, 0.6, 0.0)
    q = pepper.joint_vector({"left_arm": left, "right_arm": right})
    axes = pk.kinematics.named_axes(pepper, q)
    numbers = {name: k + 1 for k, name in enumerate(axes)}
    width, height = 1320, 620
    parts = [f'<rect width="{width}" height="{height}" fill="#fff"/>']
    for column, (title, (right, up, shown)) in enumerate(VIEWS.items()):
        plane = np.array([right, up], dtype=float) * [[1], [-1]] * SCALE
        middle = np.array([220 + 440 * column, 590 if up[2] else 330])
        parts.append(f'<text x="{middle[0]}" y="24" font-size="16" font-weight="600">{title}</text>')
        parts += silhouette(pepper, q, plane, middle)
        taken: list[np.ndarray] = []
        for name, axis in axes.items():
            wanted = any(word in name for word in shown) and not any(w in name for w in HIDDEN[title])
            if wanted:
                parts += arrow(axis, numbers[name], plane, middle, taken)
    text = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">\n'
        "<title>Axes of Pepper's palms, fingers and sensors</title>\n"
        "<style>text{font-family:sans-serif;text-anchor:middle;fill:#1c2b33}</style>\n"
        + "\n".join(parts)
        + "\n</svg>\n"
    )
    PICTURE.write_text(text, encoding="utf-8")
    print("| | axis | frame | of the frame | what |\n|---|---|---|---|---|")
    for name, axis in axes.items():
        print(f"| {numbers[name]} | {name} | `{axis.frame}` | {axis.axis} | {axis.meaning} |")


def silhouette(pepper: pk.PepperModel, q: np.ndarray, plane: np.ndarray, middle: np.ndarray) -> list[str]:
    """Return the collision shapes as gray outlines, those far away first."""
    poses = dict(zip(pepper.link_names, pk.kinematics.link_poses(pepper, q), strict=True))
    toward = np.cross(plane[0], -plane[1]) / SCALE**2
    drawn = []
    for shape in pepper.collision_shapes:
        pose = poses[shape.link] @ shape.transform_shape_to_link
        depth = float(toward @ pose[:3, 3])
        if isinstance(shape.geometry, Capsule):
            ends = [pose[:3, 3] + s * shape.geometry.length / 2 * pose[:3, 2] for s in (-1, 1)]
            points, thick = [plane @ end + middle for end in ends], 2 * shape.geometry.radius * SCALE
        elif isinstance(shape.geometry, Sphere):
            points, thick = [plane @ pose[:3, 3] + middle] * 2, 2 * shape.geometry.radius * SCALE
        elif isinstance(shape.geometry, Box):
            half = np.array(shape.geometry.size) / 2
            corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half
            flat = (corners @ pose[:3, :3].T + pose[:3, 3]) @ plane.T + middle
            points, thick = list(flat[ConvexHull(flat).vertices]), 1.0
        else:
            continue
        look = f'stroke-linecap="round" stroke-width="{thick:.1f}" fill="#e4e9ec"'
        drawn.append((depth, f'<path d="M{line(points)}Z" stroke="#e4e9ec" {look} stroke-linejoin="round"/>'))
    return [part for _, part in sorted(drawn, key=lambda item: item[0])]


def arrow(
    axis: pk.kinematics.NamedAxis, number: int, plane: np.ndarray, middle: np.ndarray, taken: list[np.ndarray]
) -> list[str]:
    """Return an arrow with its number; of an axis along the line of sight a ring."""
    color = next((c for word, c in COLORS.items() if word in axis.name), OTHERS)
    start, along = plane @ axis.origin + middle, LENGTH * plane @ axis.direction
    length = float(np.linalg.norm(along))
    parts = [circle(start, 3, color, color)]
    place = start + (along * (1 + 12 / length) if length > 14 else np.array([0.0, -16.0]))
    if length > 14:
        end, unit = start + along, along / length
        side = 4 * np.array([-unit[1], unit[0]])
        tip = [end, end - 10 * unit + side, end - 10 * unit - side]
        parts.append(f'<path d="M{line([start, end])}" stroke="{color}" stroke-width="2.2"/>')
        parts.append(f'<path d="M{line(tip)}Z" fill="{color}"/>')
    else:
        parts.append(circle(start, 7, color, "none"))
    while any(np.linalg.norm(place - other) < 17 for other in taken):
        place = place + np.array([0.0, -17.0])
    taken.append(place)
    parts.append(circle(place, 9, color, WHITE))
    parts.append(f'<text x="{place[0]:.1f}" y="{place[1] + 4:.1f}" font-size="11">{number}</text>')
    return parts


def line(points: list[np.ndarray]) -> str:
    """Return points as they stand in the path of an SVG file, after its M."""
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def circle(middle: np.ndarray, radius: float, color: str, fill: str) -> str:
    """Return a circle."""
    return f'<circle cx="{middle[0]:.1f}" cy="{middle[1]:.1f}" r="{radius}" fill="{fill}" stroke="{color}"/>'


if __name__ == "__main__":
    main()
