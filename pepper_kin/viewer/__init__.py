"""Pictures of the robot: a live page, recordings that need no server, images."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.viewer.browser import find_chromium, screenshot
    from pepper_kin.viewer.camera import Camera
    from pepper_kin.viewer.drawable import Drawable, marker
    from pepper_kin.viewer.joint_motion import JointMotion
    from pepper_kin.viewer.reach_page import save_reach_html
    from pepper_kin.viewer.recording import write_motion_page
    from pepper_kin.viewer.rendering import render_motion
    from pepper_kin.viewer.video import write_video
    from pepper_kin.viewer.viewer import Viewer

__all__ = [
    "Camera",
    "Drawable",
    "JointMotion",
    "Viewer",
    "find_chromium",
    "marker",
    "render_motion",
    "save_reach_html",
    "screenshot",
    "write_motion_page",
    "write_video",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "find_chromium": "browser",
        "screenshot": "browser",
        "Camera": "camera",
        "Drawable": "drawable",
        "marker": "drawable",
        "JointMotion": "joint_motion",
        "save_reach_html": "reach_page",
        "write_motion_page": "recording",
        "render_motion": "rendering",
        "write_video": "video",
        "Viewer": "viewer",
    },
)
