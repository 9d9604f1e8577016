"""ALVideoDevice: pictures of the twin's cameras."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.thread_priority import yield_to_others
from pepper_kin.twin.sensors import Camera, camera_intrinsics

CAMERAS = {0: "camera_top", 1: "camera_bottom", 2: "camera_depth"}
"""Index of a camera -> sensor of the twin."""

RESOLUTIONS = {0: (160, 120), 1: (320, 240), 2: (640, 480), 3: (1280, 960), 7: (80, 60), 8: (40, 30)}
"""Number of a resolution -> width and height [pixels]."""

DRAWN = {0: "QQVGA", 1: "QVGA", 2: "VGA"}
"""Resolutions that the twin's cameras have; others are scaled from the nearest."""

LAYERS = {0: 1, 9: 2, 10: 3, 11: 3, 12: 3, 13: 3, 17: 2, 19: 12, 21: 2, 23: 2}
"""Number of a color space -> bytes of a pixel.

Yuv 0, Yuv422 9, YUV 10, RGB 11, HSY 12, BGR 13, depth 17 [mm], XYZ 19 [m], distance 21 and raw
depth 23 [mm].
"""

LENSES = {0: "CameraTop", 1: "CameraBottom", 2: "CameraDepth"}


@dataclass
class Subscription:
    """Somebody who looks through a camera.

    Attributes:
        camera: Its index.
        resolution: Its number.
        color_space: Its number.
        fps: Pictures a second.
    """

    camera: int
    resolution: int
    color_space: int
    fps: int


