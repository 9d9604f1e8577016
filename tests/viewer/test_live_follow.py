"""Dragging and planning in a real browser: the body follows by the servo, and goes around by the planner."""

import contextlib
import re
import time

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.viewer.server import ViewerServer

pytestmark = pytest.mark.browser

LEFT = "LArm_effector"


@pytest.fixture(scope="module")
def server(pepper):
    """A server whose servo and planner are loaded."""
    server = ViewerServer(pepper, port=0)
    server.warm_up()
    deadline = time.monotonic() + 400
    while not server.call(lambda session: session.document["ready"]["planner"]):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    yield server
    server.close()


@pytest.fixture
def fresh(server, pepper):
    """The server with nothing but the robot in Stand, arms a little forward."""
    q = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})

    def reset(session):
        session.clear()
        session.set_scene(pk.Scene())
        session.set_follow(True)
        session.set_joints(q)

    server.call(reset)
    return server


def hand(server, pepper):
    return pk.kinematics.frame_pose(pepper, server.call(lambda session: session.q), LEFT)[:3, 3]


def at_rest(server):
    """Wait until the body has come to its end and return its joint positions."""
    before, deadline = np.inf, time.monotonic() + 60
    while True:
        q = server.call(lambda session: session.q)
        if np.max(np.abs(q - before)) < 1e-6:
            return q
        assert time.monotonic() < deadline
        before = q
        time.sleep(0.1)


def near(server, pepper, place, distance):
    """Wait until the left hand is near a place."""
    begin = time.monotonic()  # a busy machine is slow, and in the end right
    while (left := np.linalg.norm(hand(server, pepper) - place)) > distance and time.monotonic() < begin + 60:
        time.sleep(0.01)
    assert left <= distance  # of the same look: a hand on its way may be a little farther a moment later


def agreed(page, server):
    """Wait until the server has got the place to which the page has dragged the left hand's target."""
    deadline = time.monotonic() + 60
    while True:
        place = page.evaluate("pepperKin.parts.scene.held.get('@left hand')")
        known = server.call(lambda session: session.targets["left hand"].position.tolist())
        if np.allclose(place, known, atol=1e-4):
            return place
        assert time.monotonic() < deadline
        page.wait_for_timeout(20)


@pytest.mark.thorough
def test_a_dragged_target_takes_the_hand_along(open_live, until, on_screen, fresh, pepper):
    page = open_live(fresh.url)
    page.screenshot()  # the camera stands where it will
    start = hand(fresh, pepper)
    x, y = on_screen(page, start)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 12, y - 8, steps=3)
    page.mouse.move(x + 24, y - 16, steps=3)
    until(page, "pepperKin.values.targets['left hand'].on")
    target = agreed(page, fresh)
    assert 0.02 < np.linalg.norm(np.array(target) - start) < 0.5
    near(fresh, pepper, target, 0.005)
    page.mouse.up()
    # The ball stays in the plane through its old place that is parallel to the screen.
    forward = page.evaluate("""() => {
        const d = pepperKin.viewer.camera.getWorldDirection(new MeshCat.THREE.Vector3());
        return [d.x, -d.z, d.y];
    }""")
    assert abs(np.dot(forward, np.array(target) - start)) < 1e-3
    until(page, "document.getElementById('message').textContent === 'The left hand is at its target.'")
    q = at_rest(fresh)
    wrist = pk.kinematics.frame_pose(pepper, q, "l_wrist")[:3, 3]
    place = "pepperKin.parts.scene.place('l_wrist')"
    until(page, f"{place}.every((x, k) => Math.abs(x - {wrist.tolist()}[k]) < 1e-4)")


@pytest.mark.thorough
def test_within_half_a_second_the_hand_is_within_a_centimeter(fresh, pepper):
    """Counted in the servo's own time, so that a busy machine does not fail it."""
    start = hand(fresh, pepper)

    def follow(session):
        clock = session._now
        for k in range(12):  # eight centimeters in two tenths of a second, as a hand drags
            session.move_target("left hand", start + np.array([0.03, 0.04, 0.06]) * (k + 1) / 12)
            session.tick(0.02)
        for _ in range(26):
            session.tick(0.01)
        return session._now - clock, session.targets["left hand"].position

    passed, target = fresh.call(follow)
    assert passed <= 0.5 + 1e-9
    assert np.linalg.norm(hand(fresh, pepper) - target) < 0.01


@pytest.mark.thorough
def test_typed_targets_move_the_body_and_sliders_let_them_go(open_live, until, fresh, pepper):
    page = open_live(fresh.url, scale=0.5)
    start = hand(fresh, pepper)
    page.locator("#left-hand-z").fill(f"{start[2] + 0.05:.3f}")
    page.locator("#left-hand-z").press("Enter")
    until(page, "pepperKin.values.mode === 'follow'")
    until(page, f"Math.abs(pepperKin.parts.scene.place('@left hand')[2] - {start[2] + 0.05}) < 2e-3")
    near(fresh, pepper, start + np.array([0, 0, 0.05]), 2e-3)
    page.locator("#HeadYaw").fill("0.3")
    until(page, "pepperKin.values.mode === 'free' && !pepperKin.values.targets['left hand'].on")


