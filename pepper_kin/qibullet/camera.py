"""Cameras of a robot: images of the twin's cameras, rendered when they are due."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import shortened
from pepper_kin.qibullet.errors import SimulationError
from pepper_kin.qibullet.sensor import Sensor
from pepper_kin.twin.sensors.camera import Camera as TwinCamera
from pepper_kin.twin.sensors.camera import Intrinsics

if TYPE_CHECKING:
    from pepper_kin.qibullet.link import Link

FROM_LINK = {
    "CameraTop_optical_frame": "camera_top",
    "CameraBottom_optical_frame": "camera_bottom",
    "CameraDepth_optical_frame": "camera_depth",
}
"""Link of a camera -> camera of the twin."""

MILLIMETERS = 1000.0


@dataclass(frozen=True)
class CameraResolution:
    """Width and height of an image [pixels]."""

    width: int
    height: int


class Camera(Sensor):
    """Base class of `CameraRgb` and `CameraDepth`.

    An image is rendered on request when a period of `fps` has passed on the simulation's clock; in between
    the last image is returned again.

    Args:
        robot_model: Number of the robot's model.
        camera_id: Number of the camera, such as `PepperVirtual.ID_CAMERA_TOP`.
        camera_link: Link of the camera.
        hfov: Horizontal field of view [degrees].
        vfov: Vertical field of view [degrees].
        physicsClientId: Number of the simulation.
        near_plane: Minimum distance of a depth image [m].
        far_plane: Maximum distance of a depth image [m].

    Attributes:
        frame: The last image; None before the first.
    """

    K_QQVGA: ClassVar = CameraResolution(160, 120)
    K_QVGA: ClassVar = CameraResolution(320, 240)
    K_VGA: ClassVar = CameraResolution(640, 480)
    K_QQ720p: ClassVar = CameraResolution(320, 180)
    K_Q720p: ClassVar = CameraResolution(640, 360)
    K_720p: ClassVar = CameraResolution(1280, 720)

    _subscribed: ClassVar[dict[int, Camera]] = {}
    _lock: ClassVar = threading.Lock()

    def __init__(
        self,
        robot_model: int | None,
        camera_id: int | None,
        camera_link: Link | None,
        hfov: Any,
        vfov: Any,
        physicsClientId: int = 0,
        *,
        near_plane: float = 0.01,
        far_plane: float = 100.0,
    ) -> None:
        super().__init__(robot_model, physicsClientId)
        self.camera_id, self.camera_link = camera_id, camera_link
        self.near_plane, self.far_plane = near_plane, far_plane
        self.frame: NDArray[Any] | None = None
        self.resolution: CameraResolution | None = None
        valid = all(isinstance(angle, int | float) and 0.0 < angle < 180.0 for angle in (hfov, vfov))
        self.hfov: float | None = float(hfov) if valid else None
        self.vfov: float | None = float(vfov) if valid else None
        self._drawing: TwinCamera | None = None
        self._busy = threading.Lock()

    def subscribe(self, resolution: CameraResolution, fps: float = 30.0) -> int:
        """Subscribe to the camera; return a handle.

        Args:
            resolution: Resolution, as one of `Camera.K_...`.
            fps: Images a second.

        Raises:
            SimulationError: for an invalid resolution, an fps that is not above 0, or a camera
                without field of view or link.
        """
        if not isinstance(resolution, CameraResolution):
            got = shortened(repr(resolution))
            raise SimulationError(f"resolution: got {got}, expected a CameraResolution such as Camera.K_QVGA")
        if self.hfov is None or self.vfov is None:
            raise SimulationError("field of view: got none, expected two angles between 0 and 180 degrees")
        name = None if self.camera_link is None else FROM_LINK.get(self.camera_link.name)
        if name is None:
            raise SimulationError(
                f"camera_link: got {self.camera_link}, expected one of {', '.join(FROM_LINK)}"
            )
        self.setFrequency(fps)
        lens = _pinhole(resolution, self.hfov, self.vfov)
        with self._busy:
            self._drawing = TwinCamera(self.body.pepper, name, intrinsics=lens)
            self.resolution, self.frame, self._read_at = resolution, None, -math.inf
            self._active = True
        with Camera._lock:
            Camera._subscribed[id(self)] = self
        return id(self)

    def unsubscribe(self) -> bool:
        """End the subscription; return whether there was one."""
        with Camera._lock:
            subscribed = Camera._subscribed.pop(id(self), None) is not None
        self._active, self.frame = False, None
        return subscribed

    def getFrame(self) -> NDArray[Any] | None:
        """Return the present image; None without a subscription.

        Raises:
            SimulationError: if the simulation has ended.
        """
        with self._busy:
            if self._drawing is None or not self._active:
                return None
            body = self.body
            with body.time.lock:
                due, q = self._is_due(body.time.now), body.configuration(True)
            if due or self.frame is None:
                self.frame = self._picture(self._drawing, q, body.scene)
            return self.frame.copy()

    def getCameraId(self) -> int | None:
        """Return the number of the camera."""
        return self.camera_id

    def getCameraLink(self) -> Link | None:
        """Return the link of the camera."""
        return self.camera_link

    def getResolution(self) -> CameraResolution | None:
        """Return the resolution of the subscription."""
        return self.resolution

    def getFps(self) -> float | None:
        """Return the images a second."""
        return self.getFrequency()

    def isActive(self) -> bool:
        """Return whether there is a subscription."""
        return id(self) in Camera._subscribed

    def _picture(self, camera: TwinCamera, q: NDArray[np.float64], scene: Any) -> NDArray[Any]:
        """Return the image of a camera at joint positions [rad or m], shape (n,)."""
        raise NotImplementedError

    def _terminateModule(self) -> None:
        """End the subscription."""
        self.unsubscribe()

    # The names below are private in qiBullet, but scripts use them.

    def _getCameraIntrinsics(self) -> list[float] | None:
        """Return [fx, 0, cx, 0, fy, cy, 0, 0, 1] [pixels]; None before the first subscription."""
        if self._drawing is None:
            return None
        lens = self._drawing.intrinsics
        return [lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0]

    def _waitForCorrectImageFormat(self) -> None:
        """Return at once: images are rendered on request, in the right resolution."""

    @classmethod
    def _getCameraHandlesDict(cls) -> dict[int, Camera]:
        """Return handle -> camera of all subscribed cameras."""
        with cls._lock:
            return dict(cls._subscribed)

    @classmethod
    def _getCameraFromHandle(cls, handle: int) -> Camera:
        """Return the camera with a handle.

        Raises:
            KeyError: for an unknown handle.
        """
        with cls._lock:
            return cls._subscribed[handle]


class CameraRgb(Camera):
    """A color camera, with images of blue, green and red bytes, shape (height, width, 3)."""

    def _picture(self, camera: TwinCamera, q: NDArray[np.float64], scene: Any) -> NDArray[Any]:
        """Return an image of blue, green and red at joint positions [rad or m], shape (n,)."""
        return np.ascontiguousarray(camera.color(q, scene)[..., ::-1])


class CameraDepth(Camera):
    """A depth camera, with distances along the optical axis [mm], 16 bits, shape (height, width).

    Distances below 0.4 m read 400; distances above 8 m, or without an object, 8000.
    """

    def __init__(
        self,
        robot_model: int | None,
        camera_id: int | None,
        camera_link: Link | None,
        hfov: Any,
        vfov: Any,
        physicsClientId: int = 0,
    ) -> None:
        super().__init__(
            robot_model, camera_id, camera_link, hfov, vfov, physicsClientId, near_plane=0.4, far_plane=8.0
        )

    def _picture(self, camera: TwinCamera, q: NDArray[np.float64], scene: Any) -> NDArray[Any]:
        """Return an image of distances [mm] at joint positions [rad or m], shape (n,)."""
        depth = np.clip(camera.depth(q, scene), self.near_plane, self.far_plane)
        return np.round(MILLIMETERS * depth).astype(np.uint16)


def _pinhole(resolution: CameraResolution, hfov: float, vfov: float) -> Intrinsics:
    """Return the intrinsics of a pinhole camera with given fields of view [degrees]."""
    width, height = resolution.width, resolution.height
    fx = width / 2.0 / math.tan(math.radians(hfov) / 2.0)
    fy = height / 2.0 / math.tan(math.radians(vfov) / 2.0)
    return Intrinsics(width, height, fx, fy, (width - 1) / 2.0, (height - 1) / 2.0)
