"""Pictures of the examples about dynamics: 02, 04, 09, 15."""

from __future__ import annotations

import numpy as np

import pepper_kin as pk

from .camera import framing
from .examples import variables_of
from .sheet import COLORS, Sheet
from .stage import BLUE, ORANGE, Stage


def draw_02_check_dynamics() -> None:
    """Torques beside the differences that the check finds, on one logarithmic scale."""
    example = variables_of("02")
    pepper, q, v, a, tau = (example[name] for name in ("pepper", "q", "v", "a", "tau"))
    against = np.abs(tau - pk.dynamics.newton_euler(pepper, q, v, a))
    back = np.abs(pk.dynamics.forward_dynamics(pepper, q, v, tau) - a)
    sheet = Sheet()
    plot = sheet.axes(72, 70, 715, 325)
    columns = np.arange(pepper.n)
    shown = (
        ("torque", np.abs(tau), "blue"),
        ("forward(inverse(a)) - a", back, "green"),
        ("RNEA - Newton-Euler", against, "orange"),
    )
    for label, values, color in shown:
        low, middle, high = np.quantile(np.maximum(values, 1e-18), [0.1, 0.5, 1.0], axis=0)
        plot.vlines(columns, low, high, color=COLORS[color], linewidth=3, alpha=0.4)
        plot.plot(columns, middle, "o", color=COLORS[color], markersize=4.5, label=label)
    plot.axhline(1e-9, color=COLORS["gray"], linestyle="--", linewidth=1)
    words, gray = "tolerance of the example", COLORS["gray"]
    plot.text(pepper.n - 0.6, 1.5e-9, words, ha="right", fontsize=9, color=gray)
    plot.set_yscale("log")
    plot.set(ylim=(1e-18, 1e4), xlim=(-0.7, pepper.n - 0.3))
    plot.set_xticks(columns, pepper.joint_names, rotation=60, ha="right", fontsize=8)
    plot.grid(axis="x", visible=False)
    plot.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=9, handletextpad=0.2)
    plot.set_ylabel("N m, N; rad/s², m/s²", labelpad=-2)
    sheet.text(
        400, 12, "100 random states: a dot for the middle, a bar up to the worst", ha="center", fontsize=12
    )
    sheet.save("example_02.png")


def draw_04_any_robot() -> None:
    """The two-link arm in three postures, and the torques that hold it at all angles."""
    example = variables_of("04")
    robot = example["robot"]
    sheet = Sheet((800, 400))
    arm = sheet.axes(60, 45, 330, 300)
    for angle, opacity in ((0.0, 1.0), (0.7, 0.45), (-0.6, 0.45)):
        q = np.array([angle, -0.4 * np.sign(angle)])
        joints = np.array([pk.kinematics.frame_pose(robot, q, link)[:3, 3] for link in ("upper", "lower")])
        tip = pk.kinematics.frame_pose(robot, q, "lower") @ [0.5, 0.0, 0.0, 1.0]
        line = np.array([*joints, tip[:3]])
        arm.plot(
            line[:, 0], line[:, 2], color=COLORS["blue"], linewidth=9, alpha=opacity, solid_capstyle="round"
        )
        arm.plot(line[:2, 0], line[:2, 2], "o", color="white", markersize=5, alpha=opacity)
    torque = example["torque"]
    for x, words in ((0.0, f"{torque[0]:.2f} N m"), (0.5, f"{torque[1]:.2f} N m")):
        arm.annotate(words, (x, 1.0), (x + 0.03, 1.17), ha="center", arrowprops={"arrowstyle": "->"})
    arm.set(aspect="equal", xlim=(-0.15, 1.15), ylim=(0.4, 1.55), xlabel="x [m]", ylabel="z [m]")
    arm.set_title("torques that hold against gravity")
    turns = np.linspace(-2.0, 2.0, 200)
    needed = pk.dynamics.gravity_torque(robot, np.stack([turns, 0 * turns], axis=1))
    plot = sheet.axes(465, 45, 320, 290)
    plot.plot(np.degrees(turns), needed[:, 0], color=COLORS["blue"], label="shoulder")
    plot.plot(np.degrees(turns), needed[:, 1], color=COLORS["orange"], label="elbow")
    plot.plot([0, 0], torque, "o", color="#26323f", markersize=5)
    plot.set(xlabel="shoulder [degree], elbow stretched", ylabel="N m", title="torque that holds the arm")
    plot.legend()
    sheet.save("example_04.png")


