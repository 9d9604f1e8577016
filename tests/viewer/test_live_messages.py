"""What the message line says while the body follows: whole sentences that stand, and none that is stale."""

import re

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.ik import HandPosition, LookAt
from pepper_kin.viewer.server.explaining import at_target, what_would_touch, why_no_closer
from pepper_kin.viewer.server.session import LiveSession
from pepper_kin.viewer.server.tasks import LongTasks
from pepper_kin.viewer.server.words import body_words, joint_words, length_words

TABLE = pk.Scene().add_box("table", size=(0.40, 0.90, 0.03), position=(0.47, 0.05, 0.715))
UNDER_THE_TABLE = np.array([0.47, 0.0, 0.6])
BEFORE = {"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2}


class Later:
    """A worker that does its jobs when it is told to."""

    def __init__(self):
        self.jobs = []

    def do(self, job, done):
        self.jobs.append((job, done))

    def finish(self):
        while self.jobs:
            job, done = self.jobs.pop(0)
            done(job(), None)


@pytest.fixture
def worker():
    return Later()


@pytest.fixture
def session(pepper, worker):
    session = LiveSession(pepper, lambda command: None, LongTasks(pepper, worker))
    session.set_scene(TABLE)
    session.servo_ready()
    return session


def pass_time(session, worker, seconds):
    """Let time pass in ticks; return what the message line said, each text once in a row."""
    said = []
    for _ in range(round(100 * seconds)):
        session.tick(0.01)
        worker.finish()
        text = session.document["message"]["text"]
        if not said or said[-1] != text:
            said.append(text)
    return said


def test_what_is_in_the_way_is_said_in_a_visitors_words(session, worker, pepper):
    session.move_target("left hand", UNDER_THE_TABLE)
    said = pass_time(session, worker, 9.0)
    assert said == [
        "",
        "The left hand follows its target.",
        "The left hand cannot get closer: the left forearm would touch the table. "
        "Move the target or what is in the way.",
    ]
    assert session.document["message"]["kind"] == "bad"
    # An independent look: the forearm is one of what is nearest to the table there.
    near = pk.collision.contacts(pepper, session.q, TABLE, within=0.007)
    assert {"LForeArm", "table"} in [set(contact.names) for contact in near]


def test_what_would_touch_is_what_does_touch_a_step_further(pepper):
    q = pepper.joint_vector(BEFORE)
    hand = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]
    wall = pk.Scene().add_box("wall", size=(0.02, 0.6, 0.6), position=(hand[0] + 0.12, hand[1], hand[2]))
    task = HandPosition("left", hand + np.array([0.08, 0.0, 0.0]))
    assert what_would_touch(pepper, q, [task], wall) == "the left hand would touch the wall"
    beyond = pk.ik.solve(pepper, task, q).q
    assert {"l_wrist", "wall"} in [set(c.names) for c in pk.collision.contacts(pepper, beyond, wall)]
    assert what_would_touch(pepper, q, [HandPosition("left", hand - np.array([0.03, 0.0, 0.0]))], wall) == ""


@pytest.mark.parametrize(
    ("task", "begin"),
    [
        (
            HandPosition("left", (2.5, 0.0, 0.8)),
            r"The left hand cannot get closer: the target is 1\.\d m ",
        ),
        (
            HandPosition("right", (0.3, -0.4, 1.5)),
            r"The right hand cannot get closer: the target is \d+ cm ",
        ),
        (LookAt((-0.01, 0.0, 2.2)), r"The gaze cannot turn there: "),
    ],
)
def test_what_is_out_of_reach_is_said_with_its_distance(pepper, task, begin):
    said = why_no_closer(pepper, pepper.posture("Stand"), [task], pk.Scene())
    assert re.match(begin, said), said
    assert said.endswith(".")
    assert "_" not in said


def test_arriving_and_dragging_do_not_make_the_message_flicker(session, worker, pepper):
    session.set_scene(pk.Scene())
    session.set_joints(pepper.joint_vector(BEFORE))
    start = session.targets["left hand"].position.copy()
    said = []
    for k in range(200):  # a slow hand, which the body keeps up with
        session.move_target("left hand", start + np.array([0.0, 0.0, 0.0004 * k]))
        session.tick(0.01)
        said.append(session.document["message"]["text"])
    said += pass_time(session, worker, 1.5)
    changes = [text for before, text in zip(["", *said], said, strict=False) if text != before]
    assert changes == ["The left hand follows its target.", "The left hand is at its target."]
    assert at_target([HandPosition("left", (0, 0, 1)), LookAt((1, 0, 1))]) == (
        "The left hand and the gaze are at their targets."
    )


def test_letting_go_takes_the_verdict_back_for_good(session, worker):
    session.move_target("left hand", UNDER_THE_TABLE)
    pass_time(session, worker, 9.0)
    assert "cannot get closer" in session.document["message"]["text"]
    session.release()
    assert session.document["message"]["text"] == ""
    assert pass_time(session, worker, 2.0) == [""]


def test_an_answer_that_comes_after_letting_go_is_not_said(session, worker, pepper):
    session.move_target("left hand", UNDER_THE_TABLE)
    for _ in range(900):
        session.tick(0.01)
        if worker.jobs:
            break
    assert worker.jobs
    session.release()
    worker.finish()
    assert session.document["message"]["text"] == ""
    session.set_follow(False)
    session.set_joints(pepper.posture("Stand"))
    session.move_target("left hand", np.array([0.3, 0.25, 0.9]))
    session.plan()
    session.set_joints(pepper.posture("Crouch"))
    worker.finish()
    assert session.document["motion"] is None
    assert session.document["busy"] is None
    assert session.document["message"]["text"] == ""


def test_names_of_bodies_and_joints_are_said_as_people_say_them(pepper):
    links = {shape.link for shape in pepper.collision_shapes}
    assert all("_" not in body_words(link) and body_words(link).startswith("the ") for link in links)
    assert body_words("LForeArm") == "the left forearm"
    assert body_words("box 2") == "box 2"
    assert body_words("table") == "the table"
    assert joint_words("LElbowRoll") == "the left elbow (LElbowRoll)"
    assert all(joint_words(name) == name or name in joint_words(name) for name in pepper.joint_names)
    assert joint_words("panda_joint1") == "panda_joint1"
    assert [length_words(x) for x in (0.004, 0.123, 1.91)] == ["4 mm", "12 cm", "1.9 m"]
