"""A viewer at the end of a notebook's cell: an inline frame in a page of another origin."""

import io
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from PIL import Image

from pepper_kin.viewer import Viewer

READY = "window.pepperKin !== undefined && pepperKin.connected && pepperKin.parts.scene.poses !== null"


@pytest.fixture
def notebook() -> Iterator[object]:
    """Serve a page around given HTML, as Jupyter does, at an address and port of its own."""
    shown = {"html": ""}

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            body = f"<!doctype html><html><body><p>Out[1]:</p>{shown['html']}</body></html>".encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Security-Policy", "frame-ancestors 'self'")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("localhost", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()

    def show(html: str) -> str:
        shown["html"] = html
        return f"http://localhost:{server.server_port}/"

    yield show
    server.shutdown()
    server.server_close()


@pytest.mark.thorough
@pytest.mark.browser
def test_the_frame_of_a_cell_draws_the_robot_and_follows_python(browser, until, pepper, notebook):
    q = pepper.joint_vector({"LShoulderPitch": -0.7, "HeadYaw": 0.4})
    with Viewer(pepper, port=0) as viewer:
        html = viewer._repr_html_()
        (address,) = re.findall(r'<iframe src="(http://127\.0\.0\.1:\d+/)"', html)
        page = browser.new_page(viewport={"width": 1000, "height": 760})
        try:
            page.goto(notebook(html))
            page.locator("iframe").wait_for()
            (frame,) = (frame for frame in page.frames if frame.url == address)
            until(frame, READY, 60)
            assert viewer.show(q) == address
            asked = np.round(q, 5).tolist()
            until(frame, f"pepperKin.values.q.every((x, k) => Math.abs(x - {asked}[k]) < 1e-4)", 60)
            assert frame.locator("#LShoulderPitch").input_value() == "-0.7"
            until(frame, "pepperKin.quality.settled && !pepperKin.viewer.needs_render", 60)
            drawn = (
                Image.open(io.BytesIO(page.locator("iframe").screenshot()))
                .convert("RGB")
                .crop((0, 0, 600, 640))
            )
            assert len(drawn.getcolors(maxcolors=600 * 640)) > 1000, "no picture"
        finally:
            page.close()
