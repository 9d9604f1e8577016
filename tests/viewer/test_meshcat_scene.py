"""Drawing into meshcat's own `Visualizer`: its server tells what it holds; poses by Pinocchio alone."""

import base64
import re

import numpy as np
import pinocchio
import pytest
import umsgpack

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError

PEPPER = pk.load_pepper()
TABLE = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.7))


@pytest.fixture
def visualizer():
    meshcat = pytest.importorskip("meshcat")
    found = meshcat.Visualizer()
    yield found
    found.window.server_proc.kill()
    found.window.server_proc.wait()


def commands(visualizer):
    """Return what the server would tell a page that opens now."""
    page = visualizer.static_html()
    packed = re.findall(r'fetch\("data:application/octet-binary;base64,([^"]+)"', page)
    return [umsgpack.unpackb(base64.b64decode(text)) for text in packed]


def pose_of(q, link):
    """Return the pose of a link, shape (4, 4)."""
    model = PEPPER.pinocchio_model
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(link)].homogeneous


def transforms(visualizer):
    found = [one for one in commands(visualizer) if one["type"] == "set_transform"]
    return {one["path"]: np.reshape(one["matrix"], (4, 4)).T for one in found}


def test_robot_and_scene_are_where_pinocchio_has_them(visualizer):
    scene = pk.Viewer(PEPPER).add_scene(TABLE).in_meshcat(visualizer["mine/pepper"])
    q = PEPPER.joint_vector({"LShoulderPitch": 0.5, "HeadYaw": 0.4})
    scene.display(q)
    drawn = [one["path"] for one in commands(visualizer) if one["type"] == "set_object"]
    assert len(drawn) > 20
    assert all(path.startswith("/meshcat/mine/pepper/") for path in drawn)
    (table,) = [path for path in drawn if path.endswith("table")]
    places = transforms(visualizer)
    np.testing.assert_allclose(places[table][:3, 3], (0.47, 0.05, 0.7), atol=1e-12)
    for link in ("Head", "l_gripper", "LForeArm"):
        if f"/meshcat/mine/pepper/links/{link}" in places:
            found = places[f"/meshcat/mine/pepper/links/{link}"]
            np.testing.assert_allclose(found, pose_of(q, link), atol=1e-9)
    assert "/meshcat/mine/pepper/links/Head" in places


def test_a_motion_becomes_an_animation_of_every_link(visualizer):
    goal = PEPPER.joint_vector({"HeadYaw": 0.8})
    motion = pk.retime(PEPPER, [PEPPER.posture("Stand"), goal])
    scene = pk.Viewer(PEPPER).in_meshcat(visualizer)
    scene.play(motion, fps=20.0, repetitions=3)
    (sent,) = [one for one in commands(visualizer) if one["type"] == "set_animation"]
    assert sent["options"]["repetitions"] == 3
    clips = {one["path"]: one["clip"] for one in sent["animations"]}
    head = clips["/meshcat/links/Head"]
    tracks = {one["name"]: one["keys"] for one in head["tracks"]}
    assert tracks[".quaternion"][-1]["time"] / head["fps"] == pytest.approx(motion.duration, abs=1e-3)
    key = tracks[".quaternion"][len(tracks[".quaternion"]) // 2]
    at = motion(key["time"] / head["fps"]).position
    turn = pinocchio.Quaternion(pose_of(at, "Head")[:3, :3])
    assert abs(np.dot(key["value"], turn.coeffs())) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(
        transforms(visualizer)["/meshcat/links/Head"], pose_of(goal, "Head"), atol=1e-9
    )


def test_something_else_is_refused():
    with pytest.raises(InvalidValueError, match=r"visualizer: got 7, expected a meshcat\.Visualizer"):
        pk.Viewer(PEPPER).in_meshcat(7)
