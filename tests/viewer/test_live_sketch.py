"""The moving picture without a graphics card: few triangles and calls, the newest pose, fine at rest."""

import io

import coal
import numpy as np
import pytest
from PIL import Image

import pepper_kin as pk
from pepper_kin.viewer.server.coarsening import coarsened
from pepper_kin.viewer.server.layers import INERTIA, SPHERES, VISUAL, layers_of
from pepper_kin.viewer.server.sketches import sketches_of
from pepper_kin.viewer.server.targets import SharedTargets

# Keep the picture a sketch, drawn when the test says so.
HOLD = """() => {
    const { viewer, quality, parts } = pepperKin;
    clearTimeout(quality.timer);
    quality.finish = () => 0;
    quality.judge = () => 0;
    quality.level = 0;
    for (let k = 0; k < 3; k++) viewer.render();
    return [quality.sketched, viewer.renderer.info.render.calls, viewer.renderer.info.render.triangles];
}"""
LOOSE = """() => {
    delete pepperKin.quality.finish;
    delete pepperKin.quality.judge;
    pepperKin.viewer.set_dirty();
}"""


@pytest.fixture(scope="module")
def layers(pepper):
    return layers_of(pepper, SharedTargets(pepper))


def box_of(drawables, link):
    points = np.concatenate([d.geometry.vertices for d in drawables if d.link == link])
    return np.stack([points.min(0), points.max(0)])


def solid_of(surface):
    solid = coal.BVHModelOBBRSS()
    solid.beginModel(len(surface.faces), len(surface.vertices))
    for a, b, c in surface.faces.tolist():
        solid.addTriangle(*(surface.vertices[k].astype(float) for k in (a, b, c)))
    solid.endModel()
    return solid


def picture_of(page):
    image = Image.open(io.BytesIO(page.locator("#view").screenshot()))
    return np.asarray(image.convert("RGB")).astype(int)


def test_sketches_have_few_triangles_and_fill_the_same_bounds(pepper, layers):
    sketches = sketches_of(pepper, layers)
    for layer, share in ((VISUAL, 0.1), (SPHERES, 0.5)):
        fine = sum(len(d.geometry.faces) for d in layers[layer])
        assert sum(len(d.geometry.faces) for d in sketches[layer]) < share * fine
    for link in {d.link for d in layers[VISUAL]}:
        np.testing.assert_allclose(box_of(sketches[VISUAL], link), box_of(layers[VISUAL], link), atol=0.005)
    fine = {(d.link, d.color): solid_of(d.geometry) for d in layers[VISUAL]}
    for coarse in sketches[VISUAL]:
        for corner in coarse.geometry.vertices.astype(float):
            place = coal.Transform3s(np.eye(3), corner)
            found = coal.DistanceResult()
            coal.distance(
                fine[coarse.link, coarse.color], coal.Transform3s.Identity(), coal.Sphere(1e-6), place,
                coal.DistanceRequest(), found,
            )  # fmt: skip
            assert found.min_distance < 0.008
    for coarse, fine in zip(sketches[INERTIA], layers[INERTIA], strict=True):
        np.testing.assert_allclose(
            np.abs(coarse.geometry.vertices).max(0), np.abs(fine.geometry.vertices).max(0), rtol=1e-6
        )


def test_coarsened_corners_stay_where_planes_meet(layers):
    """The corners of a box lie on three planes each: coarsening must not round them off."""
    from dataclasses import replace

    from pepper_kin.viewer.surface import DrawnSurface

    side = np.linspace(0.003, 0.997, 21)
    u, v = (grid.ravel() for grid in np.meshgrid(side, side))
    row = np.arange(20)
    at = (row[:, None] * 21 + row).ravel()
    quads = np.concatenate([np.stack([at, at + 1, at + 22], 1), np.stack([at, at + 22, at + 21], 1)])
    sides = [
        np.roll(np.stack([np.full_like(u, end), u, v], 1), axis, axis=1)
        for axis in range(3)
        for end in (0.003, 0.997)
    ]
    faces = np.concatenate([quads + k * len(u) for k in range(6)])
    box = replace(layers[VISUAL][0], geometry=DrawnSurface(np.concatenate(sides), faces))
    (coarse,) = coarsened((box,), 100)
    assert len(coarse.geometry.faces) <= 100
    corners = np.array([[x, y, z] for x in (0.003, 0.997) for y in (0.003, 0.997) for z in (0.003, 0.997)])
    away = np.linalg.norm(coarse.geometry.vertices[None] - corners[:, None], axis=2).min(axis=1)
    assert away.max() < 1e-3
    assert coarsened((box,), len(faces)) == (box,)


