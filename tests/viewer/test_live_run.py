"""Going to targets while obstacles and targets are dragged: around, or waiting, and touching nothing."""

import threading
import time
from itertools import pairwise

import numpy as np
import pytest

import pepper_kin as pk
import pepper_kin.viewer.server.live_run
from pepper_kin.collision import checker_for
from pepper_kin.motion import LiveMotion
from pepper_kin.viewer.server.session import LiveSession
from pepper_kin.viewer.server.tasks import LongTasks

BELOW = {"LShoulderPitch": 1.0, "LShoulderRoll": 0.3, "LElbowRoll": -0.8, "RShoulderRoll": -0.3}
TICK = 0.01  # [s]


def hand(pepper, q):
    return pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]


@pytest.fixture(scope="module")
def ends(pepper):
    """Where the left hand starts, a place near the end of its way, and the end."""
    above = BELOW | {"LShoulderPitch": -0.5}
    late = BELOW | {"LShoulderPitch": -0.2}
    return [hand(pepper, pepper.joint_vector(q)) for q in (BELOW, late, above)]


@pytest.fixture
def session(pepper, ends):
    """A session with the left arm low, and its target above."""
    session = LiveSession(pepper, lambda command: None, LongTasks(pepper, None))
    session.set_follow(False)
    session.set_joints(pepper.joint_vector(BELOW))
    session.move_target("left hand", ends[2])
    return session


def follow(session, end, each=lambda now: None):
    """Go, and tick until a condition holds of the session; return what was shown, and what was said."""
    session.go()
    run, shown, said, deadline = session._run, [], [], time.monotonic() + 120
    while not end():
        assert time.monotonic() < deadline, said
        each(run._now)
        session.tick(TICK)
        shown.append((run._now, session.q.copy(), session._v.copy(), session.scene))
        text = session.document["message"]["text"]
        if said[-1:] != [text]:
            said.append(text)
        time.sleep(0.001)  # the cycles' thread needs the processor too
    for (at, q, v, _), (then, after, w, _) in pairwise(shown):
        bound = (then - at) * np.maximum(np.abs(v), np.abs(w)) + 5.0 * (then - at) ** 2 + 1e-9
        assert (np.abs(after - q) <= bound).all()
    return shown, said


def contacts(pepper, shown, moving):
    """In how many states coal finds the robot in contact; of those in motion only, or of all."""
    states = [(q, scene) for _, q, v, scene in shown[::2] if not moving or np.abs(v).max() > 1e-6]
    assert states
    return sum(bool(checker_for(pepper, scene).in_collision(q)) for q, scene in states)


def there(session):
    return lambda: session._run.resting


@pytest.mark.thorough
def test_a_box_dragged_into_the_way_is_gone_around(session, pepper, ends):
    place = ends[1] + np.array([0.08, 0.5, 0.0])
    session.set_scene(pk.Scene().add_box("box 1", (0.12, 0.12, 0.12), place))
    free, said = follow(session, there(session))
    assert said[-1] == "The left hand is at its target."
    np.testing.assert_allclose(hand(pepper, session.q), ends[2], atol=0.005)

    def drag(now):
        session.change_obstacle("box 1", place - np.array([0.0, min(0.6 * now, 0.5), 0.0]))

    session.set_joints(pepper.joint_vector(BELOW))
    session.move_target("left hand", ends[2])
    shown, said = follow(session, there(session), drag)
    assert said[-1] == "The left hand is at its target."
    np.testing.assert_allclose(hand(pepper, session.q), ends[2], atol=0.005)
    assert contacts(pepper, shown, moving=False) == 0
    scene = session.scene
    assert any(checker_for(pepper, scene).in_collision(q) for _, q, _, _ in free)  # it had to change


@pytest.mark.thorough
def test_a_robot_waits_for_what_a_scene_moves_and_goes_on(session, pepper, ends):
    """A wide plate slides over the arm: nothing leads around it while it is there."""
    begin, velocity = ends[1] + np.array([0.1, -0.9, 0.0]), np.array([0.0, 0.25, 0.0])
    session.set_scene(pk.Scene().add_box("plate", (0.9, 0.4, 0.04), begin, velocity=velocity))
    shown, said = follow(session, there(session))
    assert said[-1] == "The left hand is at its target."
    assert any(text.startswith("Waiting: the ") for text in said)
    assert contacts(pepper, shown, moving=True) == 0
    at, _, _, scene = shown[-1]
    moved = scene.objects["plate"].transform_object_to_world[:3, 3] - begin
    np.testing.assert_allclose(moved[[0, 2]], 0.0, atol=1e-12)
    assert moved[1] == pytest.approx(0.25 * at, abs=0.25 * 0.1)


def test_a_box_over_the_target_is_named_until_it_is_taken_away(session, pepper, ends):
    session.set_scene(pk.Scene().add_box("box 1", (0.2, 0.2, 0.2), ends[2]))
    shown, said = follow(session, lambda: session._run._now > 1.0)
    assert said[-1].startswith("The left hand cannot get closer: it would touch box 1.")
    assert not session.resting
    session.remove_obstacle("box 1")
    more, said = follow(session, there(session))
    assert said[-1] == "The left hand is at its target."
    assert contacts(pepper, shown + more, moving=False) == 0


