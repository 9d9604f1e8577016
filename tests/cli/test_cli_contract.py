"""What holds for every command: an example, JSON, a line in the docs, exit codes, no stray colors."""

import importlib.metadata
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

import pepper_kin as pk
from pepper_kin.cli import app

ROOT = Path(__file__).parents[2]
PROGRAM = [
    sys.executable,
    "-c",
    "import sys; sys.argv[0] = 'pepper-kin'; from pepper_kin.cli import main; main()",
]


def run_process(*arguments, cwd):
    command = [*PROGRAM, *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=300, check=False)


def leaves(command, path=()):
    """Every command that does something, with its words."""
    if not hasattr(command, "commands"):
        return [(" ".join(path), command)]
    names = command.list_commands(None)
    return [leaf for name in names for leaf in leaves(command.commands[name], (*path, name))]


COMMANDS = leaves(typer.main.get_command(app))


def test_the_commands_of_the_design_are_there():
    names = {name for name, _ in COMMANDS}
    assert {"demo", "reach", "gesture", "export", "plot", "render", "check dynamics"} <= names
    assert {"naoqi serve", "naoqi mirror", "ros"} <= names  # which are registered


def test_every_command_has_an_example_json_and_a_place_in_the_docs():
    for name, command in COMMANDS:
        assert re.search(rf"Example: pepper-kin {name}\b", command.help)
        options = {word for parameter in command.params for word in parameter.opts}
        assert "--json" in options
        page = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
        assert re.search(rf"^#+ `pepper-kin {name}`$", page, re.MULTILINE), "no heading"
        assert re.search(rf"^pepper-kin {name}\b.*", page, re.MULTILINE), "no example"


