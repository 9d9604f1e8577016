"""Pictures of the robot: a live page, recordings without a server, images and videos.

    Viewer                                    a robot with scene and targets, live or saved
    JointMotion, Ghost, Note                  motions, a second robot drawn over the first, and captions
    Drawable, marker, Viewpoint               shapes and cameras
    render_motion                             a motion as page, video or image, by the file's suffix
    save_motion_page, save_reach_html, save_video, screenshot, find_chromium

Its package `server` runs the live page.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.viewer import server  # noqa: F401
    from pepper_kin.viewer.browser import find_chromium
    from pepper_kin.viewer.browser_session import screenshot
    from pepper_kin.viewer.camera import Viewpoint
    from pepper_kin.viewer.drawable import Drawable, marker
    from pepper_kin.viewer.joint_motion import Ghost, JointMotion, Note
    from pepper_kin.viewer.reach_page import save_reach_html
    from pepper_kin.viewer.recording import save_motion_page
    from pepper_kin.viewer.rendering import render_motion
    from pepper_kin.viewer.video import save_video
    from pepper_kin.viewer.viewer import Viewer

__all__ = [
    "Drawable",
    "Ghost",
    "JointMotion",
    "Note",
    "Viewer",
    "Viewpoint",
    "find_chromium",
    "marker",
    "render_motion",
    "save_motion_page",
    "save_reach_html",
    "save_video",
    "screenshot",
]

__getattr__, __dir__ = lazily(__name__)
