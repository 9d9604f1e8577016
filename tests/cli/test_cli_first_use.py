"""What a newcomer meets: units in the help, folders that are missing or cannot be written."""

import os
import subprocess
import sys

import pytest
import typer

import pepper_kin as pk
from pepper_kin.cli import app
from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access.atomic_file import check_folder

PROGRAM = [sys.executable, "-c", "from pepper_kin.cli import main; main()"]


def run(*arguments, cwd):
    return subprocess.run(
        [*PROGRAM, *arguments], capture_output=True, text=True, cwd=cwd, check=False, timeout=300,
        env={**os.environ, "COLUMNS": "200"},
    )  # fmt: skip


def leaves(command):
    if not hasattr(command, "commands"):
        return [command]
    return [leaf for name in command.list_commands(None) for leaf in leaves(command.commands[name])]


def test_help_writes_units_in_words():
    """Units in square brackets are taken for marks of color, and vanish."""
    for command in leaves(typer.main.get_command(app)):
        for parameter in command.params:
            assert "[" not in (getattr(parameter, "help", None) or ""), (command.name, parameter.name)


def test_help_of_reach_names_its_units(tmp_path):
    output = run("reach", "--help", cwd=tmp_path).stdout
    assert "Where the palm should go: X Y Z, in meters." in output
    assert "Time budget of IK and planning, in seconds." in output


@pytest.mark.parametrize("command", [("demo",), ("reach", "--hand", "left", "--at", "0.38", "0.22", "0.82")])
def test_a_file_in_the_way_is_found_before_the_work(tmp_path, command):
    (tmp_path / "taken").write_text("mine")
    done = run(*command, "-o", "taken/out", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"pepper-kin: taken/out: cannot be made a folder: {tmp_path / 'taken'} is a file\n"
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_found_before_the_work(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FileFormatError, match="no permission in"):
        check_folder(tmp_path / "out")


def test_folders_that_are_there_or_can_be_made_are_fine(tmp_path):
    check_folder(tmp_path)
    check_folder(tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())


@pytest.mark.thorough
def test_a_page_goes_to_a_new_folder(tmp_path):
    pepper = pk.load_pepper()
    path = [pepper.posture("Stand"), pepper.joint_vector({"HeadYaw": 0.5})]
    pk.files.save(pk.retime(pepper, path), tmp_path / "way.csv")
    done = run("render", "way.csv", "-o", "new/folder/way.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "new" / "folder" / "way.html").stat().st_size > 100_000
