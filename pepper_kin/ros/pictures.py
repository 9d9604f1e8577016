"""Camera images of the node, rendered while there are subscriptions."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.ros.sensor_messages import CameraMessages
from pepper_kin.ros.transport import Publisher

if TYPE_CHECKING:
    from pepper_kin.ros.node import RobotNode

PERIOD_CYCLES = 5
"""Number of cycles between two images: 10 Hz."""


class CameraPictures:
    """The cameras of a node.

    In real time a thread renders, as fast as it can up to 10 Hz, so that no cycle waits for an image;
    otherwise images are rendered within the cycles, 10 in a simulated second.

    Args:
        node: The node.
        cameras: Names of the cameras in topics.
        resolution: Resolution of the images: "VGA", "QVGA" or "QQVGA".
    """

    def __init__(self, node: RobotNode, cameras: Sequence[str], resolution: str) -> None:
        self.node = node
        self._cameras: list[tuple[CameraMessages, Publisher, Publisher]] = [
            (
                CameraMessages(node.body, name, resolution),
                node.advertise(f"/camera/{name}/image_raw", "sensor_msgs/msg/Image"),
                node.advertise(f"/camera/{name}/camera_info", "sensor_msgs/msg/CameraInfo"),
            )
            for name in cameras
        ]
        self._due, self._ended, self._cycle = threading.Event(), False, 0
        self._thread: threading.Thread | None = None
        if node.body.time.real_time and self._cameras:
            self._thread = threading.Thread(target=self._run, name="ros-cameras", daemon=True)
            self._thread.start()

    def on_cycle(self) -> None:
        """Render, or let the thread render, if an image is due; called once a cycle."""
        self._cycle += 1
        if self._cycle % PERIOD_CYCLES:
            return
        if self._thread is None:
            self._draw()
        else:
            self._due.set()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._due.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(100 * CYCLE)

    def _run(self) -> None:
        while True:
            self._due.wait()
            self._due.clear()
            if self._ended:
                return
            self._draw()

    def _draw(self) -> None:
        for camera, image, info in self._cameras:
            now = self.node.now
            if info.subscription_count:
                info.publish(camera.info(now))
            if image.subscription_count and not self._ended:
                image.publish(camera.image(camera.picture(), now))