@pytest.mark.thorough
@pytest.mark.browser
def test_everything_that_moves_takes_three_calls_and_is_fine_again_at_rest(open_live, until, server, pepper):
    for layer in server.call(lambda session: session.available):
        server.call(lambda session, layer=layer: session.show(layer, True))
    page = open_live(server.url)
    until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
    still = page.evaluate("[pepperKin.viewer.renderer.info.render.calls, pepperKin.quality.sketched]")
    assert still[0] > 50
    sketched, calls, triangles = page.evaluate(HOLD)
    assert sketched
    assert calls == 3
    assert triangles < 25_000
    page.evaluate(LOOSE)
    until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
    assert page.evaluate("pepperKin.viewer.renderer.info.render.calls") == still[0]
    assert page.evaluate("pepperKin.viewer.renderer.getPixelRatio()") == 1.5


@pytest.mark.thorough
@pytest.mark.browser
def test_a_sketch_covers_what_moves_and_no_more(open_live, until, server, pepper):
    """The part that is drawn holds every pixel that would be drawn of the whole, wherever the arms are."""
    page = open_live(server.url)
    until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
    boxes = []
    for q in ({}, {"LShoulderRoll": 1.4, "RShoulderRoll": -1.4}, {"LShoulderPitch": -1.8}):
        server.call(lambda session, q=q: session.set_joints(pepper.joint_vector(q)))
        number = pepper.joint_index(next(iter(q), "LShoulderRoll"))
        value = pepper.joint_vector(q)[number]
        until(page, f"Math.abs(pepperKin.values.q[{number}] - {value}) < 1e-3")
        page.wait_for_timeout(100)
        page.evaluate(HOLD)
        part = picture_of(page)
        boxes.append(page.evaluate("pepperKin.parts.scene.sketch.cutout.box"))
        page.evaluate("""() => {
            const { cutout } = pepperKin.parts.scene.sketch;
            cutout.fit = () => cutout.open();
            for (let k = 0; k < 3; k++) pepperKin.viewer.render();
            delete cutout.fit;
        }""")
        page.wait_for_timeout(100)
        assert page.evaluate("pepperKin.parts.scene.sketch.cutout.box") is None
        assert (np.abs(picture_of(page) - part).max(axis=2) > 40).mean() < 1e-3
        page.evaluate(LOOSE)
        until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
    view = page.evaluate(
        "[pepperKin.viewer.dom_element.clientWidth, pepperKin.viewer.dom_element.clientHeight]"
    )
    assert boxes[0][2] * boxes[0][3] < 0.8 * view[0] * view[1]
    assert boxes[1][2] > boxes[0][2]


@pytest.mark.thorough
@pytest.mark.browser
def test_the_sketch_resembles_the_fine_picture(open_live, until, server, pepper):
    server.call(lambda session: session.add_obstacle("box", np.array([0.5, 0.3, 0.9])))
    page = open_live(server.url)
    until(page, "pepperKin.values.obstacles.length === 1")

    until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
    fine = picture_of(page)
    page.evaluate(HOLD)
    page.wait_for_timeout(100)
    rough = picture_of(page)
    # Shadows, highlights and edges differ; sky, floor, box and body are in the same places and colors.
    differs = np.abs(fine - rough).max(axis=2) > 60
    assert differs.mean() < 0.04
    assert np.abs(fine.mean(axis=(0, 1)) - rough.mean(axis=(0, 1))).max() < 6
    q = pepper.joint_vector({"LShoulderPitch": -0.5, "HipPitch": -0.6})
    server.call(lambda session: session.set_joints(q))
    until(page, f"Math.abs(pepperKin.values.q[{pepper.joint_index('HipPitch')}] + 0.6) < 1e-3")
    page.evaluate(HOLD)
    page.wait_for_timeout(100)
    assert (np.abs(picture_of(page) - rough).max(axis=2) > 60).sum() > 3000


@pytest.mark.thorough
@pytest.mark.browser
def test_of_many_poses_at_once_the_newest_is_drawn(open_live, until, server, pepper):
    page = open_live(server.url)
    until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
    drawn = page.evaluate("""async () => {
        const { scene } = pepperKin.parts, drawn = [], values = scene.poses;
        scene.drawnListeners.push((stamp) => drawn.push(stamp));
        await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));
        scene.pose(values, 1); // the first after a still picture may begin at once, or with the next frame
        drawn.length = 0;
        for (let stamp = 2; stamp <= 40; stamp++) scene.pose(values, stamp);
        const frame = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));
        for (let k = 0; k < 4; k++) await frame();
        return drawn;
    }""")
    assert drawn[-1] == 40
    assert len(drawn) <= 2
    place = pk.kinematics.frame_pose(pepper, server.call(lambda session: session.q), "l_wrist")[:3, 3]
    np.testing.assert_allclose(page.evaluate("pepperKin.parts.scene.place('l_wrist')"), place, atol=1e-5)
