import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest

import pepper_kin as pk


@pytest.fixture(scope="module")
def demo(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    return folder, run("demo", "-o", "out", cwd=folder)


def test_demo_prints_a_table_and_writes_all_files(demo):
    folder, done = demo
    assert done.returncode == 0, done.stderr
    for word in (
        "hand error",
        "duration",
        "clearance from obstacles",
        "peak torque",
        "tracking error",
        "KneePitch",
    ):
        assert word in done.stdout
    names = sorted(path.name for path in (folder / "out").iterdir())
    assert names == [
        "columns.json", "motion.html", "run.csv", "scene.json", "summary.json", "trajectory.csv",
    ]  # fmt: skip


@pytest.mark.thorough
@pytest.mark.browser
def test_pepper_moves_in_the_page_of_the_demo(demo, browser):
    """The page is opened from disk: the picture changes between two times and the console stays silent."""
    folder, _ = demo
    page = browser.new_page(viewport={"width": 800, "height": 600})
    complaints = []
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda r: complaints.append(r.url) if r.url.startswith("http") else None)
    page.goto((folder / "out" / "motion.html").as_uri())
    page.wait_for_load_state("load")
    duration = page.evaluate("window.pepperKin.duration")
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert duration >= summary["duration_s"]
    pictures = []
    for time in (0.0, duration / 2, 0.0):
        page.evaluate(f"window.pepperKin.pause(); window.pepperKin.seek({time})")
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        pictures.append(page.screenshot())
    page.close()
    assert complaints == []
    assert pictures[0] != pictures[1]
    assert pictures[0] == pictures[2]


def test_unreachable_target_exits_with_one_line(run, tmp_path):
    done = run("reach", "--hand", "right", "--at", "1.5", "-0.2", "1.0", "-o", "out", cwd=tmp_path)
    assert done.returncode == 1
    said = [line for line in done.stderr.splitlines() if not line.endswith("...")]
    assert len(said) == 1
    assert "the closest point found is (" in said[0]
    assert said[0].endswith("cm away.")
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_json_is_all_that_is_printed(run, tmp_path):
    arguments = ("--hand", "right", "--at", "0.2", "-0.35", "0.9", "--json", "-o", "out")
    done = run("reach", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["hand_error_m"] < 1e-3
    assert summary["gaze_error_rad"] is None
    assert json.loads((tmp_path / "out" / "summary.json").read_text()) == summary


@pytest.mark.thorough
def test_boxes_are_avoided(run, tmp_path):
    box = "0.4,0.8,0.03,0.47,0.05,0.715"
    arguments = ("--hand", "left", "--at", "0.38", "0.22", "0.82", "--avoid-box", box, "--json", "-o", "out")
    done = run("reach", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["obstacles"]["box1"]["position_m"] == [0.47, 0.05, 0.715]
    assert summary["clearance_planned_m"]["obstacles"] > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("reach", "--hand", "middle", "--at", "0", "0", "1"),
            "unknown hand 'middle'; available: left, right",
        ),
        (("reach", "--hand", "left", "--at", "nan", "0", "1"), "at: got nan, expected finite numbers"),
        (
            ("reach", "--hand", "left", "--at", "0", "0", "1", "--avoid-box", "1,2,3"),
            "--avoid-box: got '1,2,3', expected six numbers",
        ),
        (
            ("reach", "--hand", "left", "--at", "0", "0", "1", "--avoid-box", "1,0,3,0,0,0"),
            "box size: got (1.0, 0.0, 3.0), expected three finite lengths above 0",
        ),
        (("gesture", "tail"), "unknown gesture 'tail'; available:"),
    ],
)
def test_misuse_exits_with_one_line(run, tmp_path, arguments, message):
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    said = [line for line in done.stderr.splitlines() if not line.endswith("...")]
    assert len(said) == 1
    assert message in said[0]
    assert list(tmp_path.iterdir()) == []


def test_gesture_tells_errors_and_inconsistencies(run, tmp_path):
    done = run("gesture", "right-arm", "-o", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("RShoulderPitch", "paper: Gazebo", "left labels", "60 of 60 numbers", "0 or 0.01 rad"):
        assert word in done.stdout
    assert (tmp_path / "out" / "run.csv").exists()
    summary = json.loads(run("gesture", "right-arm", "--json", cwd=tmp_path).stdout)
    assert summary["joints"]["RElbowRoll"]["mean_absolute_error"] < 0.01


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("format", "root"), [("urdf", "<robot"), ("srdf", "<robot"), ("sdf", "<sdf"), ("mjcf", "<mujoco")]
)
def test_export_prints_or_writes_the_same(run, tmp_path, format, root):
    printed = run("export", format, "--hands", "mimic", cwd=tmp_path)
    assert printed.returncode == 0, printed.stderr
    assert root in printed.stdout
    written = run("export", format, "--hands", "mimic", "-o", "new/pepper.xml", cwd=tmp_path)
    assert written.returncode == 0, written.stderr
    assert (tmp_path / "new" / "pepper.xml").read_text().strip() == printed.stdout.strip()


