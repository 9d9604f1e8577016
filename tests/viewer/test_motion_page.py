"""The page in a real browser: it draws, scrubs, plays, blends, and asks nobody for anything."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation, Slerp

from pepper_kin.viewer import marker, save_motion_page

pytestmark = pytest.mark.browser


@pytest.fixture
def motion_page(machine, tmp_path):
    return save_motion_page(
        machine.drawables,
        machine.links,
        machine.times,
        machine.poses,
        tmp_path / "motion.html",
        title="Machine <b>",
        series={"height [m]": np.linspace(1, 2, 5), "bar torque [N m]": np.linspace(-6.0, 9.0, 5)},
        limits={"bar torque [N m]": 10.0},
        markers=[marker("goal", [0.3, 0.3, 0.9])],
    )


@pytest.fixture
def opened(browser, motion_page):
    """Open the page from disk; on leaving, see that it complained of nothing and fetched nothing."""
    complaints, requests, pages = [], [], []

    def open_page(options="", width=640, height=480):
        page = browser.new_page(viewport={"width": width, "height": height})
        page.on("console", lambda message: complaints.append((message.type, message.text)))
        page.on("pageerror", lambda error: complaints.append(("error", str(error))))
        page.on("request", lambda request: requests.append(request.url))
        page.on("websocket", lambda socket: requests.append(socket.url))
        page.goto(motion_page.as_uri() + options)
        wait_until(page, "window.pepperKin !== undefined")
        pages.append(page)
        return page

    yield open_page
    for page in pages:
        page.close()
    assert complaints == []
    assert {request.split("#")[0] for request in requests} == {motion_page.as_uri()}


def wait_until(page, condition):
    """Wait for a condition; playwright's own waiting needs eval, which the page's policy forbids."""
    for _ in range(1500):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(20)
    pytest.fail(f"the page never reached: {condition}")


def drawn(page, time):
    page.evaluate("(time) => pepperKin.seek(time)", time)
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)


def red_columns(pixels):
    return np.nonzero(((pixels[..., 0] > 2 * pixels[..., 1]) & (pixels[..., 0] > 60)).any(axis=0))[0]


@pytest.mark.thorough
def test_the_picture_changes_where_the_cube_moves_and_returns_with_time(opened):
    page = opened("#panel=0&view=front")
    page.evaluate("pepperKin.viewer.scene_tree.find(['world']).object.visible = false")
    start, end, start_again = drawn(page, 0.0), drawn(page, 2.0), drawn(page, 0.0)
    np.testing.assert_array_equal(start, start_again)
    assert red_columns(start).max() < red_columns(end).min()
    assert (start[:20] == end[:20]).all()  # the sky above stays as it is


@pytest.mark.thorough
def test_poses_between_frames_follow_the_line_and_the_great_arc(opened, machine):
    page = opened()
    turns = Slerp(machine.times, Rotation.from_matrix(machine.poses[:, 2, :3, :3]))
    read = """(link) => {
        const object = pepperKin.viewer.scene_tree.find(['links', link]).object;
        return [object.position.toArray(), object.quaternion.toArray()];
    }"""
    for time in (0.0, 0.13, 0.5, 0.77, 1.99, 2.0):
        page.evaluate("(time) => pepperKin.seek(time)", time)
        position, _ = page.evaluate(read, "slide")
        np.testing.assert_allclose(position, [0.0, -0.4 + 0.4 * time, 0.8], atol=1e-6)
        _, quaternion = page.evaluate(read, "arm")
        assert (turns(time).inv() * Rotation.from_quat(quaternion)).magnitude() < 1e-6


@pytest.mark.thorough
def test_the_slider_seeks_and_follows(opened):
    page = opened()
    page.locator("#scrub").fill("1.25")
    assert page.evaluate("pepperKin.time") == 1.25
    assert page.inner_text("#clock").split() == ["1.25", "/", "2.00", "s"]
    page.evaluate("pepperKin.seek(0.5)")
    assert float(page.input_value("#scrub")) == 0.5
    page.evaluate("pepperKin.seek(99)")
    assert page.evaluate("pepperKin.time") == 2.0


@pytest.mark.thorough
def test_play_runs_to_the_end_and_starts_again(opened):
    page = opened()
    assert page.evaluate("pepperKin.duration") == 2.0
    page.click("#play")
    wait_until(page, "pepperKin.time > 0")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    wait_until(page, "pepperKin.time === 2 && !pepperKin.playing")
    assert page.get_attribute("#play", "aria-label") == "Play"
    page.evaluate("pepperKin.play()")
    wait_until(page, "pepperKin.time > 0 && pepperKin.time < 2")
    page.evaluate("pepperKin.pause()")
    held = page.evaluate("pepperKin.time")
    page.wait_for_timeout(200)
    assert page.evaluate("pepperKin.time") == held


@pytest.mark.thorough
def test_speed_scales_time_and_loop_never_ends(opened):
    page = opened()
    page.click("#loop")
    page.evaluate("""() => {
        window.before = 0;
        window.turns = 0;
        const watch = () => {
            if (pepperKin.time < window.before) window.turns += 1;
            window.before = pepperKin.time;
            requestAnimationFrame(watch);
        };
        watch();
    }""")
    page.evaluate("pepperKin.seek(1.8)")
    page.evaluate("pepperKin.play()")
    wait_until(page, "window.turns >= 1")
    assert page.evaluate("pepperKin.playing")
    page.click("#play")
    page.select_option("#speed", "0.1")
    page.evaluate("pepperKin.seek(0)")
    shown, passed = page.evaluate("""() => new Promise((done) => {
        const before = performance.now();
        pepperKin.play();
        setTimeout(() => done([pepperKin.time, (performance.now() - before) / 1000]), 900);
    })""")
    assert 0.0 < shown <= 0.1 * passed + 1e-6


@pytest.mark.thorough
def test_keys_play_and_step(opened):
    page = opened()
    time = "pepperKin.time"
    page.keyboard.press("End")
    assert page.evaluate(time) == 2.0
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(time) == pytest.approx(1.9)
    page.keyboard.press("Home")
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate(time) == pytest.approx(1.0)
    page.focus("#scrub")
    page.keyboard.press("ArrowRight")
    assert page.evaluate(time) == pytest.approx(1.1)
    page.select_option("#speed", "0.1")  # so that it does not end by itself on a busy machine
    page.focus("#scrub")
    page.keyboard.press(" ")
    wait_until(page, "pepperKin.time > 1.1")
    page.keyboard.press(" ")
    assert not page.evaluate("pepperKin.playing")


@pytest.mark.thorough
def test_the_address_chooses_time_view_and_panel(opened):
    page = opened("#t=1.5&panel=0")
    assert page.evaluate("pepperKin.time") == 1.5
    assert not page.is_visible("#panel")
    quarter = drawn(page, 1.5)
    side = drawn(opened("#t=1.5&panel=0&view=side"), 1.5)
    assert (quarter != side).any()


@pytest.mark.thorough
def test_plots_and_legend_name_what_they_show(opened):
    page = opened(width=1100)
    assert page.inner_text("h1") == "Machine <b>"
    assert page.inner_text("#legend").strip() == "goal"
    page.evaluate("pepperKin.seek(1)")
    assert page.inner_text("#plots").split() == [
        "height",
        "[m]",
        "1.50",
        "bar",
        "torque",
        "1.50",
        "N",
        "m,",
        "15",
        "%",
    ]
    page.keyboard.press("p")
    assert not page.is_visible("#plots")


@pytest.mark.thorough
def test_everything_stays_on_the_screen(opened):
    page = opened()
    for width, height in [(360, 640), (1280, 800), (844, 390)]:
        page.set_viewport_size({"width": width, "height": height})
        for name in ("#play", "#scrub", "#clock", "#speed", "#loop", "[data-view=top]"):
            box = page.locator(name).bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width
            assert box["y"] + box["height"] <= height
        assert page.evaluate("document.documentElement.scrollWidth") <= width


INK = """([index, ratio]) => {
    const canvas = document.querySelectorAll('#plots canvas')[index];
    const { data, width, height } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const rows = (test) => [...Array(height).keys()].filter((y) => {
        let count = 0;
        for (let x = 45; x < width - 4; x++) {
            const [r, g, b, a] = data.slice(4 * (y * width + x), 4 * (y * width + x) + 4);
            if (a > 120 && test(r, g, b)) count += 1;
        }
        return count > ratio * (width - 49);
    });
    return { red: rows((r, g, b) => r > 1.8 * g && r > 1.8 * b), height };
}"""


@pytest.mark.thorough
def test_a_curve_with_a_limit_has_lines_at_the_limits(opened):
    """Both limits of the torque lie on the axis, as far from its ends as the page says; heights have none."""
    page = opened(width=1100)
    page.wait_for_timeout(200)
    drawn = page.evaluate(INK, [1, 0.3])
    floor, ceiling = drawn["height"] - 15, 5  # below: the times; above: room
    middle, reach = (floor + ceiling) / 2, (floor - ceiling) / 2 / 1.06
    rows = np.array(drawn["red"])
    assert np.abs(rows - (middle - reach)).min() <= 1
    assert np.abs(rows - (middle + reach)).min() <= 1
    assert np.all(np.minimum(np.abs(rows - (middle - reach)), np.abs(rows - (middle + reach))) <= 1.5)
    assert page.evaluate(INK, [0, 0.3])["red"] == []


@pytest.mark.thorough
def test_pressing_on_a_curve_seeks_to_the_time_below_the_pointer(opened):
    page = opened(width=1100)
    box = page.locator("#plots canvas").first.bounding_box()
    page.mouse.click(box["x"] + 52 + 0.25 * (box["width"] - 52), box["y"] + 20)
    assert page.evaluate("pepperKin.time") == pytest.approx(0.5, abs=0.02)


@pytest.mark.thorough
def test_rounding_leaves_no_sign_before_zero(opened):
    page = opened()
    assert page.evaluate("[-0.004, -0, 0.3, -1.26, -0.6].map((x) => Axes.fixed(x, 0))") == [
        "0",
        "0",
        "0",
        "-1",
        "-1",
    ]
    assert page.evaluate("Axes.fixed(-0.0004, 3)") == "0.000"
