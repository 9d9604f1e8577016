"""Pictures of the examples about the world around the robot: 13, 14."""

from __future__ import annotations

import numpy as np

import pepper_kin as pk
from pepper_kin.model.shapes import Box
from pepper_kin.twin.sensors import Camera as Eye

from .camera import framing
from .examples import variables_of
from .sheet import COLORS, Sheet
from .stage import BLUE, GRAY, Stage


def draw_13_push_a_box() -> None:
    """The parcel where it began and where it came to, the forces on it, and what the hand felt."""
    example = variables_of("13")
    pepper, world, parcel = example["pepper"], example["world"], example["parcel"]
    size = (470, 500)
    stage = Stage().scene(example["scene"]).robot(pepper, example["twin"].state.position)
    begin = np.eye(4)
    begin[:3, 3] = example["start"]
    box = Box((0.12, 0.16, 0.14))
    stage.add(box, parcel.pose, (0.93, 0.75, 0.30, 1.0)).add(box, begin, (*GRAY[:3], 0.22))
    for contact in world.contacts:
        force = np.asarray(contact.force)
        if np.linalg.norm(force) > 0.05 and "table" not in contact.names:
            sign = 1.0 if contact.names[0] == "parcel" else -1.0
            tip = np.asarray(contact.point)
            stage.arrow(tip - 0.11 * sign * force / np.linalg.norm(force), tip, BLUE, 0.006)
    around = np.array([[x, y, z] for x in (0.0, 0.75) for y in (-0.15, 0.4) for z in (0.55, 1.2)])
    camera = framing(around, size, 60, 20, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    sheet.label(camera, parcel.position + np.array([0.0, 0.0, 0.07]), "parcel", (0, 60))
    moved = parcel.position[0] - example["start"][0]
    sheet.label(
        camera, example["start"] + [-0.06, -0.08, -0.07], f"pushed by {100 * moved:.0f} cm", (-70, -90)
    )
    times = example["STEP"] * np.arange(700 - len(example["pushes"]), 700)
    plots = [sheet.axes(540, top, 240, 160) for top in (45, 275)]
    plots[0].plot(times, example["pushes"], color=COLORS["blue"])
    weight = example["FRICTION"] * example["MASS"] * example["GRAVITY"]
    plots[0].axhline(weight, color=COLORS["gray"], linestyle="--", linewidth=1)
    plots[0].text(times[-1], weight, "μ m g ", ha="right", va="bottom", fontsize=9, color=COLORS["gray"])
    plots[0].set(ylabel="N", title="the hand's force", ylim=(0, 1.5 * weight))
    plots[1].plot(times, example["ratios"], color=COLORS["orange"])
    plots[1].axhline(example["FRICTION"], color=COLORS["gray"], linestyle="--", linewidth=1)
    plots[1].set(xlabel="s", title="friction over normal force", ylim=(0, 1.5 * example["FRICTION"]))
    sheet.save("example_13.png")


def draw_14_sensors() -> None:
    """The robot before ball and wall, its color picture and its depth picture."""
    example = variables_of("14")
    pepper, scene, posture = example["pepper"], example["scene"], example["posture"]
    size = (400, 500)
    stage = Stage().robot(pepper, posture)
    stage.scene(scene)
    eye = example["camera"]
    seat = pk.kinematics.frame_pose(pepper, posture, eye.frame)[:3, 3]
    stage.tube(np.linspace(seat, [1.4, 0.0, 1.1], 2), BLUE, 0.004)
    around = np.array([[x, y, z] for x in (-0.2, 2.4) for y in (-0.1, 0.2) for z in (0.0, 1.5)])
    camera = framing(around, size, 112, 14, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    sheet.label(camera, [1.5, 0.0, 1.1], f"ball, {example['seen']:.2f} m deep", (-40, 60))
    color = Eye(pepper, "camera_top").color(posture, scene)
    depth = example["depth"]
    near, far = 1.2, float(np.nanmax(np.where(np.isfinite(depth), depth, np.nan)))
    frames = [sheet.axes(415, top, 280, 210) for top in (26, 272)]
    frames[0].imshow(color)
    shown = frames[1].imshow(depth, cmap="viridis_r", vmin=near, vmax=far, interpolation="nearest")
    frames[0].set_title("camera_top: color")
    frames[1].set_title("camera_depth: meters")
    for frame in frames:
        frame.set(xticks=[], yticks=[])
        frame.grid(False)
    bar = sheet.axes(712, 272, 12, 210)
    sheet.figure.colorbar(shown, cax=bar)
    sheet.save("example_14.png")
