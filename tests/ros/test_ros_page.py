"""What stands in docs/ros.md for other programs, run as written but for the port."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import test_rosbridge_clients as clients

from pepper_kin.ros.controllers import CONTROLLERS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def port(tmp_path_factory):
    """The port of `pepper-kin ros`, which ends by Ctrl-C and leaves its run."""
    folder = tmp_path_factory.mktemp("ros")
    # A shell that begins a program with & has it ignore Ctrl-C, and so do the programs that it begins.
    hear = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{hear}; from pepper_kin.cli import main; main()"
    arguments = ["ros", "--port", "0", "--cameras", "none", "--record", str(folder / "run.csv"), "--json"]
    server = subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    text = ""
    while "}" not in text:
        line = server.stdout.readline()
        assert line, "the server has ended"
        text += line
    yield re.search(r":(\d+)/", json.loads(text)["url"])[1]
    server.send_signal(signal.SIGINT)
    assert server.wait(60) == 0
    assert (folder / "run.csv").stat().st_size > 10_000


def block(language, port):
    [text] = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert "9090" in text
    return text.replace("9090", port)


@pytest.mark.thorough
def test_the_client_in_python(port, tmp_path):
    (tmp_path / "client.py").write_text(block("py", port), encoding="utf-8")
    command = [*clients.command("roslibpy")[:1], str(tmp_path / "client.py")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "goal reached" in done.stdout


@pytest.mark.thorough
def test_the_client_in_javascript(port):
    script = clients.folder_with_roslib() / f"page_{port}.mjs"
    script.write_text(block("js", port), encoding="utf-8")
    try:
        done = subprocess.run([clients.NODE, str(script)], capture_output=True, text=True, timeout=120)
    finally:
        script.unlink()
    assert done.returncode == 0, done.stderr
    assert "HeadYaw" in done.stdout


def test_all_controllers_stand_beside_the_client():
    section = PAGE.partition("## From my ROS 2 workspace")[2].partition("\n## ")[0]
    paragraph = section.partition("The controllers are ")[2].partition("\n\n")[0]
    assert re.findall(r"`(\w+)`", paragraph) == list(CONTROLLERS)


def test_topics_of_the_page_are_those_of_the_node(node):
    rows = re.findall(r"^\| (`/.*?) \|", PAGE, re.MULTILINE)
    named = set()
    for name in re.findall(r"`([^`]+)`", " ".join(rows)):
        start, _, rest = name.partition("{")
        choices, _, end = rest.partition("}")
        named |= {f"{start}{choice}{end}" for choice in choices.split(",")}
    expected = {
        re.sub(r"/[A-Za-z_]+_controller/", "/<controller>/", topic) for topic in node.transport.topics
    }
    assert named == expected
