"""Pictures of the guides: demo and film, visual geometry, reach, gestures, live page, a timed motion."""

from __future__ import annotations

import io
import os
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import pepper_kin as pk
from pepper_kin.jobs import demo_scene
from pepper_kin.jobs.demo import GAZE, TARGET
from pepper_kin.kinematics import frame_pose, reach_map
from pepper_kin.kinematics.reach_picture import save_reach_picture
from pepper_kin.model import Box, PepperModel
from pepper_kin.trajectory import Trajectory, plot_motions
from pepper_kin.viewer import JointMotion, find_chromium
from pepper_kin.viewer.browser import CHROMIUM_FLAGS
from pepper_kin.viewer.video import save_video

from .album import gesture_album
from .camera import framing
from .examples import variables_of
from .reaching import BODY
from .sheet import FOLDER, Sheet, save_small
from .stage import BLUE, aim

LOGS = Path(os.environ.get("PEPPER_KIN_ROBOT_LOGS", Path(__file__).parents[3] / "shared" / "robot_logs"))
ON_SCREEN = """(place) => {
    const seen = new MeshCat.THREE.Vector3(place[0], place[2], -place[1]).project(pepperKin.viewer.camera);
    const box = document.getElementById("view").getBoundingClientRect();
    return [box.left + (seen.x + 1) / 2 * box.width, box.top + (1 - seen.y) / 2 * box.height];
}"""
SCRUB = "e => { e.value = 0.6 * e.max; e.dispatchEvent(new Event('input')); }"
TABLE = [[x, y, 0.7] for x in (0.3, 0.67) for y in (-0.3, 0.4)]


@cache
def demo_motion() -> tuple[PepperModel, pk.Scene, Trajectory]:
    """Return the demo's motion, with time enough for the planner on a machine that is busy."""
    pepper, scene = pk.load_pepper(), demo_scene()
    tasks = [pk.ik.HandPosition("left", TARGET), pk.ik.LookAt(GAZE)]
    plan = pk.plan(pepper, pepper.posture("Stand"), tasks, scene, seed=0, timeout=60.0)
    return pepper, scene, pk.retime(pepper, plan)


def draw_demo() -> None:
    """The demo at its end."""
    pepper, scene, trajectory = demo_motion()
    viewer = pk.Viewer(pepper).add_scene(scene).add_target("hand", TARGET).add_target("gaze", GAZE, BLUE)
    viewer.save_image(FOLDER / "demo.png", trajectory, at_time=trajectory.duration, size=(1280, 720))


def draw_film() -> None:
    """The demo to and fro, as an endless film."""
    pepper, scene, trajectory = demo_motion()
    there = trajectory(np.linspace(0.0, trajectory.duration, round(40 * trajectory.duration) + 1)).position
    stay, wait = np.repeat(there[-1:], 40, axis=0), np.repeat(there[:1], 20, axis=0)
    positions = np.concatenate([wait, there, stay, there[::-1]])
    motion = JointMotion(np.arange(len(positions)) / 40, positions, {})
    size = (640, 460)
    viewer = pk.Viewer(pepper).add_scene(scene).add_target("hand", TARGET).add_target("gaze", GAZE, BLUE)
    with tempfile.TemporaryDirectory() as folder:
        page = viewer.save_html(Path(folder) / "film.html", motion, series={})
        aim(page, framing([*BODY, *TABLE], size, 42, 12, margin=0.98))
        save_video(page, FOLDER / "demo.gif", fps=16.0, size=size, timeout=600.0)


def draw_live_film() -> None:
    """The arm that gives way to the ball, as example 22 had it."""
    example = variables_of("22")
    times = np.array(example["times"])
    motion = JointMotion(times - times[0], np.array(example["positions"]), {})
    size = (480, 400)
    viewer = pk.Viewer(example["pepper"]).add_scene(example["seen"](0.0))
    around = np.array([[x, y, z] for x in (-0.2, 0.5) for y in (-0.5, 0.6) for z in (0.6, 1.25)])
    with tempfile.TemporaryDirectory() as folder:
        page = viewer.save_html(Path(folder) / "film.html", motion, series={})
        aim(page, framing(around, size, 50, 14, margin=1.0))
        save_video(page, FOLDER / "live_motion.gif", fps=12.0, size=size, timeout=600.0)


def draw_visual() -> None:
    """The robot's visual geometry, its capsules and its spheres, from three sides."""
    pepper = pk.load_pepper()
    for name, geometry_type, over in (
        ("visual", "visual", None),
        ("capsules", "visual", "collision"),
        ("spheres", "visual", "spheres"),
    ):
        for view in ("front", "side", "three-quarter"):
            picture = FOLDER / f"{name}_{view}.png"
            pk.Viewer(pepper, geometry_type=geometry_type, over=over).save_image(
                picture, size=(480, 640), view=view
            )


def draw_reach() -> None:
    """Where the left hand can go."""
    pepper = pk.load_pepper(base="planar")
    arm, torso = pepper.joint_group("left_arm"), pepper.joint_group("torso")
    choices = {
        "left arm": arm,
        "with torso": (*torso, *arm),
        "with torso, turning on the spot": ("BaseYaw", *torso, *arm),
    }
    maps = {title: reach_map(pepper, "LArm_effector", joints=joints) for title, joints in choices.items()}
    save_reach_picture(maps, FOLDER / "reach_left.png")


