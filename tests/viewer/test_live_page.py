"""The live page in a real browser: sliders, layers, obstacles, playing, reloading, two people."""

import io
import json
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image

import pepper_kin as pk
from pepper_kin.viewer import JointMotion, Viewer

pytestmark = pytest.mark.browser

INK = """(id) => {
    const canvas = document.getElementById(`plot-${id}`);
    const { data, width, height } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const red = [];
    let ink = 0;
    for (let y = 0; y < height; y++) {
        let count = 0;
        for (let x = 44; x < width; x++) {
            const [r, g, b, a] = data.slice(4 * (y * width + x), 4 * (y * width + x) + 4);
            if (a > 100 && r > 1.8 * g && r > 1.8 * b) count += 1;
            if (a > 100 && y > 5 && y < height - 15) ink += 1;
        }
        if (count > 0.3 * (width - 44)) red.push(y);
    }
    return [red, ink, height];
}"""
WRIST = "pepperKin.parts.scene.place('l_wrist')"


@pytest.fixture(scope="module")
def waving(pepper):
    """Two seconds: the left arm goes up, the head turns."""
    start = pepper.posture("Stand")
    goal = pepper.joint_vector({"LShoulderPitch": -1.2, "LElbowRoll": -1.0, "HeadYaw": 0.8})
    times = np.linspace(0.0, 2.0, 201)
    share = (0.5 - 0.5 * np.cos(np.pi * times / 2.0))[:, None]
    return JointMotion(times, start + share * (goal - start))


def picture(page):
    """The drawn robot without the lines of text over it, as finely as it gets."""
    page.evaluate("document.getElementById('bottom').style.visibility = 'hidden'")
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    for _ in range(600):
        if page.evaluate("pepperKin.quality.settled && !pepperKin.viewer.needs_render"):
            break
        page.wait_for_timeout(50)
    image = Image.open(io.BytesIO(page.locator("#view").screenshot()))
    page.evaluate("document.getElementById('bottom').style.visibility = ''")
    return np.asarray(image.convert("RGB")).astype(int)


def at(q):
    """A condition on the page: it shows joint positions q."""
    return f"pepperKin.values.q.every((x, k) => Math.abs(x - {np.round(q, 5).tolist()}[k]) < 1e-4)"


@pytest.mark.thorough
def test_a_slider_moves_the_arm_in_picture_and_numbers(open_live, until, server, pepper):
    page = open_live(server.url)
    before, wrist = picture(page), page.evaluate(WRIST)
    page.locator("#LShoulderPitch").fill("-0.5")
    q = pepper.default_posture()
    q[pepper.joint_index("LShoulderPitch")] = -0.5
    until(page, at(q))
    np.testing.assert_allclose(server.call(lambda session: session.q), q, atol=1e-12)
    until(page, f"Math.abs({WRIST}[2] - {wrist[2]}) > 0.3")
    expected = pk.kinematics.frame_pose(pepper, q, "l_wrist")[:3, 3]
    np.testing.assert_allclose(page.evaluate(WRIST), expected, atol=1e-5)
    changed = np.abs(picture(page) - before).max(axis=2) > 40
    assert 500 < changed.sum() < 0.2 * changed.size
    assert page.inner_text("label[for=LShoulderPitch] + output") == "-0.500 rad (-29°)"
    page.locator("#HeadYaw").fill("-0.004")
    until(page, "document.querySelector('label[for=HeadYaw] + output').textContent === '-0.004 rad (0°)'")


@pytest.mark.thorough
def test_every_joint_has_a_slider_with_its_limits(open_live, server, pepper):
    page = open_live(server.url, scale=0.5)
    sliders = page.evaluate(
        "[...document.querySelectorAll('#joints input[type=range]')]"
        ".map((s) => [s.id, s.name, Number(s.min), Number(s.max), Number(s.value)])"
    )
    limits = zip(
        pepper.joint_names, pepper.lower_limits, pepper.upper_limits, pepper.default_posture(), strict=True
    )
    for slider, (name, lower, upper, value) in zip(sliders, limits, strict=True):
        assert slider[:2] == [name, name]
        np.testing.assert_allclose(slider[2:], [lower, upper, value], atol=1e-4)
    page.select_option("#group", "head")
    assert page.locator("#joints .joint:visible").count() == 2


@pytest.mark.thorough
def test_keys_move_a_slider_and_postures_are_taken(open_live, until, server, pepper):
    page = open_live(server.url, scale=0.5)
    page.focus("#HeadYaw")
    page.keyboard.press("ArrowRight")
    until(page, f"pepperKin.values.q[{pepper.joint_index('HeadYaw')}] > 0.01")
    page.click("button[name=posture-Crouch]")
    until(page, at(pepper.posture("Crouch")))


