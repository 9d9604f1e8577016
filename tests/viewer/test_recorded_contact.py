"""Contact in recordings: red while it lasts, with a sentence; and never where nothing touches."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.viewer import JointMotion, Viewer
from pepper_kin.viewer.touching import touch_spans


@pytest.fixture(scope="module")
def through_a_ball(pepper):
    """One second in which the left arm swings through a ball and out again."""
    times = np.linspace(0.0, 1.0, 41)
    q = np.tile(pepper.posture("Stand"), (41, 1))
    q[:, pepper.joint_index("LShoulderPitch")] = 1.5 - 2.4 * times
    q[:, pepper.joint_index("LShoulderRoll")] = 0.3
    place = pk.kinematics.frame_pose(pepper, q[20], "l_hand")[:3, 3]
    return JointMotion(times, q), pk.Scene().add_sphere("ball", 0.05, place).add_sphere(
        "far", 0.05, (2, 0, 1)
    )


def test_spans_are_the_times_at_which_something_touches(pepper, through_a_ball):
    motion, scene = through_a_ball
    spans = touch_spans(pepper, motion.times, motion.positions, scene, ("torso", "l_hand", "l_wrist"))
    expected = [any(span.start <= time <= span.end for span in spans) for time in motion.times]
    np.testing.assert_array_equal(expected, pk.collision.in_collision(pepper, motion.positions, scene))
    assert 0 < sum(expected) < 41
    span = next(span for span in spans if span.start <= 0.5 <= span.end)
    assert (span.links, span.objects) == (("l_hand", "l_wrist"), ("ball",))
    assert span.text == "The left hand touches the ball."


@pytest.mark.thorough
@pytest.mark.browser
def test_obstacles_move_in_a_recording(browser, until, pepper, tmp_path):
    """Drawn where they are at its times, red while they touch, and not larger by their uncertainty."""
    q = np.tile(pepper.posture("Stand"), (41, 1))
    hand = pk.kinematics.frame_pose(pepper, q[0], "l_hand")[:3, 3]
    motion = JointMotion(np.linspace(0.0, 2.0, 41), q)
    rolls = {"velocity": (-1.0, 0.0, 0.0), "uncertainty": 0.3}
    scene = pk.Scene().add_sphere("tracked", 0.05, hand + np.array([1.0, 0.0, 0.0]), **rolls)
    spans = touch_spans(pepper, motion.times, motion.positions, scene, ("l_hand",))
    assert spans
    assert all(span.start > 0.6 and span.end < 1.4 and span.objects == ("tracked",) for span in spans)
    page = browser.new_page(viewport={"width": 900, "height": 600})
    page.goto(Viewer(pepper).add_scene(scene).save_html(tmp_path / "a.html", motion).as_uri())
    until(page, "window.pepperKin !== undefined")
    place = """() => {
        const found = [];
        pepperKin.viewer.scene.updateMatrixWorld(true);
        pepperKin.viewer.scene.traverse((node) => {
            if (node.isMesh && node.parent && /tracked/.test(`${node.name} ${node.parent.name}`)) {
                const e = node.matrixWorld.elements;
                found.push([e[12], e[13], e[14]]);
            }
        });
        return found;
    }"""
    for at in (0.0, 0.7, 1.5):
        page.evaluate(f"pepperKin.seek({at})")
        there = page.evaluate(place)[0]
        there = np.array([there[0], -there[2], there[1]])  # three.js has y up
        assert there == pytest.approx(hand + np.array([1.0 - at, 0.0, 0.0]), abs=0.02)


@pytest.mark.thorough
@pytest.mark.browser
def test_a_recording_is_red_while_it_touches(browser, until, pepper, through_a_ball, tmp_path):
    motion, scene = through_a_ball
    page = browser.new_page(viewport={"width": 900, "height": 600})
    page.goto(Viewer(pepper).add_scene(scene).save_html(tmp_path / "a.html", motion).as_uri())
    until(page, "window.pepperKin !== undefined")
    red = """() => {
        const names = [];
        for (const root of ['links', 'world']) {
            for (const node of pepperKin.viewer.scene_tree.find([root]).object.children) {
                node.traverse(({ material }) => {
                    if (material && material.color.r > 0.5 && material.color.g < 0.4) names.push(node.name);
                });
            }
        }
        return [...new Set(names.map((name) => name.replace(/^\\d+ /, '')))].sort();
    }"""
    before = page.evaluate(red)
    assert not page.is_visible("#contact")
    page.evaluate("pepperKin.seek(0.5)")
    assert page.inner_text("#contact") == "The left hand touches the ball."
    now = set(page.evaluate(red)) - set(before)
    assert {"l_wrist", "ball"} <= now
    assert not {"far", "torso", "Head"} & now
    page.evaluate("pepperKin.seek(0)")
    assert page.evaluate(red) == before
    assert not page.is_visible("#contact")
    page.close()
