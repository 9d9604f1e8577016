"""What the camera sees: targets, long ways of a base, and what a camera of one's own is told to see."""

import numpy as np
import pytest
from PIL import Image

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.viewer import JointMotion, Viewer, Viewpoint
from pepper_kin.viewer.camera import view_options
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server.planning import show_motion

SEEN = """([x, y, z]) => {
    const { camera } = pepperKin.viewer;
    camera.updateMatrixWorld();
    const at = new MeshCat.THREE.Vector3(x, z, -y).project(camera);
    return [at.x, at.y, at.z];
}"""


def in_picture(page, point):
    return np.abs(page.evaluate(SEEN, list(map(float, point)))).max() <= 1


@pytest.fixture(scope="module")
def planar():
    return pk.load_pepper(base="planar")


@pytest.fixture(scope="module")
def drive(planar):
    """Four meters to the left and back around, in four seconds."""
    times = np.linspace(0.0, 4.0, 81)
    q = np.tile(planar.posture("Stand"), (81, 1))
    q[:, planar.joint_index("BaseY")] = 4.0 * np.sin(np.pi * times / 8.0)
    q[:, planar.joint_index("BaseX")] = 1.5 * np.sin(np.pi * times / 4.0)
    return JointMotion(times, q)


def test_a_camera_of_ones_own_is_an_option_of_the_page():
    assert view_options("side") == {"view": "side"}
    assert view_options(Viewpoint((1, 2, 3), (0.5, 0, 0.125))) == {"camera": "1,2,3,0.5,0,0.125"}
    with pytest.raises(UnknownNameError, match="unknown camera view 'below'; available: three-quarter"):
        view_options("below")
    with pytest.raises(InvalidValueError, match="position of the camera: got nan"):
        Viewpoint((np.nan, 0, 0), (0, 0, 0))
    with pytest.raises(InvalidValueError, match=r"target of the camera: .* at least 0\.05 m from its"):
        Viewpoint((1, 0, 0), (1, 0, 0.01))


@pytest.mark.thorough
@pytest.mark.browser
def test_a_picture_has_the_cameras_target_in_its_middle(pepper, chromium_path, tmp_path):
    """A ball 10 cm wide, seen from 1 m, where the picture is 2 tan(16 deg) m high."""
    viewer = Viewer(pepper).add_scene(
        pk.Scene().add("ball", pk.model.Sphere(0.05), (0.2, 1.5, 1.3), color=(1, 0, 0, 1))
    )
    camera = Viewpoint((0.2 + 0.6, 1.5 + 0.8, 1.3), (0.2, 1.5, 1.3))
    path = viewer.save_image(tmp_path / "ball.png", size=(600, 400), view=camera)
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    rows, columns = np.nonzero((pixels[..., 0] > 90) & (pixels[..., 0] > 2.5 * pixels[..., 1]))
    assert abs((rows.min() + rows.max()) / 2 - 200) < 3
    assert abs((columns.min() + columns.max()) / 2 - 300) < 3
    assert np.ptp(columns) + 1 == pytest.approx(400 * 0.1 / (2 * np.tan(np.radians(16.0))), rel=0.05)


@pytest.mark.thorough
@pytest.mark.browser
def test_a_page_begins_with_its_view_unless_its_address_has_another(browser, until, pepper, tmp_path):
    camera = Viewpoint((1.5, 0.9, 1.1), (0.1, 0.0, 0.8))
    path = Viewer(pepper).save_html(tmp_path / "page.html", view=camera)
    for options, place in (("", camera.position), ("#camera=2,0,1,0,0,0.5", (2.0, 0.0, 1.0))):
        page = browser.new_page()
        page.goto(path.as_uri() + options)
        until(page, "window.pepperKin !== undefined")
        x, y, z = page.evaluate("pepperKin.viewer.camera.position.toArray()")
        np.testing.assert_allclose((x, -z, y), place, atol=1e-6)
        page.close()
    with pytest.raises(UnknownNameError, match="camera view"):
        Viewer(pepper).save_html(path, view="back")


@pytest.mark.thorough
@pytest.mark.browser
def test_a_recording_frames_its_targets_and_the_whole_way_of_the_base(
    browser, until, planar, drive, tmp_path
):
    target = (-2.5, 0.5, 1.8)
    path = Viewer(planar).add_target("far", target).save_html(tmp_path / "drive.html", drive)
    for width, height in ((1000, 700), (390, 780)):
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(path.as_uri())
        until(page, "window.pepperKin !== undefined")
        assert in_picture(page, target)
        for q in drive.positions[::8]:
            for link in ("base_footprint", "Head", "l_wrist", "r_wrist"):
                assert in_picture(page, pk.kinematics.frame_pose(planar, q, link)[:3, 3])
        page.evaluate("pepperKin.seek(4)")
        x, _, z = page.evaluate(
            "pepperKin.viewer.scene_tree.find(['Stage', 'key', '<object>']).object.target.position.toArray()"
        )
        assert np.hypot(x - drive.positions[-1, 0], -z - 4.0) < 1.0  # the shadow is where the robot is
        page.close()


@pytest.mark.thorough
@pytest.mark.browser
def test_the_live_page_steps_back_for_targets_and_long_ways(open_live, until, planar, drive):
    server = ViewerServer(planar, port=0)
    try:
        server.call(lambda session: session.set_follow(False))
        page = open_live(server.url)
        target = [1.0, -2.5, 1.2]
        assert not in_picture(page, target)
        server.call(lambda session: session.move_target("right hand", np.array(target)))
        until(page, f"({SEEN})({target}).every((x) => Math.abs(x) <= 1)")
        server.call(lambda session: session.release())
        shown = show_motion(planar, drive, pk.Scene(), "A drive")
        server.call(lambda session: session.load(shown, play=False))
        until(page, f"({SEEN})([0, 4, 1]).every((x) => Math.abs(x) <= 1)")
        for q in drive.positions[::8]:
            assert in_picture(page, pk.kinematics.frame_pose(planar, q, "Head")[:3, 3])
            assert in_picture(page, pk.kinematics.frame_pose(planar, q, "base_footprint")[:3, 3])
    finally:
        server.close()


@pytest.mark.thorough
@pytest.mark.browser
def test_a_camera_that_a_visitor_has_turned_stays_and_is_found_again(open_live, until, pepper):
    where = "stage.standing(pepperKin.viewer)"
    server = ViewerServer(pepper, port=0)
    try:
        page = open_live(server.url)
        server.call(lambda session: session.set_follow(False))
        before = page.evaluate(where)
        page.mouse.move(80, 300)
        page.mouse.down()
        page.mouse.move(160, 340, steps=4)
        page.mouse.up()
        until(page, "location.hash.includes('camera=')")
        own = page.evaluate(where)
        assert np.linalg.norm(np.array(own) - before) > 0.1
        server.call(lambda session: session.move_target("right hand", np.array([1.0, -2.5, 1.2])))
        until(page, "pepperKin.values.targets['right hand'].on")
        page.wait_for_timeout(1200)
        np.testing.assert_allclose(page.evaluate(where), own, atol=2e-3)
        page.reload()
        until(
            page,
            "window.pepperKin !== undefined && pepperKin.connected && pepperKin.parts.scene.poses !== null",
        )
        page.wait_for_timeout(300)
        np.testing.assert_allclose(page.evaluate(where), own, atol=2e-3)
        page.click("[data-view=front]")
        until(page, "location.hash === '#view=front'")
        assert in_picture(page, [1.0, -2.5, 1.2])
    finally:
        server.close()
