"""What the live page warns of: contact, too much torque, tipping."""

import io
import re

import numpy as np
import pinocchio
import pytest
from PIL import Image

import pepper_kin as pk
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.balance import support_polygon
from pepper_kin.viewer.joint_motion import joint_motion
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server.alerts import STAYS, Alerts
from pepper_kin.viewer.server.readings import balance_points, curves_of
from pepper_kin.viewer.server.session import LiveSession

REST = np.zeros(15)
HAND_ON_CHEST = {
    "LElbowRoll": -1.4, "LShoulderPitch": 0.9, "LShoulderRoll": 0.01, "LElbowYaw": -0.4,
}  # fmt: skip


class Nobody:
    """Does nothing of what takes long."""

    def warm_up(self, session):
        pass

    def explain(self, session, tasks):
        pass


@pytest.fixture
def session(pepper):
    return LiveSession(pepper, lambda command: None, Nobody())


def test_contact_names_the_bodies_that_touch(session, pepper):
    q = pepper.joint_vector(HAND_ON_CHEST)
    session.set_joints(q)
    session.tick(0.1)
    touching = {name for contact in pk.collision.contacts(pepper, q) for name in contact.names}
    assert touching == {"torso", "l_wrist", "LForeArm"}
    assert session.document["touching"] == {"bodies": sorted(touching), "objects": []}
    assert session.document["alerts"] == [
        {"kind": "contact", "text": "The left hand and the left forearm touch the torso."}
    ]
    session.posture("Stand")
    session.tick(0.1)
    assert session.document["alerts"] == []
    assert session.document["touching"] == {"bodies": [], "objects": []}
    hand = pk.kinematics.frame_pose(pepper, session.q, "l_hand")[:3, 3]
    session.set_scene(pk.Scene().add_sphere("ball/1", 0.05, hand).add_sphere("far", 0.05, (2, 0, 1)))
    session.tick(0.1)
    assert session.document["touching"]["objects"] == ["ball/1"]
    assert "l_wrist" in session.document["touching"]["bodies"]
    assert session.document["alerts"][0]["text"].startswith("The left hand touches ball/1")


def test_a_posture_that_cannot_be_held_is_reported_with_joint_and_share(session, pepper):
    q = pepper.joint_vector({"HipPitch": -1.0, "LShoulderPitch": 0.0, "RShoulderPitch": 0.0})
    torque = pk.dynamics.newton_euler(pepper, q, REST, REST)
    share = (np.abs(torque) / pepper.effort_limits)[pepper.joint_index("HipPitch")]
    assert share > 1
    session.set_joints(q)
    session.tick(0.1)
    (alert,) = session.document["alerts"]
    assert alert["kind"] == "torque"
    said = re.fullmatch(
        r"The hip \(HipPitch\) cannot hold this: it would need (\d+) % of its torque limit\.", alert["text"]
    )
    assert share <= float(said[1]) / 100 < share + 0.1


def test_movement_beyond_torque_and_balance_is_reported_and_stays_to_be_read(pepper):
    alerts, q = Alerts(pepper), pepper.posture("Stand")
    a = np.zeros(pepper.n)
    a[pepper.joint_index("HipPitch")] = 40.0
    use = np.abs(pk.dynamics.newton_euler(pepper, q, REST, a)) / pepper.effort_limits
    point = pk.dynamics.zero_moment_point(pepper, q, REST, a)
    assert use.max() > 1
    outside = point[0] - support_polygon(pepper)[:, 0].max()
    assert outside > 0.1
    alerts.strain(0.00, q, REST, a)
    assert alerts.as_list() == []  # one tick is no time
    alerts.strain(0.01, q, REST, a)
    balance, torque = alerts.as_list()
    joint = pepper.joint_names[int(use.argmax())]
    assert re.fullmatch(
        rf"Too fast for .*\({joint}\): it would need \d+ % of its torque limit\.", torque["text"]
    )
    away = f"{np.ceil(100 * outside):.0f} cm"
    assert balance["text"] == (
        f"So fast, the robot would tip over: its zero-moment point is {away} outside its wheels."
    )
    alerts.strain(0.02, q, REST, a / 1.2)
    alerts.strain(0.03, q, REST, REST)
    assert alerts.as_list() == [balance, torque]  # the worst, and for a while
    assert alerts.pending
    alerts.pass_time(0.02 + STAYS)
    assert alerts.as_list() == []
    assert not alerts.pending


