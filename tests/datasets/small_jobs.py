"""A small job of every kind."""

from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin.datasets import DatasetJob

TABLE = {
    "objects": [
        {"name": "table", "kind": "box", "size": [0.4, 0.8, 0.03], "position": [0.47, 0.05, 0.715]},
    ]
}
BOX = {"hand": "left", "lower": [0.3, 0.0, 0.78], "upper": [0.48, 0.3, 0.95]}


def write_log(path: Path, joint: str = "HeadYaw") -> Path:
    """Write a robot's log: a step of one joint, which is followed with a lag."""
    time = np.arange(0.0, 12.0, 0.05)
    command = np.where(time > 6.0, 0.4, 0.0)
    measured = 0.4 * np.clip((time - 6.2) / 0.5, 0.0, 1.0)
    rows = [f"{t:.3f},{c},{m:.6f}" for t, c, m in zip(time, command, measured, strict=True)]
    path.write_text(f"time,{joint}_command,{joint}_measured\n" + "\n".join(rows) + "\n")
    return path


def small_job(kind: str, folder: Path, **more) -> DatasetJob:
    """Return a job that takes a second or less."""
    motion = {"targets": BOX, "scenes": [TABLE], "rows": 4, "rows_per_shard": 2}
    options = {
        "ik": {**motion, "rows": 90, "rows_per_shard": 40, "planner": {"restarts": 4}},
        "reach_maps": {
            "rows": 3, "rows_per_shard": 2, "targets": {"samples": 3000, "resolution": 0.1},
        },
        "plans": {
            **motion, "targets": {**BOX, "start": "random"},
            "randomization": {"objects": {"table": [0.03, 0.03, 0.0]}},
        },
        "trajectories": {**motion, "targets": {**BOX, "lower": [0.3, 0.0, 0.70]}},  # some below the table
        "runs": {
            **motion, "rows": 2, "rows_per_shard": 1, "fps": 10.0,
            "sensors": ["joint_encoders", "imu_torso_gyroscope", "camera_top"],
            "randomization": {"twin": {"stiffness": [0.8, 1.2], "latency": [0.0, 0.02]}},
        },
        "demonstrations": {"rows": 5, "rows_per_shard": 2, "targets": {"task": "Reach"}},
    }  # fmt: skip
    if kind == "replays":
        logs = [write_log(folder / f"log{k}.csv", j) for k, j in enumerate(("HeadYaw", "LElbowRoll"))]
        options[kind] = {"rows": 2, "rows_per_shard": 1, "targets": {"logs": [str(p) for p in logs]}}
    return DatasetJob(kind=kind, seed=7, **{**options[kind], **more})


def pepper():
    return pk.load_pepper()