def draw_gestures() -> None:
    """All gestures of the library where they are farthest from Stand."""
    pepper = pk.load_pepper()
    names = pk.motion.gesture_names()
    columns, wide, high = 8, 112, 176
    rows = -(-len(names) // columns)
    sheet = Sheet((columns * wide, rows * (high + 20)))
    for place, (name, picture) in enumerate(
        zip(names, gesture_album(pepper, names, (wide - 4, high - 4)), strict=True)
    ):
        left, top = place % columns * wide, place // columns * (high + 20)
        sheet.image(picture, left + 2, top + 20)
        sheet.text(left + wide / 2, top + 3, name, ha="center")
    sheet.save("gestures.png")


def draw_timing() -> None:
    """A timed motion against its limits, as `pepper-kin plot` draws it."""
    pepper, _, trajectory = demo_motion()
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder) / "timing.png"
        trajectory.plot(pepper, drawn)
        image = Image.open(drawn).convert("RGB")
    width = 900
    save_small(image.resize((width, round(image.height * width / image.width)), Image.LANCZOS), "timing.png")


def draw_comparison() -> None:
    """A wave as planned, on the twin, and slower, over each other."""
    pepper = pk.load_pepper()
    wave = pk.motion.gesture(pepper, "wave")
    twin = pk.Twin(pepper, timestep=0.002)
    slower = pk.trajectory.enforce_limits(pepper, wave.scaled(1.5))
    motions = {"as planned": wave, "twin": twin.execute(wave), "slower": twin.execute(slower)}
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder) / "comparison.png"
        plot_motions(pepper, motions, drawn, joints=["RShoulderPitch", "RElbowRoll", "RWristYaw"])
        image = Image.open(drawn).convert("RGB")
    width = 900
    small = image.resize((width, round(image.height * width / image.width)), Image.LANCZOS)
    save_small(small, "comparison.png")


def draw_live_page() -> None:
    """The page of `pepper-kin view` after a plan around an obstacle: panel, ghosts and plots."""
    pepper = pk.load_pepper()
    scene = (
        pk.Scene()
        .add_box("table", size=(0.40, 0.90, 0.03), position=(0.47, 0.05, 0.715))
        .add("box", Box((0.12, 0.12, 0.14)), position=(0.42, -0.02, 0.80), color=(0.3, 0.55, 0.75, 1.0))
    )
    with pk.Viewer(pepper, port=0).add_scene(scene) as viewer:
        address = viewer.show(pepper.posture("Stand"))
        viewer.follow(False).move_target("left hand", (0.38, 0.22, 0.82)).move_target(
            "gaze", (0.38, 0.22, 0.82)
        )
        save_small(_photographed(address, _press_plan), "live_page.png")


def draw_live_go() -> None:
    """The live page while the robot waits, as a box was dragged onto the target to which it goes."""
    pepper = pk.load_pepper()
    arm = {"LShoulderPitch": 1.0, "LShoulderRoll": 0.3, "LElbowRoll": -0.8, "RShoulderRoll": -0.3}
    target = frame_pose(pepper, pepper.joint_vector(arm | {"LShoulderPitch": -0.5}), "LArm_effector")[:3, 3]
    beside = target + np.array([0.0, 0.5, 0.0])
    scene = pk.Scene().add_box("box 1", (0.16, 0.16, 0.16), beside)

    def go(page: Any) -> None:
        _until(page, "pepperKin.values.obstacles?.length === 1")
        page.locator("[data-view=front]").click()  # a drag stays in the plane of the screen
        page.locator("#go").click()
        _until(page, "pepperKin.values.q[5] < 0.7")
        (x, y), (left, top) = (page.evaluate(ON_SCREEN, place.tolist()) for place in (beside, target))
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(left, top, steps=5)
        page.mouse.up()
        _until(page, "document.getElementById('message').textContent.includes('box 1')")
        page.locator("[data-view=three-quarter]").click()

    with pk.Viewer(pepper, port=0).add_scene(scene) as viewer:
        address = viewer.show(pepper.joint_vector(arm))
        viewer.follow(False).move_target("left hand", target)
        save_small(_photographed(address, go), "live_go.png")


def draw_log_page() -> None:
    """The page of `pepper-kin check log` where somebody or something held the robot's arm."""
    pepper = pk.load_pepper()
    log = pk.identification.read_log(LOGS / "person_a_session_1.csv.xz")
    with tempfile.TemporaryDirectory() as folder:
        found = pk.identification.replay(pepper, log)
        page = pk.Viewer(pepper).save_html(Path(folder) / "log.html", found, title=log.name)
        save_small(_photographed(f"{page.as_uri()}#t=112.5", lambda page: None), "log_page.png")


def _photographed(address: str, do: Callable[[Any], None]) -> Image.Image:
    """Let a browser open a page, and do something there."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = [flag for flag in CHROMIUM_FLAGS if flag != "--headless"]
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=arguments)
        page = browser.new_page(viewport={"width": 1120, "height": 720})
        page.set_default_timeout(300_000)
        page.goto(address)
        _until(page, "window.pepperKin !== undefined")
        do(page)
        time.sleep(1.0)  # until the page has the new state
        _until(page, "(pepperKin.quality?.settled ?? true) && !pepperKin.viewer.needs_render")  # drawn finely
        drawn = page.screenshot(timeout=300_000)
        browser.close()
    return Image.open(io.BytesIO(drawn)).convert("RGB")


def _press_plan(page: Any) -> None:
    """Press Plan, wait for the motion and scrub to its middle."""
    _until(page, "pepperKin.connected")
    page.locator("#plan").click()
    _until(page, "pepperKin.values.play !== null")
    page.locator("#scrub").evaluate(SCRUB)


def _until(page: Any, condition: str) -> None:
    """Wait until a page meets a condition; playwright's own waiting needs eval, which pages forbid."""
    deadline = time.monotonic() + 600
    while not page.evaluate(condition):
        if time.monotonic() > deadline:
            raise TimeoutError(f"the live page never reached: {condition}")
        time.sleep(0.1)
