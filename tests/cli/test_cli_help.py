"""Help texts of the commands."""

import ast
import re
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import pepper_kin
from pepper_kin.cli import app


def commands(group, words=()):
    """Yield the words and the command of every command."""
    for name in group.list_commands(None):
        command = group.commands[name]
        if hasattr(command, "commands"):
            yield from commands(command, (*words, name))
        else:
            yield (*words, name), command


ALL = dict(commands(get_command(app)))


def extras_named():
    """Extras in the docstrings of commands: what pip gets in brackets."""
    package = Path(pepper_kin.__file__).parent
    for path in (*package.glob("cli/*.py"), *package.glob("*/command*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and (text := ast.get_docstring(node)):
                for extra in re.findall(r"pepper_kin\\?\[(\w+)\]", text):
                    yield path.parent.name, node.name, extra


@pytest.mark.thorough
def test_help_has_every_extra_that_is_to_be_installed():
    named = sorted(extras_named())
    assert named == [
        ("cli", "learn", "learning"), ("cli", "make", "datasets"), ("naoqi", "doctor", "naoqi"),
        ("naoqi", "mirror", "naoqi"), ("naoqi", "serve", "naoqi"),
    ]  # fmt: skip
    for words in ALL:
        shown = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200", "TERM": "dumb"})
        assert shown.exit_code == 0
        text = re.sub(r"\x1b\[[0-9;]*m", "", shown.stdout)
        wanted = {e for where, name, e in named if name == words[-1] and where in ("cli", words[0])}
        assert set(re.findall(r"pepper_kin\[(\w+)\]", text)) == wanted, words
        assert not re.search(r"pip install '?pepper_kin'?(?!\[)", text)
