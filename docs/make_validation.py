"""Write docs/validation.md from what the check commands find: python docs/make_validation.py."""

import io
import platform
import re
from pathlib import Path

import pepper_kin as pk
from pepper_kin.jobs import check_dynamics, check_paper, check_physics
from pepper_kin.paper.files import paper_figure

FOLDER = Path(__file__).parent

HEAD = """# Validation

What the `check` commands find on Pepper, as they print it. This page is written by `python
docs/make_validation.py`; run the commands to see it on your machine. Each exits with 1 if something is
beyond its limit, takes `--json`, and the last two take `-o DIR` for files.

## `pepper-kin check paper`

The validation of the published digital twin (Sekkat et al., *Heliyon* 2024), made again: joint limits
(table 4), three movements at five frames (table 5), tracking over 1000 iterations (figures 6 and 7), and
joint angles measured by accelerometers on the links (section 3.3). What the paper's formulas print for
roll, pitch and yaw was not at hand; they are taken in their usual form ([API](api/twin.md)). The period of
an iteration is assumed to be 10 ms. The command also prints table 5 frame by frame; the largest errors are
in [Gestures](gestures.md#the-papers-gestures).

"""

PHYSICS = """
## `pepper-kin check physics`

The same model, gains and inputs in MuJoCo (`pip install "pepper_kin[mujoco]"`). The free swing agrees to
rounding, since both engines use semi-implicit Euler there; where servos are at work, MuJoCo takes their
stiffness explicitly and the twin implicitly, and the difference shrinks with the timestep.

"""

DYNAMICS = """
## `pepper-kin check dynamics`

"""


def main() -> None:
    """Run the checks and write page and pictures."""
    paper, physics, dynamics = check_paper(), check_physics(), check_dynamics(pk.load_pepper())
    text = HEAD + block(without_frames(paper.report()))
    for movement in paper.movements:
        name = f"paper_{movement.name}.png"
        content = io.BytesIO()
        paper_figure(movement).savefig(content, format="png", dpi=80)
        (FOLDER / "pictures" / name).write_bytes(content.getvalue())
        text += f"\n![{movement.name}: joints, tracking errors, angles from sensors](pictures/{name})\n"
    text += PHYSICS + block(physics.report()) + DYNAMICS + block(dynamics.report())
    text += f"\nPython {platform.python_version()}, {platform.machine()}.\n"
    (FOLDER / "validation.md").write_text(text, encoding="utf-8")


def without_frames(report: str) -> str:
    """Return the report without the values of table 5 at each frame, which fill three screens."""
    return re.sub(r"== Table 5.*?(?=^== Figures)", "", report, flags=re.DOTALL | re.MULTILINE)


def block(report: str) -> str:
    """Return a report as a block of text."""
    return f"```text\n{report}\n```\n"


if __name__ == "__main__":
    main()
