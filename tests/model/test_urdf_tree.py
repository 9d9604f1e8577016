"""The tree of a description's text: parsed in one place, shared by readers, copied for changes."""

import ast
import pickle
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import pepper_kin as pk

PACKAGE = Path(pk.__file__).parent
PARSES_MESHES = PACKAGE / "collision" / "mesh_server.py"


def written(tree):
    return ET.tostring(tree, encoding="unicode")


@pytest.mark.thorough
def test_descriptions_are_parsed_in_one_file():
    parsing = set()
    for path in PACKAGE.rglob("*.py"):
        calls = [
            node.func for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call)
        ]
        if any(isinstance(call, ast.Attribute) and call.attr == "fromstring" for call in calls):
            parsing.add(path)
    assert parsing - {PARSES_MESHES} == {PACKAGE / "model" / "xml_source.py"}


def test_changes_and_exports_leave_the_shared_tree_as_it_was(tmp_path):
    robot = pk.load_pepper(hands="mimic")
    tree, semantics = robot.document.tree, robot.semantics.tree
    before = written(ET.fromstring(robot.urdf)), written(ET.fromstring(robot.semantics.text))
    robot.with_limits(velocity=0.5)
    robot.with_masses({"Head": 2.0})
    assert robot.inner_model.nv > robot.n
    for format in ("urdf", "srdf", "sdf", "mjcf"):
        robot.export(format, mesh_paths="relative")
    robot.export("urdf", zero_inertials=True)
    assert robot.document.tree is tree
    assert robot.semantics.tree is semantics
    assert (written(tree), written(semantics)) == before


def test_copies_for_other_processes_do_not_carry_the_tree():
    document = pk.load_pepper().document
    assert written(document.tree)
    copy = pickle.loads(pickle.dumps(document))
    assert copy == document
    assert "tree" not in vars(copy)
    assert written(copy.tree) == written(document.tree)
