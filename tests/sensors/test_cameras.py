"""Pictures against projections by hand."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.core.shading import LIGHT, TILES
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.twin.sensors import Camera, Intrinsics, RobotRays, camera_intrinsics


def ahead(pepper, q, camera, x, y, z):
    """World point at (x, y, z) of the camera's optical frame."""
    pose = pk.kinematics.frame_pose(pepper, q, camera.frame)
    return pose[:3, :3] @ [x, y, z] + pose[:3, 3]


def test_a_ball_appears_with_the_right_center_size_and_depth(pepper):
    q, camera = pepper.posture("Stand"), Camera(pepper, "camera_depth", floor=False)
    radius, far = 0.1, 1.5
    scene = pk.Scene().add_sphere("ball", radius, ahead(pepper, q, camera, 0.0, 0.0, far))
    depth = camera.depth(q, scene)
    ball = np.isfinite(depth) & (depth > 1.0)
    rows, columns = np.nonzero(ball)
    # The cone that touches the ball: sin(angle) = radius / distance; on the axis its picture is a disc.
    disc = 262.5 * np.tan(np.arcsin(radius / far))
    assert columns.mean() == pytest.approx(159.75, abs=0.3)
    assert rows.mean() == pytest.approx(119.75, abs=0.3)
    assert np.sqrt(ball.sum() / np.pi) == pytest.approx(disc, rel=0.01)
    assert depth[120, 160] == pytest.approx(far - radius, abs=5e-5)  # a quarter pixel off the axis


@pytest.mark.parametrize("name", ["camera_top", "camera_bottom", "camera_depth"])
@pytest.mark.parametrize("lens", [False, True])
def test_small_balls_appear_where_they_are_projected(pepper, name, lens):
    rng, camera = np.random.default_rng(2), Camera(pepper, name, "VGA", floor=False, lens=lens)
    q = pepper.joint_vector({"HeadYaw": 0.4, "HeadPitch": -0.5, "HipRoll": 0.1})
    for _ in range(3):
        point = ahead(pepper, q, camera, *rng.uniform(-0.3, 0.3, 2), rng.uniform(0.9, 2.0))
        depth = camera.depth(q, pk.Scene().add_sphere("ball", 0.02, point))
        rows, columns = np.nonzero(np.abs(depth - camera.project(q, point[None])[0, 2]) < 0.03)
        u, v, _ = camera.project(q, point[None])[0]
        assert len(rows) > 20
        assert columns.mean() == pytest.approx(u, abs=0.4)
        assert rows.mean() == pytest.approx(v, abs=0.4)


def test_projection_by_hand_and_by_rays(pepper):
    q, camera = pepper.posture("Crouch"), Camera(pepper, "camera_top")
    point = ahead(pepper, q, camera, 0.2, -0.1, 2.0)
    intrinsics = camera_intrinsics("camera_top")
    expected = [intrinsics.fx * 0.1 + intrinsics.cx, -intrinsics.fy * 0.05 + intrinsics.cy, 2.0]
    np.testing.assert_allclose(camera.project(q, point[None])[0], expected, atol=1e-9)
    behind = camera.project(q, ahead(pepper, q, camera, 0, 0, -1)[None])[0]
    assert np.isnan(behind[:2]).all()
    assert behind[2] == pytest.approx(-1)


def test_the_lens_is_inverted_at_every_pixel():
    intrinsics = camera_intrinsics("camera_bottom", "VGA")
    rays = intrinsics.rays(lens=True)
    x, y = intrinsics.distorted(rays[..., 0], rays[..., 1])
    v, u = np.mgrid[: intrinsics.height, : intrinsics.width]
    np.testing.assert_allclose(intrinsics.fx * x + intrinsics.cx, u, atol=1e-6)
    np.testing.assert_allclose(intrinsics.fy * y + intrinsics.cy, v, atol=1e-6)


def test_depth_of_the_floor_is_that_of_the_plane(pepper):
    camera = Camera(pepper, "camera_bottom")
    q = pepper.joint_vector({"HeadPitch": 0.0})
    pose = pk.kinematics.frame_pose(pepper, q, camera.frame)
    depth, rays = camera.depth(q), camera.intrinsics.rays() @ pose[:3, :3].T
    expected = -pose[2, 3] / rays[..., 2]
    floor = np.isclose(depth, expected, rtol=1e-9)
    assert floor.mean() > 0.9
    assert (depth[~floor] < expected[~floor]).all()  # the rest is the robot before it


