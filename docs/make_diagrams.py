"""The two pictures of the design page: the rooms, and a call of `plan` from end to end.

python docs/make_diagrams.py
"""

from __future__ import annotations

from html import escape
from pathlib import Path

HERE = Path(__file__).parent
STYLE = (
    "text{font-family:sans-serif;fill:#1c2b33}rect{rx:6;stroke:#546e7a;stroke-width:1.2}"
    ".room{fill:#eceff1}.core{fill:#ffe0b2}.reference{fill:#e0f2f1}.step{fill:#e3f2fd}"
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


def packages() -> None:
    """Draw the rooms: what stands higher is known to what stands lower."""
    d = Drawing(960, 690)
    d.box(40, 20, 250, 60, "model/", "room", "PepperModel, limits, URDF, digest")
    d.box(355, 20, 250, 60, "symbolic/", "room", "CasADi expressions of the model")
    d.box(670, 20, 250, 60, "kernels/", "core", "machine code: made, kept, shipped")
    d.box(
        670,
        130,
        250,
        75,
        "core/",
        "core",
        "each algorithm once, on arrays",
        "collision, IK, timing, simulation",
    )
    d.box(
        670,
        255,
        250,
        75,
        "planners/",
        "core",
        "search, graph, short-cut, constraint",
        "vectors and a validity checker",
    )
    d.box(40, 130, 170, 60, "kinematics/", "room", "poses, Jacobians")
    d.box(230, 130, 170, 60, "dynamics/", "room", "Newton-Euler, Pinocchio")
    d.box(420, 130, 190, 60, "batch/", "room", "kernels of a robot")
    d.box(230, 235, 250, 60, "collision/", "room", "Scene, verdicts, coal")
    d.box(230, 340, 250, 60, "ik/  servo/  base_placement/", "room", "tasks, results, solvers")
    d.box(230, 445, 250, 60, "trajectory/  files/", "room", "timing, certificate, formats")
    d.box(230, 550, 250, 60, "motion/", "room", "plan, gestures, optimization")
    d.box(520, 550, 180, 60, "twin/", "room", "run, world, sensors")
    d.box(730, 550, 190, 60, "jobs/  viewer/  cli", "room", "commands and page")
    for y in (190, 295, 400, 505):
        d.arrow((355, y), (355, y + 45))
    d.arrow((165, 80), (165, 130))
    d.arrow((480, 80), (480, 130))
    d.arrow((795, 80), (795, 130))
    d.arrow((795, 205), (795, 255))
    d.arrow((670, 190), (480, 250))
    d.arrow((670, 200), (480, 355))
    d.arrow((690, 205), (480, 460))
    d.arrow((670, 315), (480, 560))
    d.arrow((760, 205), (640, 240), (620, 550))
    d.arrow((480, 580), (520, 580))
    d.arrow((700, 580), (730, 580))
    d.text(
        480, 650, "An arrow leads from what is known to who knows it. Orange: knows nothing of robots.", 13
    )
    d.text(480, 672, "The certificate uses dynamics/ and coal, never core/.", 13)
    d.save("rooms.svg", "The rooms of pepper_kin and which way imports point")


def plan_call() -> None:
    """Draw a call of `plan`, `retime` and `check`."""
    d = Drawing(960, 560)
    left, width = 40, 270
    steps = [
        ("plan(pepper, start, tasks, scene)", "motion/planning.py", "checks what was asked for"),
        ("goals", "motion/task_goals.py", "IK from many starts, clear ones first"),
        ("search", "planners/rrt_connect.py", "two trees until they meet"),
        ("short-cut, smooth", "planners/shortcut.py, smooth.py", "a C2 spline"),
        ("examine", "motion/examination.py", "clear all along, by motion bounds"),
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
        (284, "core/splines", "cubic splines, Schoenberg", "way-points to C2 curve"),
        (372, "core/motion_bounds", "how far a joint moves a point", "proven, by the tree"),
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
        "finds the code of each part:",
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
        "ties, meshes, and the truth",
        "that tests compare with",
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
