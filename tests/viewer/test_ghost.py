"""Robot and twin over each other: both motions are in the page, each at its own place, with what is said."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from typer.testing import CliRunner

from pepper_kin.cli.program import app
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.identification import RobotLog, replay
from pepper_kin.viewer import Ghost, JointMotion, Note, Viewer
from pepper_kin.viewer.ghost import GHOST_COLOR

JOINTS = ("RShoulderPitch", "HeadYaw")
LOST = 40
"""A reading that did not arrive."""


def a_log():
    """80 s of a shoulder that follows steps until it is held at 20 s for 3 s, and of a head that is still."""
    times = np.arange(400) * 0.2
    command = np.tile([1.2, 0.3], (400, 1))
    command[times >= 10.0, 0] = 0.8
    command[times >= 20.0, 0] = 0.4
    measured = np.array(command)
    measured[(times >= 20.0) & (times < 23.0), 0] = 0.8
    measured[LOST, 0] = 0.0
    return RobotLog("held", JOINTS, times, command, times, measured)


@pytest.fixture(scope="module")
def found(pepper):
    return replay(pepper, a_log())


def poses_by_pinocchio(pepper, angles, names):
    """Return poses of links with the joints of the log at some angles, and all others as in Stand."""
    model = pinocchio.buildModelFromXML(pepper.urdf)
    q = np.zeros(model.nq)
    stand = dict(zip(pepper.joint_names, pepper.posture("Stand"), strict=True))
    for joint, angle in {**stand, **dict(zip(JOINTS, angles, strict=True))}.items():
        q[model.joints[model.getJointId(joint)].idx_q] = angle
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    return [data.oMf[model.getFrameId(name)].homogeneous for name in names]


def said_of(found):
    """Return what the page says while the shoulder is held: by how much it is away from the twin."""
    apart = np.abs(found.twin - found.log.measured)[100:115, 0].max()
    assert apart > 0.39
    return f"RShoulderPitch: up to {1000 * apart:.0f} mrad apart (blocked)"


def test_the_page_has_the_poses_of_the_twin_and_of_the_robot(pepper, found, tmp_path, content_of):
    content = content_of(Viewer(pepper).save_html(tmp_path / "a.html", found))
    motion = content["motion"]
    names = [link["name"] for link in motion["links"]]
    half = len(names) // 2
    assert names[half:] == [f"ghost {name}" for name in names[:half]]
    for k in (0, LOST, 99, 103, 110, 399):
        positions = motion["positions"].reshape(400, -1, 3)[k]
        quaternions = motion["quaternions"].reshape(400, -1, 4)[k]
        robot = found.log.measured[k] if k != LOST else found.log.measured[LOST - 1]
        twin = poses_by_pinocchio(pepper, found.twin[k], names[:half])
        for pose, position, quaternion in zip(
            [*twin, *poses_by_pinocchio(pepper, robot, names[:half])], positions, quaternions, strict=True
        ):
            np.testing.assert_allclose(position, pose[:3, 3], atol=1e-6)
            rotation = pinocchio.Quaternion(np.asarray(quaternion, dtype=float)).toRotationMatrix()
            np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-5)


def test_plots_have_the_lines_of_twin_robot_and_command(pepper, found, tmp_path, content_of):
    content = content_of(Viewer(pepper).save_html(tmp_path / "a.html", found))
    assert content["ghost"] == {"name": "robot", "beside": "twin", "color": "rgb(242, 115, 13)"}
    shoulder, head = content["motion"]["series"]
    assert [shoulder["name"], head["name"]] == ["RShoulderPitch [rad]", "HeadYaw [rad]"]
    np.testing.assert_allclose(shoulder["value"], found.twin[:, 0], atol=1e-6)
    np.testing.assert_allclose(shoulder["command"], found.log.command[:, 0], atol=1e-6)
    expected = np.array(found.log.measured[:, 0])
    expected[LOST] = 1.2
    np.testing.assert_allclose(shoulder["ghost"], expected, atol=1e-6)


def test_notes_are_the_stretches(pepper, found, tmp_path, content_of):
    notes = content_of(Viewer(pepper).save_html(tmp_path / "a.html", found))["notes"]
    assert [(note["start"], note["end"], note["curve"]) for note in notes] == [
        (stretch.begin, stretch.end, f"{stretch.joint} [rad]") for stretch in found.stretches
    ]
    (held,) = [note for note in notes if note["start"] < 22.0 < note["end"]]
    assert held["text"] == said_of(found)


def test_a_page_of_one_robot_has_no_ghost(pepper, tmp_path, content_of):
    content = content_of(Viewer(pepper).save_html(tmp_path / "a.html", pepper.posture("Stand")))
    assert (content["ghost"], content["notes"]) == (None, [])
    assert not [link for link in content["motion"]["links"] if link["name"].startswith("ghost")]


def test_what_does_not_fit_is_refused(pepper):
    times, q = np.array([0.0, 1.0]), np.tile(pepper.posture("Stand"), (2, 1))
    with pytest.raises(InvalidValueError, match="positions of 'robot'"):
        JointMotion(times, q, ghost=Ghost("robot", q[:1]))
    with pytest.raises(UnknownNameError, match="curve of a series of 'robot' 'b'; available: a"):
        JointMotion(times, q, {"a": times}, ghost=Ghost("robot", q, {"b": times}))
    with pytest.raises(UnknownNameError, match="curve of a command 'b'"):
        JointMotion(times, q, {"a": times}, commands={"b": times})


@pytest.mark.thorough
@pytest.mark.browser
def test_the_ghost_stands_where_the_robot_was_and_is_named(browser, until, pepper, found, tmp_path):
    page = browser.new_page(viewport={"width": 1100, "height": 700})
    page.goto(Viewer(pepper).save_html(tmp_path / "a.html", found).as_uri())
    until(page, "window.pepperKin !== undefined")
    assert page.inner_text("#legend").split() == ["twin", "robot", "command"]
    page.evaluate("pepperKin.seek(15)")
    assert page.inner_text("#notes") == ""
    page.evaluate("pepperKin.seek(22)")
    assert page.inner_text("#notes") == said_of(found)
    k = 110
    for link, angles in (("r_wrist", found.twin[k]), ("ghost r_wrist", found.log.measured[k])):
        seen = page.evaluate(
            """(link) => {
                const part = pepperKin.viewer.scene_tree.find(["links", link]).object;
                part.updateWorldMatrix(true, true);
                const { x, y, z } = new MeshCat.THREE.Vector3().setFromMatrixPosition(part.matrixWorld);
                const looks = [];
                part.traverse(({ material: m }) => m && looks.push([m.transparent, m.opacity]));
                return { place: [x, -z, y], looks };
            }""",
            link,
        )
        (expected,) = poses_by_pinocchio(pepper, angles, ["r_wrist"])
        np.testing.assert_allclose(seen["place"], expected[:3, 3], atol=1e-5)
        ghostly = [True, GHOST_COLOR[3]] if link.startswith("ghost") else [False, 1]
        assert seen["looks"]
        assert all(look == ghostly for look in seen["looks"])
    assert f"{found.twin[k, 0]:.3f}, robot 0.800" in page.inner_text("#plots")
    page.evaluate("pepperKin.seek(70)")
    page.locator("#plots canvas").first.click(position={"x": 52, "y": 30})
    # Of a motion of 79.8 s the part with the present time is plotted, the last 30 s: this is its left edge.
    assert page.evaluate("pepperKin.time") == pytest.approx(49.8, abs=0.1)
    page.close()


def test_check_log_writes_the_page_of_one_log(tmp_path, monkeypatch, content_of):
    monkeypatch.chdir(tmp_path)
    log = a_log()
    rows = np.column_stack(
        [log.time, *(x for pair in zip(log.command.T, log.measured.T, strict=True) for x in pair)]
    )
    header = "time," + ",".join(f"{joint}_{end}" for joint in JOINTS for end in ("command", "measured"))
    np.savetxt("held.csv", rows, delimiter=",", header=header, comments="")
    done = CliRunner().invoke(app, ["check", "log", "held.csv", "--share", "1", "--page", "new/page.html"])
    assert done.exit_code == 0, done.output
    content = content_of(tmp_path / "new" / "page.html")
    assert content["title"] == "held"
    assert content["ghost"]["name"] == "robot"
    assert "blocked" in " ".join(note["text"] for note in content["notes"])
    both = CliRunner().invoke(app, ["check", "log", "held.csv", "held.csv", "--page", "two.html"])
    assert isinstance(both.exception, InvalidValueError)
    assert "--page" in str(both.exception)
    assert not (tmp_path / "two.html").exists()


def test_notes_can_be_anything_that_a_motion_is_said_to_do(pepper, tmp_path, content_of):
    q = np.tile(pepper.posture("Stand"), (2, 1))
    motion = JointMotion(np.array([0.0, 1.0]), q, notes=(Note(0.0, 0.5, "It waits."),))
    (note,) = content_of(Viewer(pepper).save_html(tmp_path / "a.html", motion))["notes"]
    assert note == {"start": 0.0, "end": 0.5, "text": "It waits.", "curve": None}