def draw_09_gradients() -> None:
    """The arm before and after, with the palm at one point, and what each motor has to hold."""
    example = variables_of("09")
    pepper, q0, relaxed = example["pepper"], example["q0"], example["relaxed"]
    size = (430, 500)
    stage = Stage().robot(pepper, relaxed).robot(pepper, q0, color=ORANGE, opacity=0.35, apart_from=relaxed)
    stage.ball(example["target"], BLUE, 0.02)
    around = np.array([[x, y, z] for x in (-0.12, 0.15) for y in (-0.25, 0.28) for z in (0.45, 1.24)])
    camera = framing([*around, example["target"]], size, 48, 8, margin=1.0)
    sheet = Sheet().image(stage.picture(camera))
    sheet.label(camera, example["target"], "the palm stays", (-20, -70))
    shares = np.stack([example["before"], example["after"]], axis=1)
    kept = np.flatnonzero(shares.max(axis=1) > 0.01)
    plot = sheet.axes(560, 50, 220, 385)
    rows = np.arange(len(kept))[::-1]
    plot.barh(rows + 0.19, 100 * shares[kept, 0], 0.36, color=COLORS["orange"], label="before", alpha=0.75)
    plot.barh(rows - 0.19, 100 * shares[kept, 1], 0.36, color=COLORS["blue"], label="after")
    plot.set_yticks(rows, [pepper.joint_names[k] for k in kept], fontsize=9)
    plot.set(xlabel="% of the motor's torque", title="to hold the posture")
    plot.grid(axis="y", visible=False)
    plot.legend(loc="lower right")
    sheet.save("example_09.png")


def draw_15_randomized_twins() -> None:
    """The spread of the hand's error over time, and what tells it."""
    example = variables_of("15")
    times, errors = example["run"].time, 1000 * example["errors"]
    sheet = Sheet((800, 400))
    plot = sheet.axes(60, 45, 390, 300)
    for low, high, opacity in ((0.0, 1.0, 0.15), (0.05, 0.95, 0.25), (0.25, 0.75, 0.45)):
        lower, upper = np.quantile(errors, [low, high], axis=0)
        name = {0.0: "all", 0.05: "nine of ten", 0.25: "half"}[low]
        plot.fill_between(times, lower, upper, color=COLORS["blue"], alpha=opacity, linewidth=0, label=name)
    plot.plot(times, errors[0], color=COLORS["orange"], linewidth=1.4, label="as described")
    plot.set(xlabel="s", ylabel="mm", xlim=(0, times[-1]), ylim=(0, None))
    plot.set_title(f"{len(errors)} Peppers wave: error of the hand")
    plot.legend(loc="upper right", ncols=2, fontsize=9)
    scatter_plot = sheet.axes(525, 45, 255, 300)
    colors = example["friction"][:, 0]
    dots = scatter_plot.scatter(example["payload"], 1000 * example["worst"], 9, c=colors, cmap="viridis")
    scatter_plot.set(xlabel="payload [kg]", ylabel="worst error [mm]", title="heavier hands, larger errors")
    sheet.figure.colorbar(dots, ax=scatter_plot, label="friction [N m]", pad=0.03, fraction=0.1, aspect=30)
    scatter_plot.get_figure().axes[-1].set_position((0.905, 0.14, 0.012, 0.75))
    scatter_plot.set_position((0.645, 0.14, 0.245, 0.75))
    sheet.save("example_15.png")
