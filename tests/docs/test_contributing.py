"""The recipes of CONTRIBUTING.md, followed step by step as they are written there."""

import importlib
import importlib.util
import inspect
import re
import sys
import textwrap
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import pepper_kin as pk

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


class Recipe:
    """The steps of one recipe: its text in front of each block of code, and the blocks."""

    def __init__(self, title: str) -> None:
        text = re.search(rf"^### {title}\n(.*?)(?=^###? )", TEXT, re.MULTILINE | re.DOTALL)[1]
        parts = re.split(r"^    ```python\n(.*?)^    ```\n", text, flags=re.MULTILINE | re.DOTALL)
        self.words, self.blocks = parts[::2], [textwrap.dedent(block) for block in parts[1::2]]

    def named(self, step: int) -> list[str]:
        """Return what stands in code in front of a block."""
        return re.findall(r"`([^`]+)`", self.words[step])


def module_of(file: str) -> str:
    """Return the dotted name of a file of the repository."""
    name = file.removesuffix(".py").replace("/", ".")
    return name if name.startswith("pepper_kin.") else f"pepper_kin.{name}"


def written(file: str, text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Write a new file of the package into a folder, and import it as if it stood in its place."""
    assert not (ROOT / file).exists()
    path = folder / Path(file).name
    path.write_text(text, encoding="utf-8")
    specification = importlib.util.spec_from_file_location(module_of(file), path)
    module = importlib.util.module_from_spec(specification)
    monkeypatch.setitem(sys.modules, module_of(file), module)
    specification.loader.exec_module(module)
    return module


def test_a_task_is_added_as_the_recipe_says(tmp_path, monkeypatch):
    recipe = Recipe("A task for IK")
    task_file, entry, use, methods = recipe.blocks
    new = written(recipe.named(0)[0], task_file, tmp_path, monkeypatch)
    for file in [name for name in recipe.named(1) if name.endswith("__init__.py")]:
        place = sys.modules[module_of(file).removesuffix(".__init__")]
        assert "FramePosition" in place.__all__  # tasks are exported there
        monkeypatch.setattr(place, "FrameDistance", new.FrameDistance, raising=False)

    monkeypatch.syspath_prepend(str(ROOT / "tests" / "ik"))
    import test_ik_tasks

    assert recipe.named(1)[-2:] == ["TASKS", "tests/ik/test_ik_tasks.py"]
    added = eval("{" + entry + "}", vars(test_ik_tasks))
    monkeypatch.setattr(test_ik_tasks, "TASKS", test_ik_tasks.TASKS | added)
    for model in test_ik_tasks.MODELS:
        test_ik_tasks.test_jacobian_is_the_derivative_of_the_residual(*added, model)

    called_back: dict[str, object] = {"pk": pk}
    exec(use, called_back)
    reached = pk.kinematics.frame_pose(called_back["pepper"], called_back["result"].q, "LArm_effector")[:3, 3]
    assert abs(np.linalg.norm(reached - (0.4, 0.2, 0.9)) - 0.1) <= 1e-3

    (tmp_path / "compiled").mkdir()
    methods = textwrap.indent(methods, "    ")
    new = written(recipe.named(0)[0], f"{task_file}\n{methods}", tmp_path / "compiled", monkeypatch)
    monkeypatch.setattr(pk.ik, "FrameDistance", new.FrameDistance)
    compiled: dict[str, object] = {"pk": pk}
    exec(use, compiled)
    assert called_back["task"].structure() is None
    assert compiled["task"].structure().kind is new.FrameDistance
    np.testing.assert_allclose(compiled["result"].q, called_back["result"].q, atol=1e-7)


def test_a_planner_is_added_as_the_recipe_says(tmp_path, monkeypatch):
    recipe = Recipe("A planner")
    planner_file, test, call, use = recipe.blocks
    new = written(recipe.named(0)[-1], planner_file, tmp_path, monkeypatch)
    monkeypatch.setattr(pk.planners, "rrt", new.rrt, raising=False)
    names = {"np": np, "planners": pk.planners, "pk": pk}
    exec(test, names)
    names["test_rrt"]()

    added, table, file, function, line = recipe.named(2)[-5:]
    planning = importlib.import_module(module_of(file))
    monkeypatch.setattr(planning, table, (*getattr(planning, table), added.strip('"')))
    source = inspect.getsource(getattr(planning, function))
    (indented,) = re.findall(rf"^( *){re.escape(line)}\n", source, re.MULTILINE)
    edited = source.replace(indented + line, textwrap.indent(call, indented) + indented + line)
    monkeypatch.setitem(vars(planning), function, getattr(planning, function))  # put back at the end
    exec(compile(edited, file, "exec"), vars(planning))
    exec(use, names)
    assert names["plan"].search.iterations >= 1