@pytest.mark.thorough
def test_layers_are_switched_for_everybody(open_live, until, server):
    page, other = open_live(server.url), open_live(server.url)
    with_visual = picture(page)
    page.click("#show-visual")
    page.click("#show-capsules")
    page.click("#show-zero_moment_point")
    until(other, "!pepperKin.values.show.visual && pepperKin.values.show.capsules")
    assert not other.is_checked("#show-visual")
    picture(other)
    visible = "(layer) => pepperKin.viewer.scene_tree.find(['robot', layer]).object.visible"
    for name, on in {"visual": False, "capsules": True, "zero_moment_point": True, "spheres": False}.items():
        assert other.evaluate(visible, name) is on
    assert (np.abs(picture(page) - with_visual).max(axis=2) > 40).sum() > 2000


@pytest.mark.thorough
def test_the_points_of_balance_are_where_dynamics_puts_them(open_live, until, server, pepper):
    page = open_live(server.url, scale=0.5)
    page.click("#show-center_of_mass")
    page.locator("#HipPitch").fill("-0.4")
    q = pepper.default_posture()
    q[pepper.joint_index("HipPitch")] = -0.4
    until(page, at(q))
    mass = pk.dynamics.center_of_mass(pepper, q)
    where = "pepperKin.parts.scene.place('@center of mass')"
    until(page, f"{where}.every((x, k) => Math.abs(x - {mass.tolist()}[k]) < 1e-4)")
    point = page.evaluate("pepperKin.parts.scene.place('@zero-moment point')")
    np.testing.assert_allclose(point[:2], mass[:2], atol=1e-6)  # at rest it is below the center of mass


@pytest.mark.thorough
def test_obstacles_are_added_moved_sized_and_removed(open_live, until, server):
    page = open_live(server.url)
    bare = picture(page)
    page.click("button[name=add-box]")
    until(page, "pepperKin.values.obstacles.length === 1")
    assert (np.abs(picture(page) - bare).max(axis=2) > 40).sum() > 500
    row = page.locator("[data-name='box 1']")
    row.get_by_label("box 1 x [m]").fill("0.7")
    row.get_by_label("box 1 x [m]").press("Enter")
    row.get_by_label("size of box 1: z [m]").fill("0.4")
    row.get_by_label("size of box 1: z [m]").press("Tab")
    until(
        page,
        "pepperKin.values.obstacles[0].position[0] === 0.7 && pepperKin.values.obstacles[0].size[2] === 0.4",
    )
    (thing,) = server.call(lambda session: session.scene).objects.values()
    assert thing.geometry.size == (0.15, 0.15, 0.4)
    assert thing.transform_object_to_world[0, 3] == 0.7
    row.get_by_label("size of box 1: z [m]").fill("-1")
    row.get_by_label("size of box 1: z [m]").press("Enter")
    until(page, "document.getElementById('message').textContent.startsWith(\"size of 'box 1': got\")")
    page.click("[aria-label='Remove box 1']")
    until(page, "pepperKin.values.obstacles.length === 0")
    assert not row.count()
    until(page, "pepperKin.viewer.scene_tree.find(['obstacles']).object.children.length === 0")
    assert (np.abs(picture(page) - bare).max(axis=2) > 40).sum() < 50


@pytest.mark.thorough
def test_each_obstacle_has_a_color_of_its_own_that_a_visitor_may_change(open_live, until, server):
    page = open_live(server.url, scale=0.5)
    for _ in range(5):
        page.click("button[name=add-box]")
    until(page, "pepperKin.values.obstacles?.length === 5")
    colors = page.evaluate("pepperKin.values.obstacles.map(({ color }) => color.join())")
    assert len(set(colors)) == 5
    shown = page.evaluate(
        "[...document.querySelectorAll('#obstacles input[type=color]')].map((i) => i.value)"
    )
    assert len(set(shown)) == 5
    page.locator("[aria-label='Color of box 2']").fill("#12ab34")
    until(page, "pepperKin.values.obstacles[1].color[1] > 0.66")
    drawn = """(name) => {
        let found = null;
        pepperKin.viewer.scene_tree.find(['obstacles', name]).object.traverse(({ material }) => {
            if (material) found = material.color.getHexString();
        });
        return found;
    }"""
    for _ in range(100):
        if page.evaluate(drawn, "box 2") == "12ab34":
            break
        page.wait_for_timeout(20)
    assert page.evaluate(drawn, "box 2") == "12ab34"
    assert page.evaluate(drawn, "box 1") == shown[0][1:]
    assert server.call(lambda session: session.scene.objects["box 2"].color) == (
        18 / 255,
        171 / 255,
        52 / 255,
        1.0,
    )
    assert page.evaluate("document.documentElement.scrollWidth") <= 800


