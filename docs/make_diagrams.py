"""The two pictures of the design page: the packages, and a call of `plan` from end to end.

python docs/make_diagrams.py
"""

from __future__ import annotations

from html import escape
from pathlib import Path

HERE = Path(__file__).parent
STYLE = (
    "text{font-family:sans-serif;fill:#1c2b33}rect{rx:6;stroke:#546e7a;stroke-width:1.2}"
    ".layer{fill:#fafafa;stroke-dasharray:5 4}"
    ".package{fill:#eceff1}.core{fill:#ffe0b2}.reference{fill:#e0f2f1}.step{fill:#e3f2fd}"
    "path{stroke:#37474f;stroke-width:1.4;fill:none;marker-end:url(#head)}"
)
HEAD = (
    '<marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
    'orient="auto"><path d="M0 0L10 5L0 10z" style="fill:#37474f;stroke:none"/></marker>'
)


class Drawing:
    """Boxes with words, and arrows between them."""

    def __init__(self, width: int, height: int) -> None:
        self._size, self._parts = (width, height), list[str]()

    def box(self, x: int, y: int, width: int, height: int, title: str, kind: str, *lines: str) -> None:
        """Add a box with a title and lines of small text."""
        self._parts.append(f'<rect class="{kind}" x="{x}" y="{y}" width="{width}" height="{height}" rx="6"/>')
        self.text(x + width // 2, y + 19, title, 14, bold=True)
        for row, line in enumerate(lines):
            self.text(x + width // 2, y + 37 + 15 * row, line, 11)

    def layer(self, x: int, y: int, width: int, height: int, title: str) -> None:
        """Add the background of several boxes, with its title at the top."""
        self._parts.append(f'<rect class="layer" x="{x}" y="{y}" width="{width}" height="{height}" rx="6"/>')
        self.text(x + 110, y + 22, title, 14, bold=True)

    def text(self, x: int, y: int, words: str, size: int, *, bold: bool = False) -> None:
        """Add words around a point."""
        weight = ' font-weight="600"' if bold else ""
        self._parts.append(
            f'<text x="{x}" y="{y}" font-size="{size}" text-anchor="middle"{weight}>{escape(words)}</text>'
        )

    def arrow(self, *points: tuple[int, int]) -> None:
        """Add an arrow through points."""
        self._parts.append('<path d="M' + "L".join(f"{x} {y}" for x, y in points) + '"/>')

    def save(self, name: str, title: str) -> None:
        """Write an SVG file."""
        width, height = self._size
        body = "\n".join(self._parts)
        (HERE / "pictures" / name).write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">\n'
            f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n<defs>{HEAD}</defs>\n"
            f'<rect width="{width}" height="{height}" style="fill:#fff;stroke:none"/>\n{body}\n</svg>\n',
            encoding="utf-8",
        )


ROWS = (
    (("model/", "PepperModel, limits, URDF, exports"),),
    (("symbolic/", "quantities as CasADi expressions"),),
    (("batch/", "kernels of a robot, batches"),),
    (("kinematics/", "poses, Jacobians, reach maps"), ("dynamics/", "Pinocchio, Newton-Euler")),
    (("collision/", "scenes, distances, the compiled check"),),
    (
        ("ik/  servo/  base_placement/", "tasks, solvers, results"),
        ("trajectory/  files/", "timing, certificate"),
    ),
    (("motion/", "planning, gestures, optimization"),),
    (("twin/", "simulation, contacts, sensors"),),
    (("supervision", "motions on a robot"), ("jobs/  viewer/", "whole jobs, pages, films")),
    (("cli/", "the commands"),),
    (("paper/  naoqi/  ros/", "on the twin, with their commands"),),
    (("qibullet/", "qiBullet's classes over the twin"),),
)
"""Packages from the top down, side by side: name and contents."""
FROM_CORE = (2, 3, 4, 5, 6, 7)
"""Rows that import `core`."""
INTERFACES = 10
"""First row of the interfaces."""
NO_ROBOT = (
    (0, "kernels/", "machine code: compiled,", "cached"),
    (2, "core/", "each algorithm once, on arrays:", "IK, collision, timing, simulation"),
    (6, "planners/", "searches, roadmaps, shortcuts", "on vectors and a validity checker"),
    (10, "ros_messages/", "ROS 2's messages, without ROS;", "only the interfaces use it"),
)
"""Packages that are independent of robots: a row beside which each stands, name and contents."""


def packages() -> None:
    """Draw the packages in their three layers: lower ones import higher ones."""
    d = Drawing(960, 1030)
    left, right, height, step, top = 50, 620, 52, 74, 56
    y_of = [top + step * k + (44 if k >= INTERFACES else 0) for k in range(len(ROWS))]
    d.layer(20, 20, 620, y_of[INTERFACES] - 48, "The toolkit")
    d.layer(680, 20, 260, 974, "Independent of robots")
    d.layer(20, y_of[INTERFACES] - 36, 620, 1030 - y_of[INTERFACES], "The interfaces")
    for k, row in enumerate(ROWS):
        y, width = y_of[k], (right - left - 20 * (len(row) - 1)) // len(row)
        for j, (name, words) in enumerate(row):
            d.box(left + j * (width + 20), y, width, height, name, "package", words)
        if k:
            for x in (185, 475) if len(row) + len(ROWS[k - 1]) > 2 else (330,):
                d.arrow((x, y_of[k - 1] + height), (x, y))
    for k, name, *lines in NO_ROBOT:
        d.box(705, y_of[k], 215, 66, name, "core", *lines)
    for above, below in ((0, 2), (2, 6)):
        d.arrow((812, y_of[above] + 66), (812, y_of[below]))
    for k in FROM_CORE:
        d.arrow((705, y_of[2] + 33), (660, y_of[2] + 33), (660, y_of[k] + 20), (right, y_of[k] + 20))
    for k in (6, 10):
        d.arrow((705, y_of[k] + 40), (right, y_of[k] + 40))
    d.text(
        480, 1018, "An arrow points to a package that imports; packages import only what is above them.", 13
    )
    d.save("packages.svg", "The packages of pepper_kin in their three layers, and the direction of imports")


def plan_call() -> None:
    """Draw a call of `plan`, `retime` and `check`."""
    d = Drawing(960, 560)
    left, width = 40, 270
    steps = [
        ("plan(pepper, start, tasks, scene)", "motion/planning.py", "checks its arguments"),
        ("goals", "motion/goal_search.py", "IK from many starts, collision-free"),
        ("search", "planners/rrt_connect.py", "two trees until they meet"),
        ("shortcut, smooth", "planners/shortcut.py, smooth.py", "a C2 spline"),
        ("examine", "collision/curve_examination.py", "collision-free, by motion bounds"),
        ("Plan", "motion/plan_result.py", "curve, path, status, sentence"),
    ]
    for k, (title, *lines) in enumerate(steps):
        y = 20 + 88 * k
        d.box(left, y, width, 66, title, "step", *lines)
        if k:
            d.arrow((left + width // 2, y - 22), (left + width // 2, y))
    core = [
        (
            108,
            "core/inverse_kinematics",
            "Levenberg-Marquardt, multi-start",
            "kernel of the tasks, by address",
        ),
        (196, "core/collision", "verdicts of states and edges", "spheres, then exact cores"),
        (284, "core/splines", "cubic splines, Schoenberg", "waypoints to C2 curve"),
        (372, "core/motion_bounds", "how far a joint moves a point", "proven, by the kinematic tree"),
    ]
    for y, title, *lines in core:
        d.box(390, y, 250, 66, title, "core", *lines)
        d.arrow((left + width, y + 33), (390, y + 33))
    d.arrow((left + width, 325), (350, 325), (350, 235), (390, 235))
    d.arrow((left + width, 413), (360, 413), (360, 240), (390, 240))
    d.box(
        710,
        108,
        220,
        66,
        "kernels/",
        "core",
        "looks up the code of each part:",
        "package, cache folder, builder",
    )
    for y in (141, 229, 317, 405):
        d.arrow((640, y), (680, y), (680, 150), (710, 150))
    d.box(
        710,
        284,
        220,
        66,
        "coal, Pinocchio",
        "reference",
        "ties, meshes, and reference",
        "values of the tests",
    )
    d.box(390, 470, 250, 66, "retime(pepper, plan)", "step", "core/timing", "times exactly plan.curve")
    d.box(
        710,
        470,
        220,
        66,
        "trajectory.check",
        "reference",
        "Newton-Euler and coal:",
        "shares no code with core/",
    )
    d.arrow((left + width, 500), (390, 500))
    d.arrow((640, 500), (710, 500))
    d.save("plan_call.svg", "A call of plan, retime and check from end to end")


if __name__ == "__main__":
    packages()
    plan_call()
