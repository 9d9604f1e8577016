"""Pages without a mouse, a screen or WebGL: names, keys, and a sentence in place of the picture."""

import pytest

import pepper_kin as pk
from pepper_kin.viewer import Viewer
from pepper_kin.viewer.server import ViewerServer

pytestmark = pytest.mark.browser

CONTROLS = {"button", "checkbox", "ColorWell", "combobox", "DisclosureTriangle", "slider", "spinbutton"}
STOPS = """() => [...document.querySelectorAll('button, input, select, summary, [tabindex="0"]')].filter(
    (element) => !element.disabled && element.checkVisibility() && element.getClientRects().length
).map((element, k) => (element.dataset.stop = String(k)))"""
NO_WEBGL = """const original = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    return kind.includes("webgl") ? null : original.call(this, kind, ...rest);
};"""
READY = {
    "live": "window.pepperKin !== undefined && pepperKin.connected && pepperKin.parts.scene.poses !== null",
    "recorded": "document.querySelector('#view canvas') !== null",
}


@pytest.fixture
def url_of(pepper, tmp_path):
    """The address of a page: the live one with an obstacle, or a recording with its plots."""
    server = ViewerServer(pepper, port=0)
    server.call(lambda session: session.add_obstacle("box"))
    stand = pepper.posture("Stand")
    motion = pk.retime(pepper, [stand, pepper.joint_vector({"HeadYaw": 0.5})])
    recorded = Viewer(pepper).save_html(tmp_path / "motion.html", motion).as_uri() + "#plots=1"
    yield {"live": server.url, "recorded": recorded}
    server.close()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["live", "recorded"])
def test_every_control_has_a_name_and_the_keyboard_reaches_it(browser, until, url_of, kind):
    page = browser.new_page(viewport={"width": 1000, "height": 700})
    page.goto(url_of[kind])
    until(page, READY[kind])
    page.wait_for_timeout(300)
    tree = page.context.new_cdp_session(page).send("Accessibility.getFullAXTree")["nodes"]
    controls = [node for node in tree if not node["ignored"] and node["role"]["value"] in CONTROLS]
    assert len(controls) >= (40 if kind == "live" else 8)
    assert [node for node in controls if not node["name"]["value"].strip(" ✕¾")] == []

    stops = set(page.evaluate(STOPS))
    reached = set()
    for _ in range(2 * len(stops)):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.dataset.stop"))
    assert stops <= reached
    page.close()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["live", "recorded"])
def test_a_page_that_cannot_draw_says_so(browser, until, url_of, kind):
    page = browser.new_page()
    page.add_init_script(NO_WEBGL)
    page.goto(url_of[kind])
    until(page, "!document.getElementById('failure').hidden")
    failure = page.locator("#failure")
    assert failure.get_attribute("role") == "alert"
    assert "needs a browser with WebGL" in failure.inner_text()
    assert failure.bounding_box()["width"] > 100
    page.close()