def test_the_exported_head_ends_where_the_option_says(run, tmp_path):
    for words, degrees in (((), 36.5), (("--head-limits", "documented"), 25.5)):
        done = run("export", "urdf", *words, cwd=tmp_path)
        joint = ElementTree.fromstring(done.stdout).find("joint[@name='HeadPitch']/limit")
        assert np.rad2deg(float(joint.get("upper"))) == pytest.approx(degrees, abs=1e-3)
    assert run("export", "urdf", "--head-limits", "seen", cwd=tmp_path).returncode == 2


def test_export_with_meshes_beside_it_loads_in_mujoco(run, tmp_path):
    import mujoco

    done = run("export", "mjcf", "--mesh-paths", "relative", "-o", "here/pepper.xml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "here" / "pepper.xml"))
    assert model.nu == 30  # position and velocity of each joint
    assert (tmp_path / "here" / "meshes").is_dir()


def test_unknown_format_is_one_line(run, tmp_path):
    done = run("export", "step", "-o", "pepper.step", cwd=tmp_path)
    assert done.returncode == 2
    assert "format: got 'step', expected one of 'urdf', 'srdf', 'sdf', 'mjcf'" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_check_model_passes_for_ours_and_finds_a_planted_fault(run, tmp_path):
    assert run("check", "model", cwd=tmp_path).returncode == 0
    urdf = pk.load_pepper().urdf.replace('mass value="1.51893"', 'mass value="-1.51893"')
    (tmp_path / "bad.urdf").write_text(urdf)
    done = run("check", "model", "bad.urdf", cwd=tmp_path)
    assert done.returncode == 1
    assert "Head" in done.stdout
    assert "-1.51893" in done.stdout
    summary = json.loads(run("check", "model", "bad.urdf", "--json", cwd=tmp_path).stdout)
    assert set(summary) == {"audit", "comparison"}


@pytest.mark.parametrize("text", ["", "<robot name='bare'/>"])
def test_check_model_compares_nothing_with_a_file_without_links(run, tmp_path, text):
    (tmp_path / "empty.urdf").write_text(text)
    done = run("check", "model", "empty.urdf", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1] == "  structure: the robot: it has no link"
    summary = json.loads(run("check", "model", "empty.urdf", "--json", cwd=tmp_path).stdout)
    assert set(summary) == {"audit"}


def test_check_limits_prints_table_4(run, tmp_path):
    done = run("check", "limits", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "HeadYaw" in done.stdout
    assert "Choregraphe" in done.stdout
    assert len(json.loads(run("check", "limits", "--json", cwd=tmp_path).stdout)["rows"]) == 17


NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


@pytest.mark.parametrize(
    ("words", "headings"),
    [
        (("check", "limits"), ["limits [rad]", "share of the opening", "rad;", "against ours  0.0134 rad"]),
        (
            ("check", "model"),
            [
                "mass [kg]",
                "least moment [kg m^2]",
                "reach [m]",
                "[rad/s or m/s]",
                "effort [N m or N]",
            ],
        ),
    ],
)
def test_tables_tell_the_units_of_their_numbers(run, words, headings, tmp_path):
    said = run(*words, cwd=tmp_path).stdout
    for heading in headings:
        assert heading in said


def test_the_tables_of_a_reach_tell_the_units_of_their_numbers(demo):
    """Each number has its unit beside it, or in brackets in the heading of its column."""
    said = demo[1].stdout
    figures, joints = said.split("Joints", 1)
    values = [
        line.strip("│ ").split("│")[-1].strip() for line in figures.splitlines() if line.startswith("│")
    ]
    assert len(values) >= 8
    for value in values:
        assert NUMBER.match(value), value
        assert value.split()[-1] in ("mm", "mrad", "rad", "deg", "m", "s"), value
    headings = " ".join(joints.split("KneePitch")[0].split())
    assert "[mrad]" in headings
    assert "[% of limit]" in headings