@pytest.mark.thorough
def test_alone_it_tells_a_newcomer_what_to_do(tmp_path):
    done = run_process(cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    first = done.stdout.splitlines()[:3]
    for line, word in zip(first, ("pepper-kin demo", "pepper-kin reach", "docs/start.md"), strict=True):
        assert word in line
    for name, _ in COMMANDS:
        assert name.split()[0] in done.stdout


def test_version(run, tmp_path):
    done = run("--version", cwd=tmp_path)
    assert done.stdout.strip() == f"pepper-kin {importlib.metadata.version('pepper_kin')}"
    assert done.returncode == 0


@pytest.mark.parametrize(
    "arguments", [("no-such-command",), ("reach",), ("--no-such-option",), ("check", "x")]
)
def test_what_cannot_be_parsed_exits_with_2(run, tmp_path, arguments):
    assert run(*arguments, cwd=tmp_path).returncode == 2


@pytest.mark.parametrize(
    ("arguments", "code"), [(("export", "urdf"), 0), (("bad.urdf",), 1), (("none.urdf",), 2)]
)
def test_a_process_of_its_own_ends_as_the_command_does_here(run, tmp_path, arguments, code):
    """Other tests run commands in their own process."""
    heavy = pk.load_pepper().urdf.replace('mass value="1.51893"', 'mass value="-1.51893"')
    (tmp_path / "bad.urdf").write_text(heavy)
    arguments = arguments if code == 0 else ("check", "model", *arguments)
    apart, here = run_process(*arguments, cwd=tmp_path), run(*arguments, cwd=tmp_path)
    assert apart.returncode == here.returncode == code
    assert apart.stdout == here.stdout
    assert apart.stderr == here.stderr
    assert bool(apart.stderr) == (code == 2)


def test_completion_knows_names(run, tmp_path):
    def completed(words):
        done = run(
            cwd=tmp_path, _PEPPER_KIN_COMPLETE="complete_bash", COMP_WORDS=words,
            COMP_CWORD=str(len(words.split(" ")) - 1),
        )  # fmt: skip
        return done.stdout.split()

    assert completed("pepper-kin reach --start-from St") == ["Stand", "StandInit", "StandZero"]
    assert completed("pepper-kin gesture sha") == ["shake-head"]
    assert completed("pepper-kin export mj") == ["mjcf"]
    assert completed("pepper-kin ren") == ["render"]


def on_a_terminal(*arguments, cwd, **environment):
    """What a command writes where all its streams are one terminal."""
    ours, theirs = pty.openpty()
    inherited = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
    process = subprocess.Popen(
        [*PROGRAM, *arguments], cwd=cwd, stdin=theirs, stdout=theirs, stderr=theirs,
        env={**inherited, "TERM": "xterm-256color", **environment},
    )  # fmt: skip
    os.close(theirs)
    said = b""
    while select.select([ours], [], [], 120)[0]:
        try:
            part = os.read(ours, 65536)
        except OSError:  # how Linux tells that the other end is closed
            break
        if not part:
            break
        said += part
    os.close(ours)
    assert process.wait(timeout=60) == 0, said
    return said.decode()


COLORS = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")
COLOR = re.compile(r"\x1b\[[0-9;]*(?:3[0-9]|4[0-9]|38;5;\d+)m")


@pytest.mark.thorough
def test_colors_are_for_terminals_that_want_them(tmp_path):
    assert COLOR.search(on_a_terminal("--help", cwd=tmp_path))
    assert not COLOR.search(on_a_terminal("--help", cwd=tmp_path, NO_COLOR="1"))
    assert "\x1b" not in run_process("--help", cwd=tmp_path).stdout


@pytest.mark.thorough
@pytest.mark.browser
def test_a_bar_with_the_time_left_on_a_terminal_only(chromium_path, tmp_path):
    make_nod(tmp_path)
    arguments = ("render", "nod.csv", "-o", "nod.gif", "--fps", "2", "--size", "64x48")
    shown = on_a_terminal(*arguments, cwd=tmp_path)
    assert re.search(r"rendering .*100%.* left", COLORS.sub("", shown), re.DOTALL)
    done = run_process(*arguments, "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout) == {"written": ["nod.gif"]}


def make_nod(folder):
    pepper = pk.load_pepper()
    pk.files.save(pk.motion.gesture(pepper, "nod"), folder / "nod.csv")


def hear_ctrl_c():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.thorough
@pytest.mark.parametrize("stage", ["timing", "twin"])
def test_ctrl_c_exits_with_130_and_whole_files(tmp_path, stage):
    process = subprocess.Popen(
        [*PROGRAM, "demo", "-o", "out"], cwd=tmp_path, text=True, preexec_fn=hear_ctrl_c,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    for line in process.stderr:
        if line.strip() == f"{stage} ...":
            break
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=120)
    assert process.returncode == 130, error
    assert out == ""
    assert "Traceback" not in error
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


HALF_MADE = """\
class Half:
    def __init__(self):
        signal.raise_signal(signal.SIGINT)
        self.whole = True
    def __del__(self):
        self.whole
"""
DELETED = """\
class Half:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
"""


@pytest.mark.parametrize("of", [HALF_MADE, DELETED])
def test_ctrl_c_while_objects_are_made_and_deleted_is_neither_lost_nor_explained(of, tmp_path):
    text = f"""import signal, sys, time
from pepper_kin.cli import program
{of}
@program.app.command("half")
def half():
    Half()
    time.sleep(60)
sys.argv = ["pepper-kin", "half"]
program.main()
"""
    process = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, cwd=tmp_path, timeout=50,
        preexec_fn=hear_ctrl_c, check=False,
    )  # fmt: skip
    assert (process.returncode, process.stderr.strip()) == (130, "")


@pytest.mark.thorough
@pytest.mark.browser
def test_ctrl_c_while_filming_ends_the_browser_and_keeps_the_old_film(chromium_path, tmp_path):
    make_nod(tmp_path)
    (tmp_path / "nod.mp4").write_bytes(b"the film of before")
    for _ in range(3):  # a browser that does not come up on a starved machine ends the command by itself
        process = subprocess.Popen(
            [*PROGRAM, "render", "nod.csv", "-o", "nod.mp4", "--fps", "100"], cwd=tmp_path, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=hear_ctrl_c,
            env={**os.environ, "TMPDIR": str(tmp_path)},
        )  # fmt: skip
        assert "rendering" in process.stderr.readline()
        deadline = time.monotonic() + 120
        while not (there := browsers_of(tmp_path)) and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        if there:
            break
        process.kill()
    assert there, process.communicate()[1]  # asked once: a browser that starts replaces its process
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=120)
    assert process.returncode == 130, error
    assert "Traceback" not in error
    assert (tmp_path / "nod.mp4").read_bytes() == b"the film of before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["columns.json", "nod.csv", "nod.mp4"]
    while browsers_of(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not browsers_of(tmp_path)


def browsers_of(folder):
    """Processes whose profile lies in a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().decode(errors="replace")
        except OSError:
            continue
        if f"--user-data-dir={folder}" in words:
            found.append(words)
    return found