class ALVideoDevice(Module):
    """Cameras: subscriptions, and pictures that are drawn when they are asked for."""

    name = "ALVideoDevice"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._subscriptions: dict[str, Subscription] = {}
        self._cameras: dict[tuple[int, int], Camera] = {}
        self._pictures: dict[tuple[int, int], tuple[float, NDArray[Any]]] = {}
        self._parameters: dict[tuple[int, int], int] = {}
        self._active = 0
        # A separate thread, so that cycles need not wait for a time slice of it.
        self._drawing = ThreadPoolExecutor(1, "naoqi-camera", yield_to_others)

    def subscribeCamera(self, name: str, cameraIndex: int, resolution: int, colorSpace: int, fps: int) -> str:
        """Subscribe to a camera; return the name for `getImageRemote`."""
        method = "subscribeCamera"
        subscription = Subscription(
            self._known(method, "cameraIndex", cameraIndex, CAMERAS),
            self._known(method, "resolution", resolution, RESOLUTIONS),
            self._known(method, "colorSpace", colorSpace, LAYERS),
            int(self.number(method, "fps", fps)),
        )
        handle = next(h for k in range(1000) if (h := f"{name}_{k}") not in self._subscriptions)
        self._subscriptions[handle] = subscription
        return handle

    def subscribe(self, name: str, resolution: int, colorSpace: int, fps: int) -> str:
        """Subscribe to the active camera; return the name for `getImageRemote`."""
        return self.subscribeCamera(name, self._active, resolution, colorSpace, fps)

    def subscribeCameras(self, name: str, cameras: Any, resolutions: Any, colorSpaces: Any, fps: int) -> str:
        """Subscribe to the first of several cameras."""
        return self.subscribeCamera(name, cameras[0], resolutions[0], colorSpaces[0], fps)

    def unsubscribe(self, handle: str) -> bool:
        """End a subscription; return whether there was one."""
        return self._subscriptions.pop(handle, None) is not None

    def unsubscribeAllInstances(self, name: str) -> bool:
        """End all subscriptions of somebody."""
        handles = [h for h in self._subscriptions if h.rsplit("_", 1)[0] == name]
        for handle in handles:
            del self._subscriptions[handle]
        return bool(handles)

    def getSubscribers(self) -> list[str]:
        """Return the subscriptions."""
        return list(self._subscriptions)

    def getImageRemote(self, handle: str) -> list[Any]:
        """Return a picture as the robot does.

        [width, height, layers, color space, s, us, bytes, camera, left, top, right and bottom angle (rad)]
        """
        subscription = self._subscription("getImageRemote", handle)
        width, height = RESOLUTIONS[subscription.resolution]
        stamp = self.broker.wall_time()
        data = self._drawn(subscription)
        lens = camera_intrinsics(CAMERAS[subscription.camera], "QVGA")
        right, bottom = float(np.arctan2(160.0, lens.fx)), float(np.arctan2(120.0, lens.fy))
        layers = LAYERS[subscription.color_space]
        return [
            width,
            height,
            layers,
            subscription.color_space,
            int(stamp),
            int(stamp % 1.0 * 1e6),
            data,
            subscription.camera,
            right,
            bottom,
            -right,
            -bottom,
        ]

    getImageLocal = getImageRemote

    def releaseImage(self, handle: str) -> bool:
        """Let a picture go."""
        return handle in self._subscriptions

    def setResolution(self, handle: str, resolution: int) -> bool:
        """Change the resolution of a subscription."""
        subscription = self._subscription("setResolution", handle)
        subscription.resolution = self._known("setResolution", "resolution", resolution, RESOLUTIONS)
        return True

    def setColorSpace(self, handle: str, colorSpace: int) -> bool:
        """Change the color space of a subscription."""
        subscription = self._subscription("setColorSpace", handle)
        subscription.color_space = self._known("setColorSpace", "colorSpace", colorSpace, LAYERS)
        return True

    def setFrameRate(self, handle: str, fps: int) -> bool:
        """Change the pictures a second of a subscription."""
        self._subscription("setFrameRate", handle).fps = int(self.number("setFrameRate", "fps", fps))
        return True

    def getActiveCamera(self, *_: Any) -> int:
        """Return the camera that `subscribe` takes."""
        return self._active

    def setActiveCamera(self, *arguments: Any) -> bool:
        """Choose the camera that `subscribe` takes."""
        self._active = self._known("setActiveCamera", "camera", arguments[-1], CAMERAS)
        return True

    def getCameraName(self, cameraIndex: int) -> str:
        """Return the name of a camera."""
        return LENSES[self._known("getCameraName", "cameraIndex", cameraIndex, CAMERAS)]

    def isCameraOpen(self, cameraIndex: int) -> bool:
        """Return whether there is a camera with this index."""
        return cameraIndex in CAMERAS

    openCamera = closeCamera = startCamera = stopCamera = isCameraOpen

    def setParameter(self, cameraIndex: int, parameter: int, value: int) -> bool:
        """Keep a parameter of a camera; pictures do not change."""
        self._parameters[int(cameraIndex), int(parameter)] = int(value)
        return True

    def getParameter(self, cameraIndex: int, parameter: int) -> int:
        """Return a parameter of a camera."""
        return self._parameters.get((int(cameraIndex), int(parameter)), 0)

    def setParam(self, parameter: int, value: int, *camera: int) -> bool:
        """Keep a parameter of the active camera, or another."""
        return self.setParameter(camera[0] if camera else self._active, parameter, value)

    def getParam(self, parameter: int, *camera: int) -> int:
        """Return a parameter of the active camera, or another."""
        return self.getParameter(camera[0] if camera else self._active, parameter)

    def setAllParametersToDefault(self, cameraIndex: int) -> bool:
        """Forget the parameters of a camera."""
        self._parameters = {k: v for k, v in self._parameters.items() if k[0] != cameraIndex}
        return True

    def getAngularPositionFromImagePosition(self, cameraIndex: int, imgPos: Any) -> list[float]:
        """Return the angles [rad] of a place in the picture (0 to 1 from the left and from the top)."""
        method = "getAngularPositionFromImagePosition"
        x, y = self.numbers(method, "imgPos", imgPos, 2)
        lens = camera_intrinsics(CAMERAS[self._known(method, "cameraIndex", cameraIndex, CAMERAS)], "QVGA")
        return [float(np.arctan2(160.0 - 320.0 * x, lens.fx)), float(np.arctan2(240.0 * y - 120.0, lens.fy))]

    def getImagePositionFromAngularPosition(self, cameraIndex: int, angPos: Any) -> list[float]:
        """Return the place in the picture (0 to 1 from the left and from the top) of angles [rad]."""
        method = "getImagePositionFromAngularPosition"
        yaw, pitch = self.numbers(method, "angPos", angPos, 2)
        lens = camera_intrinsics(CAMERAS[self._known(method, "cameraIndex", cameraIndex, CAMERAS)], "QVGA")
        return [0.5 - float(np.tan(yaw)) * lens.fx / 320.0, 0.5 + float(np.tan(pitch)) * lens.fy / 240.0]

    # Pictures.

    def _read(self, method: str, handle: Any, what: str) -> int:
        return int(getattr(self._subscription(method, handle), what))

    def _subscription(self, method: str, handle: Any) -> Subscription:
        if handle not in self._subscriptions:
            known = ", ".join(self._subscriptions) or "(none)"
            raise self.fail(method, f"{quoted(handle)} is no subscription; there are: {known}")
        return self._subscriptions[handle]

    def _known(self, method: str, quantity: str, value: Any, known: Any) -> int:
        number = int(self.number(method, quantity, value))
        if number not in known:
            raise self.fail(method, f"{quantity}: got {number}, expected one of {', '.join(map(str, known))}")
        return number

    def _picture(self, camera: int, resolution: int, q: NDArray[np.float64]) -> NDArray[Any]:
        """Return what a camera sees, colors or distances; drawn at most once a cycle.

        Args:
            camera: Its index.
            resolution: Its number.
            q: Joint positions [rad or m], shape (n,).
        """
        drawn = resolution if resolution in DRAWN else 2 if resolution == 3 else 0
        key, now = (camera, drawn), self.body.time.now
        kept = self._pictures.get(key)
        if kept is None or kept[0] != now:
            if key not in self._cameras:
                self._cameras[key] = Camera(self.body.pepper, CAMERAS[camera], DRAWN[drawn])
            see = self._cameras[key].depth if camera == 2 else self._cameras[key].color
            kept = self._pictures[key] = (now, np.asarray(see(q, self.body.scene)))
        picture = kept[1]
        width, height = RESOLUTIONS[resolution]
        rows = np.arange(height) * picture.shape[0] // height
        columns = np.arange(width) * picture.shape[1] // width
        return picture if picture.shape[:2] == (height, width) else picture[rows][:, columns]

    def _drawn(self, subscription: Subscription) -> bytes:
        """Return the pixels of a picture of now."""
        with self.body.time.lock:
            q = self.body.configuration(True)
        return self._drawing.submit(self._pixels, subscription, q).result()

    def _pixels(self, subscription: Subscription, q: NDArray[np.float64]) -> bytes:
        """Return the pixels of a picture at q [rad or m], shape (n,)."""
        space = subscription.color_space
        picture = self._picture(subscription.camera, subscription.resolution, q)
        if subscription.camera == 2:
            return self._depth_pixels(picture, space)
        if space == 11:
            return picture.tobytes()
        if space == 13:
            return picture[..., ::-1].tobytes()
        red, green, blue = (picture[..., k].astype(float) for k in range(3))
        luma = 0.299 * red + 0.587 * green + 0.114 * blue
        cb, cr = 128 + 0.564 * (blue - luma), 128 + 0.713 * (red - luma)
        y, u, v = (np.clip(np.round(x), 0, 255).astype(np.uint8) for x in (luma, cb, cr))
        if space == 9:
            packed = np.stack([y[:, ::2], u[:, ::2], y[:, 1::2], v[:, ::2]], axis=-1)
            return packed.tobytes()
        if space == 10:
            return np.stack([y, u, v], axis=-1).tobytes()
        if space == 12:
            return np.stack([u, v, y], axis=-1).tobytes()
        if space == 0:
            return y.tobytes()
        raise self.fail("getImageRemote", f"the color space {space} is one of the depth camera")

    def _depth_pixels(self, depth: NDArray[Any], space: int) -> bytes:
        """Return distances [m], shape (height, width), as bytes of a color space."""
        finite = np.where(np.isfinite(depth), depth, 0.0)
        if space == 19:
            height, width = depth.shape
            lens = camera_intrinsics("camera_depth", "QVGA")
            scale = width / 320.0
            x = (np.arange(width) + 0.5 - width / 2) / (lens.fx * scale)
            y = (np.arange(height) + 0.5 - height / 2) / (lens.fy * scale)
            points = np.stack([finite * x, finite * y[:, None], finite], axis=-1)
            return points.astype("<f4").tobytes()
        millimeters = np.clip(np.round(1000.0 * finite), 0, 65535).astype("<u2")
        if space in (17, 21, 23):
            return millimeters.tobytes()
        gray = (255.0 * np.clip(finite / 8.0, 0.0, 1.0)).astype(np.uint8)
        return (
            np.repeat(gray[..., None], LAYERS[space], axis=-1).tobytes()
            if LAYERS[space] > 1
            else gray.tobytes()
        )


MODULES = (ALVideoDevice,)
