"""Pictures of the examples that reach for something: 01, 03, 05, 06, 07, 08."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps

import pepper_kin as pk

from .camera import framing
from .examples import variables_of
from .sheet import COLORS, SIZE, Sheet
from .stage import BLUE, GRAY, GREEN, ORANGE, Stage

BODY = np.array([[x, y, z] for x in (-0.22, 0.22) for y in (-0.28, 0.28) for z in (0.0, 1.22)])
UPPER = np.array([[x, y, z] for x in (-0.15, 0.15) for y in (-0.28, 0.28) for z in (0.62, 1.24)])
HAND = "LArm_effector"


def draw_01_reach_and_look() -> None:
    """The way over the table: ghosts, the hand's trace, the target."""
    example = variables_of("01")
    pepper, point = example["pepper"], example["point"]
    q = example["trajectory"](np.linspace(0.0, example["trajectory"].duration, 80)).position
    stage = Stage().scene(example["scene"]).robot(pepper, q[-1]).ball(point)
    for k in (0, 30, 50):
        stage.robot(pepper, q[k], color=ORANGE, opacity=0.16, apart_from=q[-1])
    stage.tube(pk.kinematics.frame_pose(pepper, q, HAND)[:, :3, 3])
    camera = framing([*BODY, [0.67, -0.35, 0.7], [0.67, 0.45, 0.7]], SIZE, 72, 12, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    eyes = pk.kinematics.frame_pose(pepper, q[-1], "CameraTop_frame")[:3, 3]
    sheet.label(camera, point, "target of hand and gaze", (-120, 60))
    sheet.label(camera, eyes, "looks at it", (-110, 40))
    sheet.label(camera, pk.kinematics.frame_pose(pepper, q[20], HAND)[:3, 3], "path of the hand", (130, -50))
    sheet.save("example_01.png")


def draw_03_unreachable() -> None:
    """How far the hand gets, and what is left to the target."""
    example = variables_of("03")
    pepper, target, palm = example["pepper"], example["target"], example["palm"]
    stage = Stage().robot(pepper, example["result"].q).ball(target)
    for share in np.linspace(0.06, 0.94, 12):
        stage.ball(palm + share * (target - palm), ORANGE, 0.006)
    stage.robot(pepper, pepper.posture("Stand"), color=GRAY, opacity=0.14, apart_from=example["result"].q)
    camera = framing([*BODY, target + np.array([0.0, 0.0, 0.1])], SIZE, 68, 8)
    sheet = Sheet().image(stage.picture(camera))
    gap = np.linalg.norm(target - palm)
    sheet.label(camera, (palm + target) / 2, f"{gap:.2f} m short", (0, -45))
    sheet.label(camera, target, "target", (0, 40))
    sheet.text(24, 20, f"{example['result'].status.name}: the nearest posture within every limit")
    sheet.save("example_03.png")


def draw_05_reach_map() -> None:
    """Both maps around the robot, cut open at its left shoulder, colored by manipulability."""
    example = variables_of("05")
    pepper = example["pepper"]
    sheet = Sheet()
    camera = framing([[x, 0.1, z] for x in (-0.9, 0.9) for z in (0.0, 1.4)], (400, 440), 66, 12, margin=1.0)
    for column, (title, found) in enumerate(
        (("arm alone", example["alone"]), ("with the torso", example["helped"]))
    ):
        stage = Stage().robot(pepper, pepper.posture("Stand"))
        best = found.best[found.counts > 0] / found.best.max()
        shades = np.minimum((best * 10).astype(int), 9)
        opened = found.centers[:, 1] < 0.12  # towards the viewer there is nothing in the way
        for shade in range(10):
            color = (*colormaps["viridis"]((shade + 0.5) / 10)[:3], 1.0)
            stage.cubes(found.centers[opened & (shades == shade)], 0.6 * found.resolution, color)
        sheet.image(stage.picture(camera), 400 * column)
        sheet.text(400 * column + 20, 18, f"{title}: {found.volume:.2f} m³", fontsize=12)
    bar = sheet.axes(230, 450, 340, 10)
    bar.imshow(np.linspace(0, 1, 200)[None], aspect="auto", extent=(0, 1, 0, 1), cmap="viridis")
    bar.set(yticks=[], xticks=[0, 0.5, 1])
    bar.tick_params(labelsize=8, pad=1)
    bar.set_xlabel("manipulability, share of the map's largest", labelpad=0, fontsize=9)
    bar.grid(False)
    sheet.save("example_05.png")


def draw_06_servo() -> None:
    """The circle that the hand draws, and how far off it is."""
    example = variables_of("06")
    pepper, path = example["pepper"], np.array(example["path"])
    size = (430, 500)
    stage = Stage().robot(pepper, path[600])
    hands = pk.kinematics.frame_pose(pepper, path[:801], HAND)[:, :3, 3]
    stage.tube(hands[::4], ORANGE, 0.004)
    stage.ball(example["point_on_circle"](6.0), BLUE, 0.014)
    camera = framing([*UPPER, *hands], size, 40, 10, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    sheet.label(camera, hands[330], "hand path", (-105, 75))
    times = 0.01 * np.arange(1, len(example["misses"]) + 1)
    off = sheet.axes(500, 50, 275, 165)
    off.semilogy(times, 1000 * np.array(example["misses"]), color=COLORS["orange"])
    off.axhline(0.5, color=COLORS["gray"], linewidth=1, linestyle="--")
    off.text(8, 0.55, "0.5 mm", ha="right", va="bottom", fontsize=9, color=COLORS["gray"])
    off.set(title="hand to moving point", ylabel="mm", xlim=(0, 8))
    hard = sheet.axes(500, 285, 275, 165)
    use = np.abs(np.diff(path, 2, axis=0)) * example["servo"].rate ** 2 / pepper.acceleration_limits
    hard.plot(0.01 * np.arange(1, len(path) - 1), use.max(axis=1), color=COLORS["blue"], linewidth=0.9)
    hard.axvline(8.0, color=COLORS["gray"], linewidth=1, linestyle="--")
    hard.text(7.9, 0.93, "no more commands", ha="right", va="top", fontsize=9, color=COLORS["gray"])
    hard.set(title="acceleration, share of its limit", xlabel="s", xlim=(0, None), ylim=(0, 1.05))
    sheet.save("example_06.png")


def draw_07_data_set() -> None:
    """Some of the targets, and postures that reach five of them."""
    example = variables_of("07", "--count", "4000")
    pepper, targets, found = example["pepper"], example["targets"], example["found"]
    stage = Stage()
    far = targets[targets[:, 1] < 0.12]  # nothing between the viewer and the postures
    height = np.clip((far[:, 2] - 0.25) / 1.1, 0.0, 0.999)
    shades = (height * 8).astype(int)
    for shade in range(8):
        color = (*colormaps["viridis"]((shade + 0.5) / 8)[:3], 1.0)
        stage.points(far[shades == shade], color, 0.008)
    front = np.flatnonzero(found.success & (targets[:, 0] > 0.25) & (targets[:, 1] > 0.0))
    rows = front[np.argsort(targets[front, 2])][np.linspace(20, len(front) - 20, 5).astype(int)]
    for k, row in enumerate(rows):
        stage.robot(pepper, found.q[row], opacity=1.0 if k == 2 else 0.25)
        stage.ball(targets[row], ORANGE, 0.028)
    camera = framing([*BODY, *targets[front]], SIZE, 64, 8, shift=(0.0, -0.03))
    sheet = Sheet().image(stage.picture(camera))
    sheet.text(20, 20, f"{found.success.mean():.2%} of {len(targets)} targets solved", fontsize=12)
    sheet.text(20, 44, "five of them, and the postures\nthat reach them")
    sheet.save("example_07.png")


def draw_08_base_placement() -> None:
    """The place found, both configurations, and the other places that would do."""
    example = variables_of("08")
    pepper, place = example["pepper"], example["place"]
    stage = Stage().scene(example["scene"])
    stage.robot(pepper, place.q[0], place=place.transform_base_to_world)
    stage.robot(
        pepper,
        place.q[1],
        place=place.transform_base_to_world,
        color=BLUE,
        opacity=0.28,
        apart_from=place.q[0],
    )
    stage.ball(example["cup"], ORANGE).ball(example["shelf"], BLUE)
    stage.robot(pepper, pepper.posture("Stand"), color=GRAY, opacity=0.3)
    here = place.transform_base_to_world
    way = np.linspace([0.25, 0.0, 0.012], [*(here[:2, 3] - 0.28 * here[:2, 0]), 0.012], 2)
    stage.arrow(*way, GREEN, 0.010)
    corners = [[2.3, -0.6, 0.7], [2.3, 0.6, 0.7], *(BODY + here[:3, 3]), *BODY]
    camera = framing(corners, SIZE, 40, 18, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    sheet.label(camera, example["cup"], "cup", (35, -55))
    sheet.label(camera, example["shelf"], "shelf", (50, 50))
    sheet.label(camera, [0.0, 0.0, 1.2], "where it stood", (0, 40))
    words = f"stand at x = {place.x:.2f} m, y = {place.y:.2f} m, turned by {np.degrees(place.yaw):.0f}°"
    sheet.text(20, 20, words, fontsize=12)
    sheet.save("example_08.png")