def test_a_depth_camera_sees_as_far_as_the_makers_range(pepper):
    """Elsewhere the picture is that without a range; points of the floor are not kilometers away."""
    q = pepper.joint_vector({"HeadPitch": -0.1})
    near = pk.Scene().add_box(
        "near", (0.02, 0.02, 0.02), ahead(pepper, q, Camera(pepper, "camera_depth"), 0, 0, 0.2)
    )
    every = Camera(pepper, "camera_depth", depth_range=(0.0, np.inf)).depth(q, near)
    camera = Camera(pepper, "camera_depth")
    assert camera.depth_range == (0.4, 8.0)
    found = camera.depth(q, near)
    assert every[np.isfinite(every)].max() > 50.0
    assert (every < 0.4).sum() > 100
    np.testing.assert_array_equal(found, np.where(every < 0.4, -np.inf, np.where(every > 8.0, np.inf, every)))
    offsets = camera.points(found, q) - pk.kinematics.frame_pose(pepper, q, camera.frame)[:3, 3]
    assert 7.0 < np.linalg.norm(offsets, axis=1).max() < 10.5
    assert Camera(pepper, "camera_top").depth_range == (0.0, np.inf)
    for wrong in ((1.0, 0.5), (-1.0, 2.0), 3.0, (0.0, np.nan)):
        with pytest.raises(InvalidValueError, match=r"depth_range: .* least and greatest depth"):
            Camera(pepper, "camera_depth", depth_range=wrong)


def test_the_hand_in_front_of_the_eyes_is_seen_where_it_is(pepper):
    camera = Camera(pepper, "camera_top", floor=False)
    q = pepper.joint_vector({"LShoulderPitch": 0.0, "LElbowRoll": -0.9, "HeadYaw": 0.6, "HeadPitch": 0.3})
    hand = pk.kinematics.frame_pose(pepper, q, "l_wrist")[:3, 3]
    u, v, z = camera.project(q, hand[None])[0]
    rows, columns = np.nonzero(np.isfinite(camera.depth(q)))
    assert 0 < u < 320
    assert 0 < v < 240
    near = np.hypot(columns - u, rows - v) < 40
    assert near.sum() > 100
    measured = camera.depth(q)[rows[near], columns[near]]
    assert np.abs(measured - z).min() < 0.08
    assert not np.isfinite(camera.depth(pepper.joint_vector({"HeadPitch": -0.7}))).any()


def test_colors_are_those_of_the_scene_in_the_light(pepper):
    q, camera = pepper.posture("Stand"), Camera(pepper, "camera_top", floor=False)
    red = (0.9, 0.1, 0.1, 1.0)
    center = ahead(pepper, q, camera, 0, 0, 1.5)
    scene = pk.Scene().add("ball", pk.model.Sphere(0.3), center, color=red)
    picture = camera.color(q, scene).astype(float)
    assert picture.shape == (240, 320, 3)
    ball = picture[..., 0] > 4 * picture[..., 2]
    assert ball.sum() > 2000
    bright = picture[..., 0] * ball
    row, column = np.unravel_index(np.argmax(bright), bright.shape)
    u, v, _ = camera.project(q, (center + 0.3 * np.array(LIGHT) / np.linalg.norm(LIGHT))[None])[0]
    shade = bright[ball]
    assert shade.max() / shade.min() > 1.5
    assert row < np.nonzero(ball)[0].mean()  # lit from above
    assert (column - np.nonzero(ball)[1].mean()) * (u - 160) > 0
    assert v < 120
    assert (picture[0, 0] > 130).all()  # the sky


def test_pixels_of_the_floor_are_tiles_in_the_light(pepper):
    """Each pixel by its formula at the point of the floor that projects to it."""
    q, camera = pepper.joint_vector({"HeadPitch": 0.4, "HeadYaw": 0.3}), Camera(pepper, "camera_top")
    points = np.random.default_rng(3).uniform((0.7, -1.0, 0.0), (3.0, 2.0, 0.0), (400, 3))
    eye = pk.kinematics.frame_pose(pepper, q, camera.frame)[:3, 3]
    u, v, z = camera.project(q, points).T
    place = points[:, :2] / 0.5
    inside = (z > 0) & (u > 1) & (u < 318) & (v > 1) & (v < 238)
    inside &= (np.abs(place - np.round(place)) > 0.1).all(axis=1)  # not on a joint between tiles
    points, place = points[inside], place[inside]
    assert len(points) > 50
    tile = np.where(np.floor(place).sum(axis=1)[:, None] % 2 == 1, TILES[1], TILES[0])
    steep = (eye - points)[:, 2] / np.linalg.norm(eye - points, axis=1)
    light = 0.40 + 0.45 * LIGHT[2] / np.linalg.norm(LIGHT) + 0.15 * steep
    pixels = np.round(v[inside]).astype(int), np.round(u[inside]).astype(int)
    shown = np.abs(camera.color(q)[pixels] - 255.0 * tile * light[:, None]).max(axis=1) < 1.5
    hidden = (
        camera.depth(q)[np.round(v[inside]).astype(int), np.round(u[inside]).astype(int)] < 0.9 * z[inside]
    )
    assert (shown | hidden).all()
    assert shown.sum() > 50


