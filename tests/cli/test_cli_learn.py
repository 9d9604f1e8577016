"""The command `learn`: a policy that is written, tried and shown, and what is refused."""

import json
import signal
import subprocess
import sys

import pytest

import pepper_kin as pk
from pepper_kin.learning import imitate, load_policy
from pepper_kin.learning.vector_env import PepperVectorEnv


@pytest.mark.thorough
def test_a_policy_is_trained_written_and_shown(run, tmp_path):
    done = run("learn", "Reach", "--rounds", "2", "-o", "out/reach.npz", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [line.partition(":")[0] for line in done.stderr.splitlines()] == [
        "  round 1 of 2",
        "  round 2 of 2",
    ]
    assert "Reach: of 1024 new goals 0." in done.stdout
    assert done.stdout.splitlines()[-1] == "Written: out/reach.npz"
    assert load_policy(tmp_path / "out/reach.npz").task == "Reach"
    done = run("learn", "out/reach.npz", "--show", "episode.csv", "--json", cwd=tmp_path)
    found = json.loads(done.stdout)
    assert found["written"] == ["episode.csv"]
    assert found["chance"] < 0.05 < 0.7 < found["policy"] <= 1.0
    assert found["oracle"] > 0.98
    motion = pk.files.load(tmp_path / "episode.csv", pepper=pk.load_pepper())
    assert motion.duration == pytest.approx(1.0)


@pytest.mark.thorough
def test_ctrl_c_writes_the_best_so_far_and_exits_with_130(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", "from pepper_kin.cli import main; main()", "learn", "Reach", "-o", "a.npz"],
        cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert process.stderr.readline().startswith("  round 1 of 12: 0.")
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=120)
    assert process.returncode == 130, error
    assert "the best policy so far is kept" in error
    assert "Traceback" not in error
    assert out.splitlines()[-1] == "Written: a.npz"
    assert load_policy(tmp_path / "a.npz").task == "Reach"


@pytest.mark.thorough
@pytest.mark.browser
def test_an_episode_is_drawn(run, chromium_path, tmp_path):
    imitate(PepperVectorEnv(16, "ReachBoth"), rounds=1).save(tmp_path / "both.npz")
    done = run("learn", "both.npz", "--show", "episode.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "episode.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("Raech",), "unknown task 'Raech' (did you mean 'Reach'?); available: Reach, "),
        (("none.npz",), "none.npz: cannot be read"),
        (("a.npz", "--ppo"), "expected a task's name with --output, --ppo and --rounds"),
        (("Reach", "--show", "a.txt"), "--show: got 'a.txt', expected a file that ends in .mp4, "),
        (("Reach", "--rounds", "0"), "rounds: got 0"),
        (("Reach", "--ppo", "--seed", "-1"), "seed: got -1"),
        (("Reach", "-o", "."), "cannot be written: it is a folder"),
    ],
)
def test_misuse_exits_with_one_line(run, tmp_path, arguments, message):
    done = run("learn", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert message in done.stderr
    assert list(tmp_path.iterdir()) == []