def test_a_target_moved_on_the_way_is_the_new_goal_and_letting_go_a_stop(session, pepper, ends):
    follow(session, lambda: session._run._now > 0.5)
    other = ends[0] + np.array([0.05, 0.05, 0.15])
    session.move_target("left hand", other)
    follow(session, there(session))
    np.testing.assert_allclose(hand(pepper, session.q), other, atol=0.005)
    session.move_target("left hand", ends[2])
    follow(session, lambda: np.abs(session._v).max() > 0.1)
    session.release()
    _, said = follow_released(session)
    assert said[-1] == ""
    assert session.mode == "free"
    assert np.abs(session._v).max() == 0.0
    assert np.linalg.norm(hand(pepper, session.q) - ends[2]) > 0.05
    session.go()
    assert session.document["message"]["text"].startswith("Nowhere to go: set a target")


def follow_released(session):
    session.go, go = (lambda: None), session.go
    try:
        return follow(session, lambda: session.mode == "free")
    finally:
        session.go = go


def test_a_target_out_of_reach_is_explained(session):
    session.move_target("left hand", np.array([2.0, 0.2, 1.0]))
    _, said = follow(session, lambda: session._run.state is not None)
    assert said[-1].startswith("The left hand cannot get closer: the target is 1.")


def test_a_cycle_that_fails_ends_the_motion_with_a_sentence(server, pepper, ends):
    cup = pk.Scene().add_cylinder("cup", 0.03, 0.1, (0.0, 0.0, 0.0))
    begin(server, pepper, ends, cup.attach("cup", "LArm_effector", np.eye(4), mass=0.2))
    server.call(lambda session: session.go())
    wait_for(server, lambda session: session.document["message"]["kind"] == "bad")
    said, mode = server.call(lambda session: (session.document["message"]["text"], session.mode))
    assert said.startswith("scene: got cup with mass, expected attached objects without mass")
    assert mode == "free"


def begin(server, pepper, ends, scene):
    """Put the left arm low, its target above and a scene around."""

    def do(session):
        session.set_follow(False)
        session.set_joints(pepper.joint_vector(BELOW))
        session.set_scene(scene)
        session.move_target("left hand", ends[2])

    server.call(do)


def wait_for(server, condition):
    deadline = time.monotonic() + 60
    while not server.call(condition):
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.thorough
def test_pages_do_not_wait_for_a_cycle_that_takes_long(server, pepper, ends, monkeypatch):
    begun, go_on, step = threading.Event(), threading.Event(), LiveMotion.step

    def slow(live, now):
        begun.set()
        assert go_on.wait(60)
        return step(live, now)

    monkeypatch.setattr(LiveMotion, "step", slow)

    begin(server, pepper, ends, pk.Scene())
    server.call(lambda session: session.go())
    assert begun.wait(60)
    assert server.call(lambda session: session.add_obstacle("ball")) == "ball 1"
    assert not go_on.is_set()
    go_on.set()
    wait_for(server, lambda session: session._run.resting)
    np.testing.assert_allclose(hand(pepper, server.call(lambda session: session.q)), ends[2], atol=0.005)


@pytest.mark.thorough
@pytest.mark.browser
def test_a_box_is_dragged_into_the_way_in_the_picture(
    open_live, until, on_screen, server, pepper, ends, monkeypatch
):
    """The robot goes so slowly that the drag comes in time on a machine that is busy."""
    slower = pepper.with_limits(velocity=0.03 * pepper.velocity_limits)
    monkeypatch.setattr(pepper_kin.viewer.server.live_run, "_careful", lambda pepper: slower)
    way, place, shown = ends[1] + np.array([0.08, 0.0, 0.0]), ends[1] + np.array([0.08, 0.3, 0.0]), []

    begin(server, pepper, ends, pk.Scene().add_box("box 1", (0.1, 0.1, 0.1), place))

    def remember(session):
        poses = session.poses

        def remembered():
            shown.append((0.0, session.q, session._v, session.scene))
            return poses()

        session.poses = remembered

    server.call(remember)
    page = open_live(server.url)
    until(page, "pepperKin.values.obstacles?.length === 1")
    page.screenshot()  # the camera stands where it will
    page.click("[data-view=front]")
    page.click("#go")
    until(page, "pepperKin.values.mode === 'live' && document.getElementById('go').ariaPressed === 'true'")
    (x, y), (left, top) = on_screen(page, place), on_screen(page, way)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(left, top, steps=10)
    page.mouse.up()
    until(page, f"Math.abs(pepperKin.values.obstacles[0].position[1] - {way[1]}) < 0.05")
    assert np.linalg.norm(hand(pepper, server.call(lambda session: session.q)) - ends[2]) > 0.1  # on its way
    said = "document.getElementById('message').textContent"
    until(page, f"{said} === 'The left hand is at its target.'", 120)
    np.testing.assert_allclose(hand(pepper, shown[-1][1]), ends[2], atol=0.005)
    assert contacts(pepper, shown, moving=False) == 0
    straight = np.linspace(shown[0][1], shown[-1][1], 100)
    assert pk.collision.in_collision(pepper, straight, shown[-1][3]).any()