@pytest.mark.thorough
def test_a_target_out_of_reach_is_explained(open_live, until, fresh):
    page = open_live(fresh.url, scale=0.5)
    page.locator("#left-hand-x").fill("2.5")
    page.locator("#left-hand-x").press("Enter")
    until(
        page,
        "/^The left hand cannot get closer: the target is 1[.]\\d m out of reach/"
        ".test(document.getElementById('message').textContent)",
        60,
    )
    assert page.get_attribute("#message", "class") == "bad"


@pytest.mark.thorough
def test_a_box_is_planned_around_and_the_motion_played(open_live, until, fresh, pepper):
    page = open_live(fresh.url, scale=0.5)
    page.click("button[name=add-box]")
    until(page, "document.querySelector(\"[data-name='box 1']\") !== null")
    fresh.call(
        lambda session: session.change_obstacle(
            "box 1", np.array([0.47, 0.05, 0.715]), np.array([0.40, 0.80, 0.03])
        )
    )
    page.click("#follow")
    until(page, "!pepperKin.values.follow")
    q = pepper.posture("Stand")
    fresh.call(lambda session: session.set_joints(q))
    for axis, value in zip("xyz", ("0.38", "0.22", "0.82"), strict=True):
        place = f"pepperKin.values.targets['left hand'].position['xyz'.indexOf('{axis}')]"
        for _ in range(5):  # a late message of the server may put another value into the field before Enter
            page.locator(f"#left-hand-{axis}").fill(value)
            page.locator(f"#left-hand-{axis}").press("Enter")
            with contextlib.suppress(pytest.fail.Exception):
                until(page, f"Math.abs({place} - {value}) < 1e-3", 10)
                break
        until(page, f"Math.abs({place} - {value}) < 1e-3")
    np.testing.assert_allclose(fresh.call(lambda session: session.q), q, atol=1e-12)
    page.click("#plan")
    until(page, "pepperKin.values.motion !== null", 60)
    assert re.match(
        r"A motion of \d\.\d\d s is ready, .*; clearance: \d+\.\d mm from obstacles, \d\.\d mm from itself",
        page.inner_text("#message"),
    )
    ghost = "pepperKin.viewer.scene_tree.find(['ghost']).object.children.length"
    assert page.evaluate(ghost) > 0
    page.select_option("#speed", "4")
    page.click("#play")
    until(
        page,
        "!pepperKin.values.play.playing && pepperKin.values.motion.end - pepperKin.values.play.time < 1e-3",
    )
    scene = fresh.call(lambda session: session.scene)
    motion = fresh.call(lambda session: session._playback.motion)
    assert pk.collision.clearance(pepper, motion.positions[::4], scene).min() > 0
    np.testing.assert_allclose(hand(fresh, pepper), (0.38, 0.22, 0.82), atol=0.005)
    # The straight way between the two ends goes through the table: the plan had to go around.
    straight = np.linspace(motion.positions[0], motion.positions[-1], 50)
    assert pk.collision.in_collision(pepper, straight, scene).any()


@pytest.mark.thorough
def test_without_a_target_there_is_nothing_to_plan(open_live, until, fresh):
    page = open_live(fresh.url, scale=0.5)
    page.click("#plan")
    until(page, "document.getElementById('message').textContent.startsWith('Nothing to plan to')")


def test_an_answer_stands_while_the_body_still_settles(fresh, pepper):
    """Planning to where the hand is already says so; the servo's reports do not take it away."""
    place = hand(fresh, pepper) + np.array([0.0, 0.02, 0.03])
    fresh.call(lambda session: session.move_target("left hand", place))
    near(fresh, pepper, place, 1e-4)
    deadline = time.monotonic() + 60
    while not fresh.call(lambda session: session.document["message"]["text"]).count("is at its target"):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    fresh.call(lambda session: session.plan())
    while fresh.call(lambda session: session.document["busy"]) is not None:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    begin = fresh.call(lambda session: session._now)
    fresh.call(lambda session: session.touch())
    while not fresh.call(lambda session: session.resting or session._now > begin + 1.0):
        time.sleep(0.02)
    said = fresh.call(lambda session: session.document["message"])
    assert said["text"] == "The body is at its targets already: nothing to plan."
    fresh.call(lambda session: session.move_target("left hand", place + np.array([0.0, 0.0, 0.02])))
    while fresh.call(lambda session: session.document["message"]) == said:
        assert time.monotonic() < deadline
        time.sleep(0.02)