@pytest.mark.thorough
def test_an_obstacle_is_dragged_in_the_picture(open_live, until, server):
    server.call(lambda session: session.add_obstacle("ball", np.array([0.5, 0.3, 1.0])))
    page = open_live(server.url)
    until(page, "pepperKin.values.obstacles.length === 1")
    picture(page)
    x, y = page.evaluate("""() => {
        const place = new MeshCat.THREE.Vector3(0.5, 1.0, -0.3).project(pepperKin.viewer.camera);
        const view = document.getElementById('view');
        return [(place.x + 1) / 2 * view.clientWidth, (1 - place.y) / 2 * view.clientHeight];
    }""")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 40, steps=4)
    page.mouse.up()
    until(page, "pepperKin.values.obstacles[0].position[2] > 1.05")
    position = page.evaluate("pepperKin.values.obstacles[0].position")
    assert np.linalg.norm(np.array(position) - [0.5, 0.3, 1.0]) < 0.6


@pytest.mark.thorough
def test_a_motion_plays_scrubs_and_is_found_again_after_a_reload(open_live, until, server, pepper, waving):
    from pepper_kin.viewer.server.planning import show_motion

    shown = show_motion(pepper, waving, pk.Scene(), "Waving")
    server.call(lambda session: session.load(shown, play=False))
    page = open_live(server.url, scale=0.5)
    until(page, "pepperKin.values.motion !== null")
    page.select_option("#speed", "0.5")
    page.click("#play")
    until(page, "pepperKin.values.play.time > 0.1")
    clocks = "[pepperKin.values.play.time, performance.now() / 1000]"  # both in the page, however late we ask
    begin = np.array(page.evaluate(clocks))
    until(page, "pepperKin.values.play.time > 0.6")
    played, passed = np.array(page.evaluate(clocks)) - begin
    assert played < 0.5 * passed + 0.25  # at half the speed
    page.locator("#scrub").fill("1.25")
    until(page, at(waving.positions[125]))
    page.reload()
    until(page, "window.pepperKin !== undefined && pepperKin.values.play !== undefined")
    until(page, at(waving.positions[125]))
    assert float(page.input_value("#scrub")) == 1.25
    assert page.input_value("#speed") == "0.5"
    assert page.inner_text("#clock").split() == ["1.25", "/", "2.00", "s"]
    expected = pk.kinematics.frame_pose(pepper, waving.positions[125], "l_wrist")[:3, 3]
    until(page, "pepperKin.parts.scene.poses !== null")
    np.testing.assert_allclose(page.evaluate(WRIST), expected, atol=1e-5)
    page.click("#clear")
    until(page, "pepperKin.values.motion === null")
    assert not page.is_visible("#timeline")


@pytest.mark.thorough
def test_the_numbers_beside_the_plots_are_whole(open_live, until, server, pepper, waving):
    """Every number that is written to the left of a curve begins inside of the canvas."""
    from pepper_kin.viewer.server.planning import show_motion

    page = open_live(server.url, scale=0.5)
    page.evaluate("""() => {
        const write = CanvasRenderingContext2D.prototype.fillText;
        window.begins = [];
        CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
            if (this.textAlign === 'right' && this.textBaseline === 'middle') {
                window.begins.push([text, x - this.measureText(text).width]);
            }
            return write.call(this, text, x, y);
        };
    }""")
    shown = show_motion(pepper, waving, pk.Scene(), "Waving")
    server.call(lambda session: session.load(shown, play=False))
    until(page, "window.begins.some(([text]) => text === '100 mm')")
    begins = page.evaluate("window.begins")
    assert {"100 %", "0 mm"} <= {text for text, _ in begins}
    assert min(place for _, place in begins) >= 0.0, begins


@pytest.mark.thorough
def test_a_motion_runs_to_its_end_and_its_curves_are_plotted(open_live, until, server, pepper, waving):
    from pepper_kin.viewer.server.planning import show_motion

    shown = show_motion(pepper, waving, pk.Scene(), "Waving")
    server.call(lambda session: session.load(shown, play=True))
    page = open_live(server.url)
    until(page, "pepperKin.values.play.time === 2 && !pepperKin.values.play.playing")
    motion = page.evaluate("pepperKin.values.motion")
    index = np.argmin(np.abs(np.array(motion["times"]) - 1.0))
    q = waving.positions[np.argmin(np.abs(waving.times - motion["times"][index]))]
    assert motion["itself"][index] == pytest.approx(float(pk.collision.clearance(pepper, q)), abs=1e-5)
    page.wait_for_timeout(400)
    for kind, limit, high in (("torque", 1.0, 1.0), ("speed", 1.0, 1.0), ("itself", 0.0, 0.05)):
        values = np.array(motion[kind], dtype=float)
        assert values.min() >= 0
        top = 1.06 * max(high, values.max())
        red, ink, height = page.evaluate(INK, kind)
        floor, ceiling = height - 15, 5  # below: the times; above: room
        assert np.abs(np.array(red) - (floor - limit / top * (floor - ceiling))).min() <= 1, kind
        assert ink > 100, kind
    assert page.is_visible("#plot-balance")


