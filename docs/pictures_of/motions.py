"""Pictures of the examples about motions: 10, 11, 12, 16 to 19, 22 to 26."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import pepper_kin as pk
from pepper_kin.learning import Oracle, PepperVectorEnv, imitate
from pepper_kin.model.shapes import Box
from pepper_kin.trajectory import Trajectory

from .album import gesture_album
from .camera import framing
from .examples import variables_of
from .sheet import COLORS, FOLDER, SIZE, Sheet
from .stage import GRAY, ORANGE, Stage

HAND = "LArm_effector"


def draw_10_gestures() -> None:
    """Six gestures at their height, and the hasty one where a limit slows it down."""
    example = variables_of("10", "--quick")
    pepper = example["pepper"]
    sheet = Sheet()
    names = ("wave", "point", "think", "shrug", "bow", "welcome")
    for column, (name, picture) in enumerate(
        zip(names, gesture_album(pepper, names, (130, 210)), strict=True)
    ):
        sheet.image(picture, 6 + 132 * column, 26)
        sheet.text(71 + 132 * column, 6, name, ha="center")
    head = pepper.joint_index("HeadYaw")
    limit = pepper.acceleration_limits[head]
    calm, hasty = example["calm"], example["hasty"]
    plots = [sheet.axes(left, 282, 305, 165) for left in (72, 475)]
    for motion, color, name in ((calm, "blue", "tempo 1"), (hasty, "orange", "tempo 4, amplitude 1.25")):
        times = np.linspace(0.0, motion.duration, 800)
        state = motion(times)
        plots[0].plot(times, state.position[:, head], color=COLORS[color], label=name)
        plots[1].plot(times, state.acceleration[:, head] / limit, color=COLORS[color], label=name)
    plots[0].set(xlabel="s", ylabel="HeadYaw [rad]", title="shake-head", xlim=(0, calm.duration))
    plots[0].set_ylim(-1.05, 0.65)
    plots[0].legend(fontsize=9, loc="lower right", bbox_to_anchor=(1.04, -0.03))
    plots[1].axhspan(1, 1.3, color=COLORS["gray"], alpha=0.2, linewidth=0)
    plots[1].axhspan(-1.3, -1, color=COLORS["gray"], alpha=0.2, linewidth=0)
    plots[1].set(xlabel="s", ylim=(-1.3, 1.3), xlim=(0, calm.duration), ylabel="share of its limit")
    plots[1].set_title("acceleration: slower where necessary")
    sheet.save("example_10.png")


def draw_11_files() -> None:
    """The animation as it was drawn and as it was made safe."""
    example = variables_of("11")
    pepper, imported = example["pepper"], example["imported"]
    head = pepper.joint_index("HeadYaw")
    limits = {
        "position": ("rad", pepper.upper_limits[head]),
        "velocity": ("rad/s", pepper.velocity_limits[head]),
        "acceleration": ("rad/s²", pepper.acceleration_limits[head]),
    }
    sheet = Sheet()
    for row, (quantity, (unit, limit)) in enumerate(limits.items()):
        plot = sheet.axes(90, 44 + 150 * row, 690, 112)
        motions = (("as drawn", imported.original, "orange"), ("made safe", imported.trajectory, "blue"))
        peak = 0.0
        for name, motion, color in motions:
            times = np.linspace(0.0, motion.duration, 3000)
            values = getattr(motion(times), quantity)[:, head]
            peak = max(peak, float(np.abs(values).max()))
            plot.plot(times, values, color=COLORS[color], label=name)
        top = 1.5 * max(peak, limit)
        if row:  # evenly spaced within the limits, by powers of ten beyond
            plot.set_yscale("symlog", linthresh=limit)
            powers = [10.0**k for k in range(1 + row, 4) if 1.3 * limit < 10**k < top]
            plot.set_yticks([-limit, 0, limit, *powers, *(-x for x in powers)])
            plot.yaxis.set_major_formatter("{x:.3g}")
        plot.axhspan(limit, top, color=COLORS["gray"], alpha=0.2, linewidth=0)
        plot.axhspan(-top, -limit, color=COLORS["gray"], alpha=0.2, linewidth=0)
        plot.set(ylim=(-top, top), xlim=(0, imported.trajectory.duration), ylabel=f"{quantity}\n[{unit}]")
        plot.tick_params(labelbottom=row == 2, labelsize=9)
        plot.yaxis.set_label_coords(-0.075, 0.5)
        if row == 0:
            plot.legend(ncols=2, loc="upper right", fontsize=9)
            plot.set_title("HeadYaw of an animation with abrupt turns: gray is beyond the limits")
    plot.set_xlabel("s", labelpad=0)
    sheet.save("example_11.png")


def draw_12_carry_a_tray() -> None:
    """The tray's path around the post, and its tilt with and without the constraint."""
    example = variables_of("12")
    pepper, q, poses = example["pepper"], example["q"], example["poses"]
    size = (470, 500)
    stage = Stage().scene(example["scene"]).robot(pepper, q[-1])
    stage.robot(pepper, q[0], color=GRAY, opacity=0.22, apart_from=q[-1])
    stage.tube(poses[:: max(1, len(poses) // 150), :3, 3])
    for share in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        pose = poses[round(share * (len(poses) - 1))].copy()
        pose[:3, 3] += 0.045 * pose[:3, 2]  # on the hand
        stage.add(Box((0.14, 0.11, 0.008)), pose, (*ORANGE[:3], 1.0 if share == 1.0 else 0.4))
    around = np.array([[x, y, z] for x in (-0.1, 0.4) for y in (-0.25, 0.4) for z in (0.55, 1.22)])
    camera = framing(around, size, 40, 22, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    sheet.label(camera, [0.33, 0.17, 1.3], "post", (45, 20))
    sheet.label(camera, poses[0, :3, 3], "start", (35, -60))
    free = example["free"].path
    spline = pk.trajectory.path.as_cubic_path(pepper, free)
    segments = np.repeat(np.arange(len(spline.breaks) - 1), 60)
    within = np.tile(np.linspace(0.0, 1.0, 60), len(spline.breaks) - 1) * np.diff(spline.breaks)[segments]
    tipped = pk.kinematics.frame_pose(pepper, spline.at(segments, within), HAND)[:, 2, 2]
    plot = sheet.axes(535, 60, 245, 370)
    for values, color, name in (
        (np.degrees(np.arccos(np.clip(tipped, -1, 1))), "gray", "without the constraint"),
        (np.degrees(example["tilts"]), "orange", "with it"),
    ):
        plot.plot(np.linspace(0, 100, len(values)), values, color=COLORS[color], label=name)
    plot.axhline(np.degrees(example["tilt"]), color="#26323f", linestyle="--", linewidth=1)
    plot.text(99, np.degrees(example["tilt"]) + 0.4, "limit 5°", ha="right", fontsize=9)
    plot.set(xlabel="% of the path", ylabel="tilt [degree]", title="tilt of the tray", ylim=(0, 75))
    plot.legend(fontsize=9, loc="upper center")
    sheet.save("example_12.png")


def draw_16_live_target() -> None:
    """The three targets, the hand's path to them, and the last posture."""
    example = variables_of("16")
    pepper, path, heard = example["pepper"], np.array(example["path"]), example["heard"]
    points = list(
        dict.fromkeys(tuple(float(x) for x in place) for name, place in heard if name == "left hand")
    )
    stage = Stage().scene(example["scene"]).robot(pepper, example["reached"])
    stage.robot(pepper, example["start"], color=GRAY, opacity=0.2, apart_from=example["reached"])
    stage.tube(smooth(path), ORANGE, 0.004)
    around = np.array([[x, y, z] for x in (-0.2, 0.72) for y in (-0.3, 0.3) for z in (0.5, 1.22)])
    camera = framing(around, SIZE, 35, 16, margin=1.0)
    for point in points:
        stage.ball(point, ORANGE, 0.018)
    sheet = Sheet().image(stage.picture(camera))
    for k, (point, offset) in enumerate(zip(points, ((90, -35), (-80, -40), (-60, 60)), strict=False)):
        sheet.label(camera, point, f"target {k + 1}", offset)
    sheet.text(20, 20, 'viewer.move_target("left hand", point)', family="monospace", fontsize=11)
    sheet.save("example_16.png")


def smooth(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out points of a path that are nearer than 2 mm to the one before."""
    kept = [path[0]]
    for point in path[1:]:
        if np.linalg.norm(point - kept[-1]) > 0.002:
            kept.append(point)
    return np.array(kept)


def draw_17_jerk_limits() -> None:
    """The hardest joint's acceleration over time, for each timing."""
    example = variables_of("17")
    pepper = example["pepper"]
    timings: dict[str, Trajectory] = example["timings"]
    sheet = Sheet()
    longest = max(trajectory.duration for trajectory in timings.values())
    joint = pepper.joint_index("RElbowRoll")
    shades = ("orange", "violet", "blue", "green")
    for row, ((name, trajectory), color) in enumerate(zip(timings.items(), shades, strict=True)):
        plot = sheet.axes(85, 42 + 110 * row, 695, 84)
        times = np.linspace(0.0, trajectory.duration, 3000)
        share = trajectory(times).acceleration[:, joint] / pepper.acceleration_limits[joint]
        plot.fill_between(times, share, color=COLORS[color], alpha=0.25, linewidth=0)
        plot.plot(times, share, color=COLORS[color])
        plot.set(xlim=(0, 1.02 * longest), ylim=(-1.1, 1.1), yticks=(-1, 0, 1), ylabel=name)
        plot.axvline(trajectory.duration, color="#26323f", linewidth=1)
        plot.text(trajectory.duration - 0.006, 0.62, f"{trajectory.duration:.2f} s", ha="right", fontsize=9)
        plot.tick_params(labelbottom=row == 3)
        if row == 0:
            plot.set_title("RElbowRoll: acceleration as a share of its limit, for each jerk limit")
    plot.set_xlabel("s", labelpad=0)
    sheet.save("example_17.png")


def draw_18_soft_costs() -> None:
    """The hand's path past the plate, with the cost and without."""
    example = variables_of("18")
    pepper, plate, ways = example["pepper"], example["plate"], example["ways"]
    size = (470, 500)
    q, places, lengths = ways["with"]
    stage = Stage().scene(example["scene"]).robot(pepper, q[-1])
    stage.robot(pepper, q[0], color=GRAY, opacity=0.22, apart_from=q[-1])
    stage.tube(smooth(ways["without"][1]), GRAY, 0.005)
    stage.tube(smooth(places), ORANGE, 0.005)
    stage.ball(plate, (0.85, 0.2, 0.15, 0.5), 0.06)
    around = np.array([[x, y, z] for x in (-0.1, 0.5) for y in (-0.25, 0.4) for z in (0.55, 1.22)])
    camera = framing(around, size, 40, 22, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    sheet.label(camera, plate, "hot", (60, 40))
    plot = sheet.axes(535, 60, 245, 370)
    for name, color in (("without", "gray"), ("with", "orange")):
        _, places, lengths = ways[name]
        price = 12 * np.exp(-np.sum((places - plate) ** 2, axis=1) / (2 * 0.06**2))
        plot.plot(100 * lengths / lengths[-1], price, color=COLORS[color], label=f"{name} the cost")
    plot.set(xlabel="% of the path", ylabel="cost", title="cost of the heat", ylim=(0, 9.5))
    plot.legend(fontsize=9, loc="upper left")
    sheet.save("example_18.png")


def draw_19_smooth_plan() -> None:
    """Speed and acceleration of two joints, along the retimed plan and the optimized one."""
    example = variables_of("19")
    pepper, timings = example["pepper"], (("retimed", example["retimed"]), ("optimized", example["motion"]))
    sheet = Sheet()
    longest = max(trajectory.duration for _, trajectory in timings)
    for row, name in enumerate(("HipPitch", "LShoulderPitch")):
        joint = pepper.joint_index(name)
        limits = pepper.velocity_limits[joint], pepper.acceleration_limits[joint]
        for column, quantity in enumerate(("speed", "acceleration")):
            plot = sheet.axes(72 + 400 * column, 42 + 220 * row, 310, 165)
            for (label, trajectory), color in zip(timings, ("orange", "blue"), strict=True):
                times = np.linspace(0.0, trajectory.duration, 2000)
                state = trajectory(times)
                share = (state.velocity, state.acceleration)[column][:, joint] / limits[column]
                plot.plot(times, share, color=COLORS[color], label=label)
            plot.set(xlim=(0, 1.02 * longest), ylim=(-1.1, 1.1), yticks=(-1, 0, 1))
            plot.set_title(f"{name}: share of the limit of {quantity}", fontsize=10)
            if row == 1:
                plot.set_xlabel("s", labelpad=0)
            elif column == 0:
                plot.legend(frameon=False, loc="lower left")
    sheet.save("example_19.png")


def draw_20_naoqi_script() -> None:
    """Commanded and measured angles of two joints, and the way of the base before the wall."""
    example = variables_of("20")
    run = example["run"]
    sheet = Sheet()
    titles = {
        "HeadYaw": "head yaw [rad]",
        "RShoulderPitch": "right shoulder pitch [rad]",
        "BaseX": "base x [m]",
    }
    for row, (name, title) in enumerate(titles.items()):
        joint = run.joint_names.index(name)
        plot = sheet.axes(72, 36 + 148 * row, 710, 105)
        plot.plot(run.time, run.reference_position[:, joint], color=COLORS["gray"], label="commanded", lw=3)
        plot.plot(run.time, run.position[:, joint], color=COLORS["orange"], label="measured")
        plot.set(xlim=(0, run.duration))
        plot.set_title(title, fontsize=10, loc="left")
        if row == 0:
            plot.legend(frameon=False, fontsize=9, loc="upper right")
        if row == 2:
            plot.set_xlabel("s", labelpad=0)
    sheet.save("example_20.png")


def draw_21_ros_client() -> None:
    """Commanded and measured angles of the left arm while a client's motion is followed."""
    example = variables_of("21")
    run, names = example["run"], ("LShoulderPitch", "LElbowYaw", "LElbowRoll")
    rows = [run.joint_names.index(name) for name in names]
    moves = np.flatnonzero(np.abs(np.diff(run.reference_position[:, rows], axis=0)).max(axis=1) > 1e-9)
    shown = slice(max(moves[0] - 10, 0), moves[-1] + 25)
    time = run.time[shown] - run.time[moves[0]]
    sheet = Sheet()
    for row, (name, joint) in enumerate(zip(names, rows, strict=True)):
        plot = sheet.axes(72, 36 + 148 * row, 710, 105)
        commanded, measured = run.reference_position[shown, joint], run.position[shown, joint]
        plot.plot(time, commanded, color=COLORS["gray"], label="commanded", lw=3)
        plot.plot(time, measured, color=COLORS["orange"], label="measured")
        plot.set(xlim=(time[0], time[-1]))
        plot.set_title(f"{name} [rad]", fontsize=10, loc="left")
        if row == 0:
            plot.legend(frameon=False, fontsize=9, loc="upper right")
        if row == 2:
            plot.set_xlabel("s", labelpad=0)
    sheet.save("example_21.png")


def draw_22_live_motion() -> None:
    """Angle of the shoulder, and the distance to the ball, with the time in which the robot waited."""
    example = variables_of("22")
    times, gave_way = np.array(example["times"]), example["waits"]
    joint = example["pepper"].joint_index("LShoulderPitch")
    lines = {
        "left shoulder pitch [rad]": np.array(example["positions"])[:, joint],
        "distance to the ball [m]": np.array(example["gaps"]),
    }
    sheet = Sheet()
    for row, (title, values) in enumerate(lines.items()):
        plot = sheet.axes(72, 36 + 222 * row, 710, 175)
        for state in gave_way:
            plot.axvspan(state.begin, state.begin + example["PERIOD"], color=COLORS["gray"], alpha=0.3, lw=0)
        plot.plot(times, values, color=COLORS["orange"])
        plot.set(xlim=(0, times[-1]))
        plot.set_title(title, fontsize=10, loc="left")
        if row == 1:
            plot.set(ylim=(0, None))
            plot.set_xlabel("s; gray: it stops or waits", labelpad=0)
    sheet.save("example_22.png")


def draw_23_follow_a_path() -> None:
    """The hand's path of the example with the robot at its begin, and the hand's speed over time."""
    example = variables_of("23")
    pepper, motion = example["pepper"], example["motion"]
    size = (450, 500)
    stage = Stage().robot(pepper, motion.start)
    stage.tube(example["route"](np.linspace(0.0, example["route"].length, 200)), ORANGE, 0.004)
    around = np.array([[x, y, z] for x in (-0.2, 0.5) for y in (-0.3, 0.5) for z in (0.6, 1.25)])
    sheet = Sheet().image(stage.picture(framing(around, size, 40, 18, margin=1.0)))
    plot = sheet.axes(520, 60, 265, 370)
    plot.plot(example["times"], example["speeds"], color=COLORS["orange"])
    plot.set(
        xlabel="s", title="speed of the hand [m/s], three laps", xlim=(0, motion.duration), ylim=(0, None)
    )
    sheet.save("example_23.png")


def draw_26_retarget() -> None:
    """The person's key points beside the robot at three times, and how far its limbs are off."""
    example = variables_of("26")
    pepper, found, points = example["pepper"], example["found"], example["points"]
    place = dict(zip(example["place"], 0.75 * np.moveaxis(points, 1, 0) + [0.0, 0.75, 0.0], strict=True))
    bones = [("RShoulder", "LShoulder"), ("RHip", "LHip"), ("right_ear", "nose"), ("left_ear", "nose")]
    for side in "RL":
        bones += [(side + "Hip", side + "Shoulder"), (side + "Shoulder", side + "Elbow")]
        bones += [(side + "Elbow", side + "Wrist")]
    around = np.array([[x, y, z] for x in (-0.1, 0.3) for y in (-0.45, 1.15) for z in (0.55, 1.35)])
    size, sheet = (266, 235), Sheet()
    clock = np.concatenate([[0.0], np.cumsum(np.diff(found.times) / found.speed[1:])]) + found.times[1]
    for column, time in enumerate((1.2, 3.0, 3.6)):
        frame = int(np.searchsorted(example["times"], time))
        q = found.trajectory(float(np.interp(time, found.times, clock))).position
        stage = Stage().robot(pepper, q)
        for ends in bones:
            stage.tube([place[name][frame] for name in ends], ORANGE, 0.015)
        sheet.image(stage.picture(framing(around, size, 12, 8, margin=1.0)), 266 * column, 20)
        sheet.text(266 * column + 133, 4, f"{time} s", ha="center")
    plot = sheet.axes(60, 300, 710, 150)
    for limb, error in zip(
        ("left upper arm", "left forearm", "right upper arm", "right forearm"), found.errors.T, strict=True
    ):
        plot.plot(found.times, np.degrees(error), label=limb)
    plot.set(xlim=(0, found.times[-1]), ylim=(0, 25), title="angle between a limb and the person's [degrees]")
    plot.set_xlabel("time of the person [s]", labelpad=0)
    plot.legend(ncols=2)
    sheet.save("example_26.png")


def draw_24_imitate_reach() -> None:
    """Shares of goals reached in each round, in which the network acts ever more, and after them."""
    example = variables_of("24")
    curve = np.array(example["curve"])
    sheet = Sheet()
    plot = sheet.axes(80, 60, 690, 370)
    plot.plot(
        np.arange(1, curve.size + 1), curve, color=COLORS["orange"], marker="o", label="goals of training"
    )
    plot.axhline(example["best"], color=COLORS["gray"], linestyle="--", label="its teacher, new goals")
    plot.axhline(example["learned"], color=COLORS["orange"], linestyle=":", label="the network, new goals")
    plot.axvspan(1, 4.5, color=COLORS["gray"], alpha=0.2, lw=0)
    plot.set(xlabel="round; gray: its teacher acts, too", title="share of goals reached", ylim=(0.9, 1.005))
    plot.legend(fontsize=9, loc="lower right")
    sheet.save("example_24.png")


def draw_25_policy_on_robots() -> None:
    """How far the hand is from its goal over time on each robot, and the shares of goals reached."""
    example = variables_of("25")
    episodes, shares = example["episodes"], example["shares"]
    sheet = Sheet()
    plots = [sheet.axes(65, 60, 320, 370), sheet.axes(590, 60, 190, 370)]
    colors = [COLORS["gray"], *(COLORS[name] for name in ("blue", "orange", "green", "violet"))]
    for (name, found), color in zip(episodes.items(), colors[1:], strict=True):
        distances = 100 * np.median([episode.distances for episode in found], axis=0)
        plots[0].plot(0.02 * np.arange(1, distances.size + 1), distances, color=color, label=name)
    plots[0].axhspan(0, 5, color=COLORS["gray"], alpha=0.2, lw=0)
    plots[0].set(xlabel="s; gray: reached", title="hand to goal, median [cm]", xlim=(0, 1), ylim=(0, None))
    plots[0].legend(fontsize=9)
    names = list(shares)[::-1]
    plots[1].barh(names, [shares[name] for name in names], color=colors[::-1])
    plots[1].set(xlim=(0, 1), xticks=(0, 0.5, 1), title="share of goals reached")
    sheet.save("example_25.png")


def draw_27_make_data_set() -> None:
    """The ways of the hand in all motions, two postures at their ends, and one of the tables."""
    example = variables_of("27", "--rows", "96")
    pepper, motions = pk.load_pepper(), example["solved"]
    stage = Stage().scene(pk.collision.scene_file.scene_from_dict(example["job"].scenes[0], "job", pk.Scene))
    paths = [pk.kinematics.frame_pose(pepper, row["position"], HAND)[:, :3, 3] for row in motions]
    for path in paths:
        stage.tube(path, ORANGE, 0.003)
    for k in (0, len(motions) // 2):
        stage.robot(pepper, motions[k]["position"][-1], opacity=1.0 if k == 0 else 0.3)
    camera = framing([*np.concatenate(paths), (0.0, 0.0, 1.2), (0.6, 0.4, 0.7)], SIZE, 50, 14)
    sheet = Sheet().image(stage.picture(camera))
    sheet.text(20, 20, f"{len(motions)} of {len(example['motions'])} motions made and certified", fontsize=12)
    sheet.text(20, 44, "ways of the left hand, past a table\nthat stands elsewhere in each")
    sheet.save("example_27.png")


def draw_learning_frames() -> None:
    """What an environment's `render` returns in an episode of both hands, by its oracle."""
    env = PepperVectorEnv(1, "ReachBoth", render_mode="rgb_array")
    env.reset(seed=7)
    oracle, frames = Oracle(env), []
    for step in range(28):
        if step % 9 == 0:
            frames.extend(env.render() or ())
        env.step(oracle())
    Image.fromarray(np.concatenate(frames, axis=1)).save(FOLDER / "learning_frames.png", optimize=True)


def draw_learning_policy() -> None:
    """Film four episodes of a policy that imitated for some seconds, at goals that it never saw."""
    policy = imitate(PepperVectorEnv(256, "ReachBoth", autoreset_mode="SameStep"), rounds=8)
    env = PepperVectorEnv(1, "ReachBoth", goal_seed=1, autoreset_mode="SameStep", render_mode="rgb_array")
    observations, _ = env.reset(seed=2)
    frames = []
    for step in range(4 * env.task.horizon):
        if step % 5 == 0:
            frames.append(Image.fromarray(env.render()[0]).quantize(64, Image.Quantize.MAXCOVERAGE))
        observations, *_ = env.step(policy(observations))
    path = FOLDER / "learning_policy.gif"
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=100, loop=0, optimize=True)


def draw_learning_tasks() -> None:
    """Draw six tasks while their oracles do them."""
    found = []
    steps = {"ReachClear": 60, "Follow": 60, "Carry": 30, "Push": 45, "Balance": 80, "Drive": 300}
    for name, count in steps.items():
        env = PepperVectorEnv(1, name, autoreset_mode="Disabled", render_mode="rgb_array")
        env.reset(seed=3)
        oracle = Oracle(env)
        for _ in range(count):
            env.step(oracle())
        found.append(env.render()[0])
    rows = [np.concatenate(found[k : k + 3], axis=1) for k in (0, 3)]
    Image.fromarray(np.concatenate(rows)).save(FOLDER / "learning_tasks.png", optimize=True)
