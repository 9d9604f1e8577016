"""One picture for each gesture, all drawn by one browser."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

import pepper_kin as pk
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.recording import save_motion_page

from .camera import framing
from .stage import BLUE, ORANGE, pictures_of_page, tube_mesh

BODY = np.array([[x, y, z] for x in (-0.05, 0.25) for y in (-0.42, 0.42) for z in (0.0, 1.25)])
AWAY = np.diag([1.0, 1.0, 1.0, 1.0])
AWAY[2, 3] = -500.0  # deep below the floor, where no camera looks


def gesture_album(pepper: PepperModel, names: Sequence[str], size: tuple[int, int]) -> list[Image.Image]:
    """Draw gestures where they are farthest from Stand, with the traces of both hands.

    The page holds one instant for each gesture; traces of the others are out of sight then.
    """
    drawn = [Drawable.from_shape(shape) for shape in pepper.visual_shapes]
    links = list(dict.fromkeys(shape.link for shape in pepper.visual_shapes))
    postures, owners = [], []
    for number, name in enumerate(names):
        motion = pk.motion.gesture(pepper, name)
        q = motion(np.linspace(0.0, motion.duration, 200)).position
        away = np.linalg.norm((q - q[0]) / (pepper.upper_limits - pepper.lower_limits), axis=1)
        postures.append(q[int(np.argmax(away))])
        for frame, color in (("LArm_effector", ORANGE), ("RArm_effector", BLUE)):
            way = pk.kinematics.frame_pose(pepper, q, frame)[:, :3, 3]
            if np.ptp(way, axis=0).max() > 0.03:
                owners.append(number)
                drawn.append(Drawable("way", f"way {len(owners)}", tube_mesh(way, 0.007), np.eye(4), color))
    body = frame_poses(pepper, np.array(postures), links)
    traces = np.tile(AWAY, (len(names), len(owners), 1, 1))
    for column, owner in enumerate(owners):
        traces[owner, column] = np.eye(4)
    all_links = (*links, *(f"way {k + 1}" for k in range(len(owners))))
    poses = np.concatenate([body, traces], axis=1)
    times = np.arange(len(names), dtype=float)
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "album.html"
        save_motion_page(drawn, all_links, times, poses, page, title="album")
        return pictures_of_page(page, framing(BODY, size, 20, 8, margin=1.0), times)