@pytest.mark.thorough
def test_two_pages_see_and_move_the_same(open_live, until, server):
    one, two = open_live(server.url, scale=0.5), open_live(server.url, scale=0.5)
    one.locator("#HeadYaw").fill("0.6")
    until(two, "Math.abs(Number(document.getElementById('HeadYaw').value) - 0.6) < 1e-3")
    two.click("button[name=add-cylinder]")
    until(one, "document.querySelector(\"[data-name='cylinder 1']\") !== null")
    two.locator("#HeadPitch").fill("0.2")
    for page in (one, two):  # the server tells each page in its own time, the one that asked as well
        until(page, "Math.abs(pepperKin.values.q[4] - 0.2) < 1e-3")
    assert float(one.locator("#HeadPitch").input_value()) == pytest.approx(0.2, abs=1e-3)
    assert one.evaluate("pepperKin.values.q") == two.evaluate("pepperKin.values.q")


@pytest.mark.thorough
@pytest.mark.parametrize(("width", "height"), [(360, 720), (1280, 800), (844, 390)])
def test_everything_fits_the_width(open_live, server, pepper, waving, width, height):
    from pepper_kin.viewer.server.planning import show_motion

    shown = show_motion(pepper, waving, pk.Scene(), "Waving")
    server.call(lambda session: session.load(shown, play=False))
    server.call(lambda session: session.add_obstacle("box"))
    page = open_live(server.url, width, height)
    page.wait_for_timeout(100)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert (
        page.evaluate(
            "(() => { const p = document.getElementById('panel'); return p.scrollWidth - p.clientWidth; })()"
        )
        <= 0
    )
    for name in ("#play", "#scrub", "#clock", "#clear", "[data-view=top]", "#plan"):
        page.locator(name).scroll_into_view_if_needed()
        box = page.locator(name).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        assert 0 <= box["y"] <= height - box["height"]


@pytest.mark.thorough
def test_a_killed_server_comes_back_and_the_page_with_it(open_live, until):
    command = [sys.executable, "-c", "from pepper_kin.cli import main; main()", "view", "--no-open", "--port"]

    def start(port):
        process = subprocess.Popen([*command, port], stdout=subprocess.PIPE, text=True)
        return process, process.stdout.readline().strip()

    first, url = start("0")
    try:
        page = open_live(url)
        session = page.evaluate("pepperKin.parts.session")
        first.kill()
        first.wait()
        until(page, "!pepperKin.connected && !document.getElementById('offline').hidden")
        second, again = start(url.rstrip("/").rsplit(":", 1)[1])
        try:
            assert again == url
            until(page, f"pepperKin.connected && pepperKin.parts.session !== {json.dumps(session)}")
            assert not page.is_visible("#offline")
            page.locator("#HeadYaw").fill("0.4")
            until(page, "Math.abs(pepperKin.values.q[3] - 0.4) < 1e-3")
            assert picture(page).std() > 10
        finally:
            second.kill()
            second.wait()
    finally:
        first.kill()
        first.wait()


@pytest.mark.thorough
def test_the_viewer_shows_plays_and_hears_from_python(open_live, until, pepper, waving):
    scene = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    heard = []
    with Viewer(pepper, geometry_type="collision", port=0).add_scene(scene) as viewer:
        assert viewer.url is None
        url = viewer.show(waving.positions[-1])
        page = open_live(url, scale=0.5)
        until(page, at(waving.positions[-1]))
        assert page.evaluate("pepperKin.values.show.capsules && !pepperKin.values.show.visual")
        assert page.evaluate("pepperKin.values.obstacles[0].name") == "table"
        assert viewer.play(waving) == viewer.url == url
        until(page, "pepperKin.values.play !== null && pepperKin.values.play.time === 2")
        viewer.on_target(lambda name, position: heard.append((name, position))).follow(False)
        page.locator("#left-hand-x").fill("0.4")
        page.locator("#left-hand-x").press("Enter")
        until(page, "pepperKin.values.targets['left hand'].on")
        until(page, "true")
        for _ in range(100):
            if heard:
                break
            time.sleep(0.02)
        name, position = heard[-1]
        assert name == "left hand"
        assert position[0] == 0.4
        np.testing.assert_allclose(viewer.q, waving.positions[-1], atol=1e-12)
        assert f'<iframe src="{url}"' in viewer._repr_html_()
    assert viewer.url is None