def test_rays_say_what_they_meet(pepper):
    scene = pk.Scene().add("ball", pk.model.Sphere(0.2), (2.0, 0.0, 1.5), color=(0.2, 0.4, 0.6, 1.0))
    sight = RobotRays(pepper, floor=False).look(
        pepper.neutral(), scene, (1.0, 0.0, 1.5), [[1.0, 0.0, 0.0], [0.0, 0.0, 3.0]]
    )
    np.testing.assert_allclose(sight.distance, [0.8, np.inf])
    np.testing.assert_allclose(sight.normal, [[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_array_equal(sight.color, [[0.2, 0.4, 0.6], [0.0, 0.0, 0.0]])


def test_same_picture_twice_and_attached_objects_move_along(pepper):
    camera = Camera(pepper, "camera_top", "QQVGA", floor=False)
    scene = pk.Scene().add_sphere("cup", 0.05, (0.6, 0.0, 1.1))
    q = pepper.joint_vector({"HeadPitch": 0.0})
    held = scene.attach("cup", "torso", pepper=pepper, q=q)
    turned = pepper.joint_vector({"HeadPitch": 0.0, "HipRoll": 0.2})
    first, second = camera.depth(q, held), camera.depth(turned, held)
    np.testing.assert_allclose(first, camera.depth(q, scene), rtol=1e-12)
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(first, camera.depth(q, held))


@pytest.mark.parametrize("lens", [False, True])
def test_points_of_a_depth_picture_lie_on_what_is_seen(pepper, lens):
    camera = Camera(pepper, "camera_depth", lens=lens)
    q = pepper.joint_vector({"HeadYaw": 0.4, "HeadPitch": 0.2, "HipRoll": 0.1})
    center = ahead(pepper, q, camera, 0.1, -0.05, 1.2)
    depth = camera.depth(q, pk.Scene().add_sphere("ball", 0.15, center))
    points = camera.points(depth, q)
    from_center, heights = np.linalg.norm(points - center, axis=1), points[:, 2]
    on_ball, on_floor = np.abs(from_center - 0.15) < 1e-9, np.abs(heights) < 1e-9
    assert on_ball.sum() > 1000
    assert on_floor.sum() > 1000
    assert (on_ball | on_floor).mean() > 0.95  # the rest is the robot's own body
    pixels = camera.project(q, points)
    v, u = np.nonzero(np.isfinite(depth))
    np.testing.assert_allclose(pixels, np.column_stack([u, v, depth[v, u]]), atol=1e-4)
    pose = pk.kinematics.frame_pose(pepper, q, camera.frame)
    np.testing.assert_allclose(camera.points(depth) @ pose[:3, :3].T + pose[:3, 3], points, atol=1e-12)


def test_pixels_without_a_depth_have_no_point(pepper):
    camera = Camera(pepper, intrinsics=Intrinsics(3, 2, 2.0, 4.0, 1.0, 0.0))
    found = camera.points([[np.nan, 2.0, np.inf], [0.0, -np.inf, 1.0]])
    np.testing.assert_allclose(found, [[0.0, 0.0, 2.0], [0.5, 0.25, 1.0]], atol=1e-15)
    assert camera.points(np.full((2, 3), np.inf), pepper.posture("Stand")).shape == (0, 3)
    for wrong in (np.ones((3, 2)), "near", [[1.0], [2.0, 3.0]]):
        with pytest.raises(InvalidValueError, match="depth"):
            camera.points(wrong)


def test_misuse_is_named(pepper):
    with pytest.raises(UnknownNameError, match="camera_depth"):
        Camera(pepper, "webcam")
    with pytest.raises(UnknownNameError, match="QQVGA"):
        Camera(pepper, "camera_top", "4K")
    with pytest.raises(InvalidValueError, match="geometry_type"):
        Camera(pepper, geometry_type="x-ray")
    small = Camera(pepper, intrinsics=Intrinsics(4, 3, 2.0, 2.0, 1.5, 1.0))
    assert small.depth(pepper.posture("Stand")).shape == (3, 4)
    with pytest.raises(InvalidValueError, match="q"):
        small.depth(np.full(pepper.n, np.nan))
