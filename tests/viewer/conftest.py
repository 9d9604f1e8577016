"""A little machine to draw: a plate, a cube that slides along y and an arm that turns about z."""

import base64
import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pepper_kin.model.shapes import Box, Capsule, Cylinder, Sphere
from pepper_kin.viewer import Drawable

RED = (0.9, 0.05, 0.05, 1.0)


def poses_of(y, angles):
    """Poses of the plate (fixed), the cube (at y) and the arm (turned by angles) for each time."""
    poses = np.tile(np.eye(4), (len(y), 3, 1, 1))
    poses[:, 1, 1, 3] = y
    poses[:, 1, 2, 3] = 0.8
    poses[:, 2, :3, :3] = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_matrix()
    poses[:, 2, :3, 3] = [0.0, 0.0, 0.4]
    return poses


@pytest.fixture
def machine():
    drawables = (
        Drawable("plate", "base", Cylinder(0.3, 0.1), np.eye(4), (0.8, 0.8, 0.82, 1.0)),
        Drawable("cube", "slide", Box((0.15, 0.15, 0.15)), np.eye(4), RED),
        Drawable("bar", "arm", Capsule(0.04, 0.4), np.eye(4), (0.3, 0.4, 0.5, 1.0)),
        Drawable("glass", None, Sphere(0.1), np.eye(4), (0.3, 0.5, 0.9, 0.4)),
    )
    times = np.linspace(0.0, 2.0, 5)
    poses = poses_of(np.linspace(-0.4, 0.4, 5), np.linspace(0.0, 2.0, 5))
    return SimpleNamespace(drawables=drawables, links=("base", "slide", "arm"), times=times, poses=poses)


@pytest.fixture
def content_of():
    """Read the data of a page back, typed arrays as numpy arrays."""
    kinds = {"Float32Array": "<f4", "Float64Array": "<f8", "Uint16Array": "<u2", "Uint32Array": "<u4"}

    def read(path: Path) -> dict:
        text = path.read_text(encoding="utf-8")
        (raw,) = re.findall(r'<script type="application/json" id="content">(.*?)</script>', text, re.DOTALL)
        data = json.loads(raw)
        buffers = [base64.b64decode(item) for item in data["buffers"]]

        def revive(value):
            if isinstance(value, dict) and "$buffer" in value:
                return np.frombuffer(buffers[value["$buffer"]], dtype=kinds[value["$type"]])
            if isinstance(value, dict):
                return {key: revive(item) for key, item in value.items()}
            return [revive(item) for item in value] if isinstance(value, list) else value

        return revive(data)

    return read


@pytest.fixture(scope="module")
def pepper():
    import pepper_kin as pk

    return pk.load_pepper()


@pytest.fixture
def server(pepper):
    from pepper_kin.viewer.server import ViewerServer

    server = ViewerServer(pepper, port=0)
    yield server
    server.close()


@pytest.fixture(scope="session")
def until():
    """Wait until a page meets a condition; playwright's own waiting needs eval, which pages forbid."""

    def wait(page, condition, seconds=30.0):
        for _ in range(int(seconds / 0.02)):
            if page.evaluate(condition):
                return
            page.wait_for_timeout(20)
        pytest.fail(f"the page never reached: {condition}")

    return wait


@pytest.fixture(scope="session")
def on_screen():
    """Where a live page shows a place in the robot's axes, in pixels."""
    return lambda page, place: page.evaluate(TO_SCREEN, [float(x) for x in place])


@pytest.fixture
def open_live(browser, until):
    """Open live pages; on leaving, see that they complained of nothing and asked nobody else for anything."""
    complaints, strangers, pages = [], [], []

    def open_page(url, width=800, height=600, scale=1.0):
        """Open a page; `scale` is that of its pixels, of which tests that compare no pictures need fewer."""
        page = browser.new_page(viewport={"width": width, "height": height}, device_scale_factor=scale)
        own = url.split("?")[0].rstrip("/")
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda r: None if r.url.startswith(own) else strangers.append(r.url))
        page.goto(url)
        until(page, READY)
        pages.append(page)
        return page

    yield open_page
    for page in pages:
        page.close()
    assert complaints == []
    assert strangers == []


TO_SCREEN = """(place) => {
    const seen = new MeshCat.THREE.Vector3(place[0], place[2], -place[1]).project(pepperKin.viewer.camera);
    const box = document.getElementById('view').getBoundingClientRect();
    return [box.left + (seen.x + 1) / 2 * box.width, box.top + (1 - seen.y) / 2 * box.height];
}"""
READY = "window.pepperKin !== undefined && pepperKin.connected && pepperKin.parts.scene.poses !== null"
