"""What cannot be done is refused in one line, before long work, and nothing is ignored silently."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import pepper_kin as pk


@pytest.fixture(scope="module")
def nod(tmp_path_factory):
    path = tmp_path_factory.mktemp("nod") / "nod.npz"
    pk.files.save(pk.motion.gesture(pk.load_pepper(), "nod"), path)
    return path


@pytest.mark.parametrize(
    "command", [("gesture", "nod"), ("gesture", "head"), ("check", "paper"), ("check", "physics")]
)
def test_a_folder_that_is_a_file_is_reported_before_the_work(run, tmp_path, command):
    (tmp_path / "taken").write_text("mine")
    done = run(*command, "-o", "taken", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""  # the report comes after the work
    assert len(done.stderr.splitlines()) == 1
    assert f"taken: cannot be made a folder: {tmp_path / 'taken'} is a file" in done.stderr
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize("check", ["paper", "physics", "dynamics"])
def test_a_negative_seed_is_misuse(run, tmp_path, check):
    done = run("check", check, "--seed", "-3", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("pepper-kin: seed: got -3, expected ")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(("option", "value"), [("--side", "right"), ("--amplitude", "1"), ("--tempo", "3")])
def test_options_that_a_movement_of_the_paper_lacks_are_refused(run, tmp_path, option, value):
    done = run("gesture", "left-arm", option, value, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"pepper-kin: {option}: got ")
    assert "'left-arm' is replayed as published" in done.stderr


@pytest.mark.parametrize(
    ("file", "option", "value", "suffixes"),
    [
        ("a.html", "--fps", "12", ".mp4, .gif"),
        ("a.html", "--fps", "nan", ".mp4, .gif"),
        ("a.html", "--size", "320x240", ".mp4, .gif, .png"),
        ("a.html", "--view", "front", ".mp4, .gif, .png"),
        ("a.html", "--at-time", "0.5", ".png"),
        ("a.gif", "--at-time", "0.5", ".png"),
        ("a.png", "--fps", "12", ".mp4, .gif"),
    ],
)
def test_render_refuses_what_a_kind_of_file_does_not_have(run, nod, tmp_path, file, option, value, suffixes):
    done = run("render", str(nod), "-o", file, option, value, cwd=tmp_path)
    assert done.returncode == 2
    last = done.stderr.splitlines()[-1]
    name = option.removeprefix("--").replace("-", "_")
    assert last.startswith(f"pepper-kin: {name}: got ")
    assert f"nothing for {file[1:]}" in last
    assert last.endswith(f"(it goes with {suffixes})")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")
@pytest.mark.parametrize("arguments", [("--version",), ("export", "urdf"), ("check", "limits", "--json")])
def test_an_output_that_cannot_be_written_is_reported_in_one_line(tmp_path, arguments):
    program = "import sys; sys.argv[0] = 'pepper-kin'; from pepper_kin.cli import main; main()"
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", program, *arguments],
            stdout=full, stderr=subprocess.PIPE, text=True, cwd=tmp_path, timeout=120, check=False,
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == "pepper-kin: the output cannot be written: No space left on device\n"


@pytest.mark.parametrize(
    ("command", "option"),
    [
        (("render", "nod.npz"), "-o"),
        (("plot", "nod.npz"), "-o"),
        (("naoqi", "run", "script.py", "--fast"), "--record"),
        (("ros", "--port", "0"), "--record"),
        (("naoqi", "mirror", "nod.npz"), "--record"),
    ],
)
def test_a_file_that_is_a_folder_is_reported_before_the_work(run, nod, tmp_path, command, option):
    """A recording would have been lost in the end."""
    (tmp_path / "nod.npz").symlink_to(nod)
    (tmp_path / "script.py").write_text("open('begun', 'w')")
    output = "out.csv" if option == "--record" else "out.png"
    (tmp_path / output).mkdir()
    done = run(*command, option, output, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"pepper-kin: {output}: cannot be written: it is a folder\n"
    assert not (tmp_path / "begun").exists()


def test_without_a_standard_output_a_command_ends_as_with_one(tmp_path):
    program = "import sys; from pepper_kin.cli import main; main()"
    command = f'exec "{sys.executable}" -c "{program}" check limits >&-'
    done = subprocess.run(
        ["sh", "-c", command], stderr=subprocess.PIPE, text=True, cwd=tmp_path, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes")
@pytest.mark.parametrize(("command", "suffix"), [("plot", ".svg"), ("render", ".html")])
def test_names_of_files_need_not_be_text(nod, tmp_path, command, suffix):
    name = b"caf\xe9 $\\bad$"
    (tmp_path / os.fsdecode(name + b".npz")).symlink_to(nod)
    program = "import sys; from pepper_kin.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, command, name + b".npz", "-o", name + suffix.encode()],
        capture_output=True, cwd=tmp_path, timeout=120, check=False,
        env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == b"Written: caf\\udce9 $\\bad$" + suffix.encode() + b"\n"
    assert (tmp_path / os.fsdecode(name + suffix.encode())).stat().st_size > 1000
