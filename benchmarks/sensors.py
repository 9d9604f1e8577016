"""Sensors: what a reading costs, and rays beside MuJoCo's in the same run, as Markdown.

python benchmarks/sensors.py
python benchmarks/sensors.py --rounds 3    # a glance
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import mujoco
import numpy as np

import pepper_kin as pk
from pepper_kin.twin.sensors import Camera, RobotRays, SensorSuite

SECONDS = 2.0  # simulated, for the suite at its own rates


def medians(jobs: dict[str, Callable[[], object]], rounds: int) -> dict[str, tuple[float, float]]:
    """Median wall and processor time of each job [s], the jobs taken in turn."""
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()
    for _ in range(rounds):
        for name, job in jobs.items():
            wall, processor = time.perf_counter(), time.process_time()
            job()
            spent[name].append((time.perf_counter() - wall, time.process_time() - processor))
    return {name: tuple(np.median(rows, axis=0)) for name, rows in spent.items()}  # type: ignore[misc]


def rays_of_mujoco(pepper: pk.PepperModel, q: np.ndarray, origin: np.ndarray, directions: np.ndarray):
    """Return a function that casts the rays at the drawn body by MuJoCo, all in one call."""
    model = mujoco.MjModel.from_xml_string(pepper.export("mjcf"))
    model.geom_group[model.geom_type != mujoco.mjtGeom.mjGEOM_MESH] = 5
    data = mujoco.MjData(model)
    for name, value in zip(pepper.joint_names, q, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = value
    groups, count = np.array([1, 1, 1, 1, 1, 0], dtype=np.uint8), len(directions)
    geom, distance = np.empty(count, dtype=np.int32), np.empty(count)

    def cast() -> np.ndarray:
        mujoco.mj_kinematics(model, data)
        arguments = [groups, 1, -1, geom, distance]
        if "normal" in (mujoco.mj_multiRay.__doc__ or ""):
            arguments.append(None)
        mujoco.mj_multiRay(model, data, origin, directions.ravel(), *arguments, count, 100.0)
        return distance

    return cast


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    pepper = pk.load_pepper()
    scene = (
        pk.Scene()
        .add_box("table", (0.6, 1.0, 0.04), (0.9, 0.0, 0.7))
        .add_sphere("ball", 0.08, (0.8, 0.1, 0.8))
        .add_box("wall", (0.1, 3.0, 2.0), (2.0, 0.0, 1.0))
    )
    q = pepper.joint_vector({"HeadPitch": 0.3, "LShoulderPitch": 0.3, "LElbowRoll": -1.0})
    suite, timed, clock = SensorSuite(pepper), SensorSuite(pepper), iter(range(10**6))

    def everything() -> None:
        k = next(clock)
        suite.read(float(k), q + 1e-6 * k, scene=scene)

    def at_their_rates() -> None:
        timed.reset()
        for step in range(int(SECONDS * 1000)):
            timed.read(step * 0.001, q, scene=scene)

    depth, color = Camera(pepper, "camera_depth"), Camera(pepper, "camera_top")
    grid = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 320), np.linspace(-0.6, 0.6, 240)), -1).reshape(-1, 2)
    origin = np.array([1.5, 0.0, 0.7])
    directions = np.column_stack([-np.ones(len(grid)), grid])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    body = RobotRays(pepper, "visual", floor=False)
    theirs = rays_of_mujoco(pepper, q, origin, directions)
    jobs: dict[str, Callable[[], object]] = {
        f"{len(suite.names)} sensors read once, without cameras": everything,
        f"{SECONDS:g} s of 1 ms steps, each sensor at its rate": at_their_rates,
        "depth picture, 320 x 240": lambda: depth.depth(q, scene),
        "color picture, 320 x 240": lambda: color.color(q, scene),
        "76 800 rays at the drawn body": lambda: body.distances(q, None, origin, directions),
        "the same rays by MuJoCo": theirs,
    }
    found = medians(jobs, rounds)
    print("| job | wall | processor |\n|---|---|---|")
    for name, (wall, processor) in found.items():
        print(f"| {name} | {1000 * wall:.2f} ms | {1000 * processor:.2f} ms |")
    ours, other = body.distances(q, None, origin, directions), theirs()
    other = np.where(other < 0, np.inf, other)
    with np.errstate(invalid="ignore"):
        same = (ours == other) | (np.abs(ours - other) < 1e-5)
    print(f"\n{same.mean():.2%} of the rays agree to 1e-5 m; {np.isfinite(ours).mean():.1%} meet the body.")


if __name__ == "__main__":
    main()