def test_following_too_fast_is_warned_of_and_the_warning_ends_by_itself(session, pepper):
    session.servo_ready()
    session.set_joints(pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2}))
    kinds = set()
    for k in range(150):
        side = 1 if k // 30 % 2 else -1
        session.move_target("left hand", np.array([0.35, 0.25 + 0.3 * side, 0.85]))
        session.tick(0.01)
        kinds |= {alert["kind"] for alert in session.document["alerts"]}
    assert "balance" in kinds
    assert "torque" in kinds
    session.release()
    for _ in range(int(100 * (STAYS + 3))):
        session.tick(0.01)
        if session.resting:
            break
    assert session.resting
    assert session.document["alerts"] == []


@pytest.mark.thorough
@pytest.mark.browser
def test_contact_is_red_on_the_links_with_a_sentence(open_live, until, pepper):
    server = ViewerServer(pepper, port=0)
    red = """() => {
        const { scene } = pepperKin.parts;
        const reds = [];
        pepperKin.viewer.scene_tree.find(['robot', 'visual', 'links']).object.children.forEach((body) => {
            body.traverse(({ material }) => {
                if (material && material.color.r > 0.5 && material.color.g < 0.4) reds.push(body.name);
            });
        });
        return [...new Set(reds)].sort();
    }"""

    def reds(page):
        until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
        pixels = np.asarray(Image.open(io.BytesIO(page.locator("#view").screenshot())).convert("RGB")).astype(
            int
        )
        upper = pixels[: int(0.85 * len(pixels))]  # the warning itself is red, too
        return int(((upper[..., 0] > 110) & (upper[..., 1] < 0.4 * upper[..., 0])).sum())

    try:
        page = open_live(server.url)
        server.call(lambda session: session.posture("Stand"))
        page.wait_for_timeout(300)
        before = reds(page)
        assert page.evaluate(red) == []
        server.call(lambda session: session.set_joints(pepper.joint_vector(HAND_ON_CHEST)))
        until(page, "document.querySelectorAll('#alerts div.contact').length === 1")
        assert page.inner_text("#alerts") == "The left hand and the left forearm touch the torso."
        assert reds(page) > before + 2000
        assert page.evaluate(red) == ["LForeArm", "l_wrist", "torso"]
        server.call(lambda session: session.posture("Stand"))
        until(page, "document.querySelectorAll('#alerts div').length === 0")
        assert reds(page) < before + 200
        assert page.evaluate(red) == []
    finally:
        server.close()


def test_what_the_robot_carries_is_part_of_warnings_values_and_points(session):
    pepper = pk.load_pepper()
    cup = pk.Scene().add_box("cup", (0.1, 0.1, 0.1), (2.0, 2.0, 0.5))
    place = pinocchio.SE3(np.eye(3), np.array([0.1, 0.0, 0.05]))
    held = cup.attach("cup", "l_gripper", place.homogeneous, mass=20.0)
    model = pepper.inner_model.copy()
    frame = model.frames[pepper.frame_id("l_gripper")]
    inertia = pinocchio.Inertia.FromBox(20.0, 0.1, 0.1, 0.1)
    model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement * place)
    data, still = model.createData(), model.inertias[0]
    q = pepper.joint_vector({"LShoulderPitch": 0.0, "LShoulderRoll": 1.0, "LElbowRoll": -0.01})
    share = (np.abs(pinocchio.rnea(model, data, q, REST, REST)) / pepper.effort_limits).max()
    moving = pinocchio.centerOfMass(model, data, q)
    center = (data.mass[0] * moving + still.mass * still.lever) / (data.mass[0] + still.mass)
    session.set_joints(q)
    session.tick(0.1)
    assert session.document["alerts"] == []
    before = session.document["live"]["balance"]
    session.set_scene(held)
    session.touch()
    session.tick(0.2)
    kinds = {alert["kind"]: alert["text"] for alert in session.document["alerts"]}
    assert "cannot hold this" in kinds["torque"]
    assert "would tip over" in kinds["balance"]
    live = session.document["live"]
    assert max(live["torque"]) == pytest.approx(share, abs=1e-3)
    corners = support_polygon(pepper)
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    margin = np.einsum("ki,ki->k", center[:2] - corners, inward).min()
    assert live["balance"] == pytest.approx(margin, abs=2e-5)
    assert margin < 0 < before
    loads = pk.collision.loads_of(pepper, held)
    np.testing.assert_allclose(balance_points(pepper, q, REST, REST, loads)[0], center, atol=1e-9)
    np.testing.assert_allclose(balance_points(pepper, q, REST, REST, loads)[1][:2], center[:2], atol=1e-9)
    motion = Trajectory(pepper.joint_names, [0.0, 1.0], [[q, 1e-9 + REST]], pepper.joint_units)
    curves = curves_of(pepper, motion, joint_motion(pepper, motion), held)
    assert curves.torque.max() == pytest.approx(share, abs=1e-3)
    assert curves.balance.min() == pytest.approx(margin, abs=1e-4)
