"""Pages in the dark scheme: dark behind the robot and in the panel, text to read; pictures stay light."""

import io

import numpy as np
import pytest
from PIL import Image

from pepper_kin.viewer import Viewer
from pepper_kin.viewer.server import ViewerServer

pytestmark = pytest.mark.browser

CONTRAST = """() => {
    const channels = (text) => text.match(/[\\d.]+/g).map(Number);
    const linear = (c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4);
    const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
    const below = (element) => {
        for (let part = element; part; part = part.parentElement) {
            const color = channels(getComputedStyle(part).backgroundColor);
            if (color.length === 3 || color[3] > 0.7) return color;
        }
        return null;
    };
    const found = [];
    const texts = 'summary, .hint, label, button, select, figcaption span, figcaption b, output';
    for (const element of document.querySelectorAll(texts)) {
        if (!element.offsetParent || !element.textContent.trim()) continue;
        const ground = below(element);
        if (!ground) continue;
        const ink = channels(getComputedStyle(element).color);
        const [a, b] = [light(ink), light(ground)].sort((x, y) => y - x);
        found.push([(a + 0.05) / (b + 0.05), element.textContent.trim().slice(0, 30)]);
    }
    return found;
}"""


def pixels(page):
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)


@pytest.mark.thorough
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", ["live", "recorded"])
def test_text_can_be_read_in_both_schemes(browser, until, pepper, tmp_path, scheme, kind):
    """Contrast by the Web Content Accessibility Guidelines 2.1, level AA."""
    server = ViewerServer(pepper, port=0) if kind == "live" else None
    try:
        url = server.url if server else Viewer(pepper).save_html(tmp_path / "a.html").as_uri()
        page = browser.new_page(viewport={"width": 1000, "height": 700}, color_scheme=scheme)
        page.goto(url)
        until(page, "window.pepperKin !== undefined && (pepperKin.parts?.scene.poses ?? true)")
        page.wait_for_timeout(500)
        found = page.evaluate(CONTRAST)
        assert len(found) > (20 if server else 3)
        for ratio, text in found:
            assert ratio >= 4.5, (ratio, text)
        corner = pixels(page)[60:90, 5:40].mean()
        assert corner < 70 if scheme == "dark" else corner > 180
        page.close()
    finally:
        if server:
            server.close()


@pytest.mark.thorough
def test_a_picture_is_the_same_whatever_the_scheme(browser, until, pepper, tmp_path):
    url = Viewer(pepper).save_html(tmp_path / "a.html").as_uri() + "#panel=0"
    pictures = []
    for scheme in ("light", "dark"):
        page = browser.new_page(viewport={"width": 320, "height": 240}, color_scheme=scheme)
        page.goto(url)
        until(page, "window.pepperKin !== undefined")
        page.wait_for_timeout(500)
        pictures.append(pixels(page))
        page.close()
    np.testing.assert_array_equal(*pictures)
