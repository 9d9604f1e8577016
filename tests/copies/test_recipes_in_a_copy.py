"""Recipes of CONTRIBUTING.md, followed to the letter in a copy of the repository.

Beside its own tests each has to pass those that guard conventions of the whole repository, and the linter.
Where a step of a recipe is left out, one of these fails, with a sentence that names what is missing.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^    ```(\w+)\n(.*?)^    ```\n", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"`((?:pepper_kin|planners|tests|docs)/[\w/]+\.\w+|CHANGELOG\.md)`")
MOST_WORDS = 300
pytestmark = pytest.mark.timeout(1800)  # what a recipe edits of the core is made anew
GUARDS = (
    "tests/test_public_api.py",
    "tests/test_architecture.py",
    "tests/docs/test_concepts.py",
    "tests/docs/test_pages.py",
    "tests/ik/test_ik_tasks.py",
    "tests/planners/test_planner_certificate.py",
    "tests/sensors/test_sensor_documents.py",
    "tests/twin/test_actuators.py",
)
"""What every change of the repository has to pass, and the tests of what a recipe adds."""
NOT_OF_RECIPES = "not frozen and not interfaces_are_deleted and not example"
"""Slow ones that look at no file that a recipe edits."""
IN_ONE_PROCESS = ("-n", "0", "-o", f"cache_dir={ROOT / '.pytest_cache' / 'copies'}")
"""Machine code is kept from copy to copy."""


class Copy:
    """A copy of the repository, imported in place of the one that is installed: links until a file is edited.

    Attributes:
        programs: Blocks of the recipe that belong to no file.
        tests: Files to which it adds tests, with their names.
        written: Files that it adds or edits.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.programs, self.tests = folder, list[str](), dict[str, list[str]]()
        self.written: set[str] = set()
        folders = "pepper_kin planners urdf tests docs examples benchmarks findings .github"
        for name in folders.split():
            without = shutil.ignore_patterns("__pycache__", "results")
            shutil.copytree(ROOT / name, folder / name, ignore=without, copy_function=os.symlink)
        for name in ("planners", "urdf"):  # as they are installed
            (folder / "pepper_kin" / name).symlink_to(folder / name)
        for name in ("pyproject.toml", "mkdocs.yml", "CITATION.cff", "LICENSE"):
            shutil.copy(ROOT / name, folder)
        for path in ROOT.glob("*.md"):
            shutil.copy(path, folder)

    def follow(self, title: str, first: int = 1, last: int = 9, without: str = "") -> None:
        """Do what the steps of a recipe say: a block belongs to the last file named in front of it.

        `diff` edits it, other text is a new file, or is added to one that is there.  Edits of the file
        `without` are left out.
        """
        (recipe,) = re.findall(rf"^### {title}\n(.*?)(?=^###? )", TEXT, re.MULTILINE | re.DOTALL)
        parts = BLOCK.split(recipe)
        assert sum(len(words.split()) for words in parts[::3]) <= MOST_WORDS
        file, step = None, 0
        for words, kind, block in zip(parts[::3], parts[1::3], parts[2::3], strict=False):
            named, text = FILE.findall(words), textwrap.dedent(block)
            begun = re.findall(r"^(\d)\. ", words, re.MULTILINE)
            if named or begun:
                file, step = named[-1] if named else None, int((begun or [step])[-1])
            if file == without or not first <= step <= last:
                continue
            if file is None:
                self.programs.append(text)
            elif kind == "diff":
                self.edit(file, text)
            elif file.startswith("tests/"):
                self.tests[file] = re.findall(r"^def (test_\w+)", text, re.MULTILINE)
                self.write(file, f"{(self.folder / file).read_text('utf-8')}\n\n{text}")
            else:
                assert not (self.folder / file).exists()
                self.write(file, text)

    def edit(self, file: str, diff: str) -> None:
        """Apply a block `diff`, whose old lines stand in the file, once."""
        lines = [line if line.strip() else " \n" for line in diff.splitlines(keepends=True)]
        assert all(line[0] in " +-" for line in lines)
        old, new = ("".join(line[1:] for line in lines if line[0] in kept) for kept in (" -", " +"))
        text = "\n" + (self.folder / file).read_text("utf-8")
        assert text.count("\n" + old) == 1, f"{file} has not one place for:\n{diff}"
        self.write(file, text.replace("\n" + old, "\n" + new)[1:])

    def write(self, file: str, text: str) -> None:
        """Write a file; the lines of code are no longer than others are, without what is said to mypy."""
        lines = [line.split("  # type: ignore")[0] for line in text.splitlines()]
        assert not file.endswith(".py") or max(map(len, lines)) <= 110
        self.written.add(file)
        (self.folder / file).unlink(missing_ok=True)  # a link
        (self.folder / file).write_text(text, encoding="utf-8")

    def run(self, *arguments: str) -> str:
        """Run Python with the copy; return what it prints."""
        done = self.attempt(*arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def attempt(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run Python with the copy."""
        of_this_run = ("PYTEST", "COV")  # its options, such as coverage, are not the copy's
        inherited = {name: value for name, value in os.environ.items() if not name.startswith(of_this_run)}
        return subprocess.run(
            [sys.executable, *arguments],
            capture_output=True,
            text=True,
            cwd=self.folder,
            env={**inherited, "PYTHONPATH": str(self.folder)},
            check=False,
        )

    def run_guards(self) -> None:
        """Run what continuous integration asks of every change: conventions, tables of pages, the linter."""
        written = sorted(file for file in self.written if file.endswith(".py"))
        self.run("-m", "ruff", "check", "--no-cache", *written)
        self.run("-m", "ruff", "format", "--no-cache", "--check", *written)
        self.run_tests(60, *GUARDS, "-k", NOT_OF_RECIPES)

    def fails(self, test: str) -> str:
        """Run a file of tests, one of which has to fail; return what is printed."""
        done = self.attempt("-m", "pytest", *IN_ONE_PROCESS, test, "-k", "every")
        assert done.returncode == 1, done.stdout + done.stderr
        return done.stdout

    def run_its_tests(self) -> None:
        """Run the tests that the recipe adds."""
        for file, names in self.tests.items():
            self.run_tests(len(names), file, "-k", " or ".join(names))

    def run_tests(self, least: int, *arguments: str) -> None:
        """Run tests of the copy, with no fewer of them passing than expected."""
        said = self.run("-m", "pytest", *IN_ONE_PROCESS, *arguments)
        assert int(re.findall(r"(\d+) passed", said)[0]) >= least

    def values(self, after: str) -> Any:
        """Run the recipe's programs, and code that sets `found`; return it, as JSON carries it."""
        before = "import json\nimport numpy as np\nimport pepper_kin as pk\n"
        code = [before, *self.programs, textwrap.dedent(after)]
        printed = self.run("-c", "\n".join([*code, "print(pk.__file__)\nprint(json.dumps(found))"]))
        *_, package, found = printed.splitlines()
        assert Path(package).is_relative_to(self.folder)
        return json.loads(found)


def test_a_task_is_added_as_the_recipe_says(copy):
    """In machine code it finds the same as by calls of Python, at the distance from the point."""
    copy.follow("A task for IK", last=4)
    after = """
        hand = pk.kinematics.frame_pose(pepper, result.q, "LArm_effector")[:3, 3]
        found = [result.q.tolist(), float(np.linalg.norm(hand - (0.4, 0.2, 0.9))), task.structure() is None]
    """
    *called_back, plain = copy.values(after)
    assert plain
    assert called_back[1] == pytest.approx(0.1, abs=1e-3)
    copy.follow("A task for IK", first=5)
    *in_machine_code, plain = copy.values(after)
    assert not plain
    assert in_machine_code[0] == pytest.approx(called_back[0], abs=1e-7)
    copy.run_tests(4, "tests/ik/test_ik_tasks.py", "tests/ik/test_ik_fast.py", "-k", "distance")


def test_a_planner_is_added_as_the_recipe_says(copy):
    copy.follow("A planner")
    assert copy.values("found = plan.search.iterations") >= 1
    file = "tests/planners/test_planner_certificate.py"
    certified = f"{file}::test_paths_of_every_planner_are_certified_and_those_of_its_seed[rrt]"
    said = f"{file}::test_every_planner_says_that_it_found_no_path_and_that_the_start_is_invalid[rrt]"
    copy.run_tests(2, certified, said)
    copy.run_tests(1, "tests/motion/test_plan.py", "-k", "planner")


def test_all_recipes_together_pass_what_guards_the_repository(copy):
    """Conventions, tables of pages, words, tests of Jacobians and certificates, the linter."""
    for title in re.findall(r"^### (.*)$", TEXT.partition("\n## Recipes\n")[2], re.MULTILINE)[:-1]:
        copy.follow(title)
    assert len(copy.written) > 25
    copy.run_guards()


@pytest.mark.parametrize(
    ("title", "left_out", "guard"),
    [
        ("A task for IK", "tests/ik/test_ik_tasks.py", "tests/ik/test_ik_tasks.py"),
        ("A task for IK", "docs/ik.md", "tests/ik/test_ik_tasks.py"),
        (
            "A planner",
            "tests/planners/test_planner_certificate.py",
            "tests/planners/test_planner_certificate.py",
        ),
        ("A planner", "docs/planners.md", "tests/planners/test_planner_certificate.py"),
        ("A planner", "docs/planning.md", "tests/planners/test_planner_certificate.py"),
        ("A sensor", "docs/sensors.md", "tests/sensors/test_sensor_documents.py"),
        ("An actuator", "docs/twin.md", "tests/twin/test_actuators.py"),
    ],
)
def test_a_step_that_is_left_out_is_asked_for(copy, title, left_out, guard):
    """By the file in which something is missing, and by what is to be added."""
    copy.follow(title, without=left_out)
    said = copy.fails(guard)
    assert re.search(rf"AssertionError: (add|say) .*{left_out}", said), said


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path / "repository")


def test_a_sensor_is_added_as_the_recipe_says(copy):
    """Its readings along a run of the twin are the angle that closed forms give, with bias and noise."""
    copy.follow("A sensor")
    copy.run_its_tests()
    copy.run_tests(1, "tests/sensors/test_sensor_suite.py", "-k", "data_name_frames")
    found = copy.values("""
        from pepper_kin.twin.sensors import SensorSuite

        pepper = pk.load_pepper()
        suite = SensorSuite(pepper, seed=1)
        goal = pepper.joint_vector({"HipPitch": -0.5, "HipRoll": 0.3, "KneePitch": 0.2})
        trajectory = pk.retime(pepper, [pepper.posture("Stand"), goal])
        run = pk.Twin(pepper, sensors=suite).execute(trajectory, hold_time=20.0)
        read = run.readings["torso_inclinometer"]
        angles = run.position[np.searchsorted(run.time, read.time - 1e-9)]
        knee, hip, roll = (angles[:, pepper.joint_index(n)] for n in ("KneePitch", "HipPitch", "HipRoll"))
        tilt = np.arccos(np.cos(knee + hip) * np.cos(roll))
        error = read.value - read.truth
        wrong = np.abs(read.truth - tilt).max()
        found = [len(tilt), np.ptp(tilt), wrong, abs(error.mean()), error.std()]
    """)
    count, range_of_angles, wrong, bias, noise = found
    assert count > 400
    assert range_of_angles > 0.3
    assert wrong < 1e-7
    assert bias < 4 * 0.005
    assert noise == pytest.approx(0.002, rel=0.2)


def test_an_actuator_is_added_as_the_recipe_says(copy):
    """In machine code it does what the program does in Python, and what its closed form says."""
    copy.follow("An actuator")
    copy.run_its_tests()
    found = copy.values("""
        from pepper_kin.twin import actuator_parameters

        rest = pk.Twin(pepper).follow(np.tile(pepper.posture("Stand"), (100, 1)))
        params = actuator_parameters(pepper).changed(spring_stiffness=1.0)
        compiled = pk.Twin(pepper, actuators=params).follow(np.tile(pepper.posture("Stand"), (100, 1)))
        found = [np.abs(run.position - other.position).max() for other in (rest, compiled)]
    """)
    assert found[0] > 1e-4
    assert found[1] < 1e-12


def test_a_robot_is_added_as_the_recipe_says(copy):
    """What it reaches and measures is what Pinocchio says of the same file."""
    copy.follow("A second robot")
    found = copy.values("""
        import pinocchio

        model = pinocchio.buildModelFromXML(panda.urdf)
        data = model.createData()

        def pose(q, frame):
            pinocchio.framesForwardKinematics(model, data, panda.to_full(q))
            return data.oMf[model.getFrameId(frame)]

        reached = [pose(q, "panda_hand_tcp").translation.tolist() for q in (start.q, run.position[-1])]
        v, a = (np.abs(x).max(axis=0) for x in trajectory(np.linspace(0, trajectory.duration, 2000))[1:3])
        still = pose(run.position[-1], "panda_hand").rotation.T @ [0.0, 0.0, 9.81]
        read = run.readings["hand"].truth[-1]
        names = panda.joint_names
        found = {
            "reached": reached,
            "measured": np.abs(read - still).max(),
            "velocity": (v / panda.velocity_limits).max(),
            "acceleration": dict(zip(names, a.tolist())),
        }
    """)
    start, end = found["reached"]
    assert start == pytest.approx([0.4, -0.3, 0.4], abs=1e-3)
    assert end == pytest.approx([0.4, 0.3, 0.4], abs=3e-3)
    assert found["measured"] < 0.05
    assert 0.3 < found["velocity"] <= 1 + 1e-6
    for k, limit in enumerate((15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0), start=1):
        assert found["acceleration"][f"panda_joint{k}"] <= limit * (1 + 1e-6)
