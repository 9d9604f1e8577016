"""Pictures of the robot: a live page, recordings that need no server, images."""

from pepper_kin.viewer.browser import find_chromium, screenshot
from pepper_kin.viewer.drawable import Drawable, marker
from pepper_kin.viewer.recording import write_motion_page

__all__ = ["Drawable", "find_chromium", "marker", "screenshot", "write_motion_page"]
