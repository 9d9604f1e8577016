"""ALVideoDevice: images of the twin's cameras."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels.threads import OWN_THREADS
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.thread_priority import yield_to_others
from pepper_kin.twin.sensors import Camera, camera_intrinsics

CAMERAS = {0: "camera_top", 1: "camera_bottom", 2: "camera_depth"}
"""Index of a camera -> sensor of the twin."""

RESOLUTIONS = {0: (160, 120), 1: (320, 240), 2: (640, 480), 3: (1280, 960), 7: (80, 60), 8: (40, 30)}
"""Number of a resolution -> width and height [pixels]."""

DRAWN = {0: "QQVGA", 1: "QVGA", 2: "VGA"}
"""Resolutions that the twin's cameras have; other resolutions are scaled from one of them."""

LAYERS = {0: 1, 9: 2, 10: 3, 11: 3, 12: 3, 13: 3, 17: 2, 19: 12, 21: 2, 23: 2}
"""Number of a color space -> bytes of a pixel.

Yuv 0, Yuv422 9, YUV 10, RGB 11, HSY 12, BGR 13, depth 17 [mm], XYZ 19 [m], distance 21 and raw
depth 23 [mm].
"""

LENSES = {0: "CameraTop", 1: "CameraBottom", 2: "CameraDepth"}

_COLOR = {
    0: (0, 255, 0), 1: (0, 127, 32), 2: (0, 255, 64), 3: (-180, 180, 0), 6: (0, 1024, 0), 7: (0, 1, 0),
    8: (0, 1, 0), 11: (0, 1, 1), 12: (0, 1, 1), 13: (0, 1, 1), 17: (0, 65536, 0), 35: (0, 1, 0),
}  # fmt: skip
PARAMETERS = {0: _COLOR, 1: _COLOR, 2: {14: (0, 2, 1), 15: (1, 20, 1), 35: (0, 1, 0)}}
"""Camera -> parameter -> minimum, maximum and default, as documented; for gain and exposure nothing is."""

SELECT = 18
"""The parameter that chooses the active camera."""


@dataclass
class VideoSubscription:
    """A subscription to a camera.

    Attributes:
        camera: Index of the camera.
        resolution: Number of the resolution.
        color_space: Number of the color space.
        fps: Images a second.
    """

    camera: int
    resolution: int
    color_space: int
    fps: int


class ALVideoDevice(Module):
    """Cameras: subscriptions, and images that are rendered on request."""

    name = "ALVideoDevice"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._subscriptions: dict[str, list[VideoSubscription]] = {}
        self._cameras: dict[tuple[int, int], Camera] = {}
        self._pictures: dict[tuple[int, int], tuple[float, NDArray[Any]]] = {}
        self._parameters: dict[tuple[int, int], int] = {}
        self._active = 0
        # A separate thread with a low priority, so that rendering does not delay the cycles.
        self._drawing = ThreadPoolExecutor(1, f"{OWN_THREADS}-camera", yield_to_others)

    def subscribeCamera(self, name: str, cameraIndex: int, resolution: int, colorSpace: int, fps: int) -> str:
        """Subscribe to a camera; return the name for `getImageRemote`."""
        return self.subscribeCameras(name, [cameraIndex], [resolution], [colorSpace], fps)

    def subscribe(self, name: str, resolution: int, colorSpace: int, fps: int) -> str:
        """Subscribe to the active camera; return the name for `getImageRemote`."""
        return self.subscribeCamera(name, self._active, resolution, colorSpace, fps)

    def subscribeCameras(self, name: str, cameras: Any, resolutions: Any, colorSpaces: Any, fps: int) -> str:
        """Subscribe to several cameras; return the name for `getImagesRemote`."""
        method = "subscribeCameras"
        if not len(cameras) == len(resolutions) == len(colorSpaces) > 0:
            raise self.fail(method, "expected as many resolutions and color spaces as cameras")
        subscriptions = [
            VideoSubscription(
                self._known(method, "cameraIndex", camera, CAMERAS),
                self._known(method, "resolution", resolution, RESOLUTIONS),
                self._known(method, "colorSpace", space, LAYERS),
                int(self.number(method, "fps", fps)),
            )
            for camera, resolution, space in zip(cameras, resolutions, colorSpaces, strict=True)
        ]
        handle = next(h for k in range(1000) if (h := f"{name}_{k}") not in self._subscriptions)
        self._subscriptions[handle] = subscriptions
        return handle

    def unsubscribe(self, handle: str) -> bool:
        """End a subscription; return whether there was one."""
        return self._subscriptions.pop(handle, None) is not None

    def unsubscribeAllInstances(self, name: str) -> bool:
        """End all subscriptions of a name; return whether there were any."""
        handles = [h for h in self._subscriptions if h.rsplit("_", 1)[0] == name]
        for handle in handles:
            del self._subscriptions[handle]
        return bool(handles)

    def getSubscribers(self) -> list[str]:
        """Return the names of the subscriptions."""
        return list(self._subscriptions)

    def getImageRemote(self, handle: str) -> list[Any]:
        """Return an image in the robot's format.

        [width, height, layers, color space, s, us, bytes, camera, left, top, right and bottom angle (rad)]
        """
        return self._image(self._subscription("getImageRemote", handle))

    def _image(self, subscription: VideoSubscription) -> list[Any]:
        """Return an image of a subscription in the robot's format; see `getImageRemote`."""
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
        """Return whether the subscription exists; there is no image to release."""
        return handle in self._subscriptions

    def setFrameRate(self, handle: str, fps: int) -> bool:
        """Set the images a second of a subscription."""
        for subscription in self._all("setFrameRate", handle):
            subscription.fps = int(self.number("setFrameRate", "fps", fps))
        return True

    def getActiveCamera(self, *handle: str) -> int:
        """Return the camera of a subscription, or the active camera, which `subscribe` uses."""
        return self._subscription("getActiveCamera", handle[0]).camera if handle else self._active

    def setActiveCamera(self, *arguments: Any) -> bool:
        """Set the camera of a subscription, or the active camera, which `subscribe` uses."""
        if len(arguments) == 2:
            return self._write("setActiveCamera", *arguments, "camera")
        self._active = self._known("setActiveCamera", "camera", arguments[-1], CAMERAS)
        return True

    def getCameraName(self, cameraIndex: int) -> str:
        """Return the name of a camera."""
        return LENSES[self._known("getCameraName", "cameraIndex", cameraIndex, CAMERAS)]

    def isCameraOpen(self, cameraIndex: int) -> bool:
        """Return whether there is a camera with this index."""
        return cameraIndex in CAMERAS

    openCamera = closeCamera = startCamera = stopCamera = startFrameGrabber = stopFrameGrabber = isCameraOpen

    def isCameraStarted(self, cameraIndex: int) -> bool:
        """Return whether a camera has a subscription."""
        return any(cameraIndex == each.camera for all_ in self._subscriptions.values() for each in all_)

    def isFrameGrabberOff(self, cameraIndex: int) -> bool:
        """Return whether a camera has no subscription."""
        return not self.isCameraStarted(cameraIndex)

    def getCameraModel(self, cameraIndex: int) -> int:
        """Return 3, an OV5640, or 4, the depth camera's XTION."""
        return 4 if self._known("getCameraModel", "cameraIndex", cameraIndex, CAMERAS) == 2 else 3

    def setParameter(self, cameraIndex: int, parameter: int, value: int) -> bool:
        """Set a parameter of a camera, without effect on images."""
        self._parameters[int(cameraIndex), int(parameter)] = int(value)
        return True

    def getParameter(self, cameraIndex: int, parameter: int) -> int:
        """Return a parameter of a camera."""
        default = PARAMETERS.get(int(cameraIndex), {}).get(int(parameter), (0, 0, 0))[2]
        return self._parameters.get((int(cameraIndex), int(parameter)), default)

    def getParameterList(self, cameraIndex: int) -> list[int]:
        """Return the documented parameters of a camera."""
        return list(PARAMETERS[self._known("getParameterList", "cameraIndex", cameraIndex, CAMERAS)])

    def getParameterRange(self, cameraIndex: int, parameter: int) -> list[int]:
        """Return the minimum and maximum of a documented parameter."""
        method = "getParameterRange"
        known = PARAMETERS[self._known(method, "cameraIndex", cameraIndex, CAMERAS)]
        return list(known[self._known(method, "parameter", parameter, known)][:2])

    def setParameterToDefault(self, cameraIndex: int, parameter: int) -> bool:
        """Reset a parameter of a camera to its default."""
        self._parameters.pop((int(cameraIndex), int(parameter)), None)
        return True

    def setParam(self, parameter: int, value: int, *camera: int) -> bool:
        """Set a parameter of the active or another camera; parameter 18 selects the active camera."""
        if parameter == SELECT:
            return self.setActiveCamera(value)
        return self.setParameter(camera[0] if camera else self._active, parameter, value)

    def getParam(self, parameter: int, *camera: int) -> int:
        """Return a parameter of the active or another camera."""
        return self.getParameter(camera[0] if camera else self._active, parameter)

    def setAllParametersToDefault(self, cameraIndex: int) -> bool:
        """Reset the parameters of a camera to their defaults."""
        self._parameters = {k: v for k, v in self._parameters.items() if k[0] != cameraIndex}
        return True

    def getAngularPositionFromImagePosition(self, cameraIndex: int, imgPos: Any) -> list[float]:
        """Return the yaw and pitch [rad] of an image position (0 to 1 from the left and from the top)."""
        method = "getAngularPositionFromImagePosition"
        x, y = self.numbers(method, "imgPos", imgPos, 2)
        fx, fy = self._lens(method, cameraIndex)
        return [float(np.arctan((0.5 - x) / fx)), float(np.arctan((y - 0.5) / fy))]

    def getImagePositionFromAngularPosition(self, cameraIndex: int, angPos: Any) -> list[float]:
        """Return the image position (0 to 1 from the left and from the top) of yaw and pitch [rad]."""
        method = "getImagePositionFromAngularPosition"
        yaw, pitch = self.numbers(method, "angPos", angPos, 2)
        fx, fy = self._lens(method, cameraIndex)
        return [0.5 - float(np.tan(yaw)) * fx, 0.5 + float(np.tan(pitch)) * fy]

    def getAngularSizeFromImageSize(self, cameraIndex: int, imgSize: Any) -> list[float]:
        """Return the angular size [rad] of a size in the image (fractions of it), centered in the image."""
        method = "getAngularSizeFromImageSize"
        sizes = self.numbers(method, "imgSize", imgSize, 2)
        return [
            2.0 * float(np.arctan(x / 2.0 / f))
            for x, f in zip(sizes, self._lens(method, cameraIndex), strict=True)
        ]

    def getImageSizeFromAngularSize(self, cameraIndex: int, angSize: Any) -> list[float]:
        """Return the size in the image (fractions of it) of an angular size [rad], centered in the image."""
        method = "getImageSizeFromAngularSize"
        angles = self.numbers(method, "angSize", angSize, 2)
        return [
            2.0 * float(np.tan(a / 2.0)) * f
            for a, f in zip(angles, self._lens(method, cameraIndex), strict=True)
        ]

    def getImageInfoFromAngularInfo(self, cameraIndex: int, angInfo: Any) -> list[float]:
        """Return position and size in the image, as fractions of it, of angles and angular sizes [rad]."""
        angles = self.numbers("getImageInfoFromAngularInfo", "angInfo", angInfo, 4)
        place = self.getImagePositionFromAngularPosition(cameraIndex, angles[:2])
        return place + self.getImageSizeFromAngularSize(cameraIndex, angles[2:])

    def getImageInfoFromAngularInfoWithResolution(
        self, cameraIndex: int, angInfo: Any, resolution: int
    ) -> list[float]:
        """Return position and size in the image [pixels] of angles and angular sizes [rad]."""
        shares = self.getImageInfoFromAngularInfo(cameraIndex, angInfo)
        known = self._known(
            "getImageInfoFromAngularInfoWithResolution", "resolution", resolution, RESOLUTIONS
        )
        return [share * pixels for share, pixels in zip(shares, RESOLUTIONS[known] * 2, strict=True)]

    def getHorizontalFOV(self, cameraIndex: int) -> float:
        """Return the horizontal field of view [rad]."""
        return self.getAngularSizeFromImageSize(cameraIndex, [1.0, 1.0])[0]

    def getVerticalFOV(self, cameraIndex: int) -> float:
        """Return the vertical field of view [rad]."""
        return self.getAngularSizeFromImageSize(cameraIndex, [1.0, 1.0])[1]

    def _lens(self, method: str, camera: Any) -> tuple[float, float]:
        """Return the focal lengths, as fractions of the image's width and height."""
        lens = camera_intrinsics(CAMERAS[self._known(method, "cameraIndex", camera, CAMERAS)], "QVGA")
        return lens.fx / 320.0, lens.fy / 240.0

    def resolutionToSizes(self, resolution: int) -> list[int]:
        """Return width and height [pixels] of a resolution."""
        return list(RESOLUTIONS[self._known("resolutionToSizes", "resolution", resolution, RESOLUTIONS)])

    def sizesToResolution(self, width: int, height: int) -> int:
        """Return the resolution of a width and height [pixels]; -1 if there is none."""
        return next((number for number, sizes in RESOLUTIONS.items() if sizes == (width, height)), -1)

    # Targets of rows of `data/simple_methods.csv`, which add the last argument.

    def _read(self, method: str, handle: Any, what: str) -> int:
        return int(getattr(self._subscription(method, handle), what))

    def _read_each(self, method: str, handle: Any, what: str) -> list[int]:
        return [getattr(subscription, what) for subscription in self._all(method, handle)]

    def _write(self, method: str, handle: Any, value: Any, what: str) -> bool:
        return all(self._write_each(method, handle, [value] * len(self._all(method, handle)), what))

    def _write_each(self, method: str, handle: Any, values: Any, what: str) -> list[bool]:
        known = {"camera": CAMERAS, "resolution": RESOLUTIONS, "color_space": LAYERS}[what]
        for subscription, value in zip(self._all(method, handle), values, strict=False):
            setattr(subscription, what, self._known(method, what, value, known))
        return [True] * len(values)

    def _of_camera(self, method: str, handle: Any, *more: Any) -> Any:
        """Call a method, named last, with the camera of a subscription."""
        return getattr(self, more[-1])(self._subscription(method, handle).camera, *more[:-1])

    def _of_cameras(self, method: str, handle: Any, parameter: int, *more: Any) -> list[Any]:
        """Call a method, named last, with each camera of a subscription, and its value, if any."""
        cameras = self._read_each(method, handle, "camera")
        values = [[value] for value in more[0]] if len(more) > 1 else [[] for _ in cameras]
        call = getattr(self, more[-1])
        return [call(camera, parameter, *value) for camera, value in zip(cameras, values, strict=False)]

    def _of_active(self, _method: str, *more: Any) -> Any:
        """Call a method, named last, with the active camera."""
        return getattr(self, more[-1])(self._active, *more[:-1])

    def _images(self, method: str, handle: Any) -> list[list[Any]]:
        return [self._image(subscription) for subscription in self._all(method, handle)]

    def _raw_images(self, method: str, handle: Any) -> list[list[Any]]:
        """Return images in the native color space of each camera: YUV422 or depth."""
        raw = [replace(each, color_space=17 if each.camera == 2 else 9) for each in self._all(method, handle)]
        return [self._image(subscription) for subscription in raw]

    def _raw_image(self, method: str, handle: Any) -> list[Any]:
        return self._raw_images(method, handle)[0]

    def _released(self, method: str, handle: Any) -> list[bool]:
        return [True for _ in self._all(method, handle)]

    # Images.

    def _subscription(self, method: str, handle: Any) -> VideoSubscription:
        return self._all(method, handle)[0]

    def _all(self, method: str, handle: Any) -> list[VideoSubscription]:
        """Return the subscriptions of a name, one per camera, or all subscriptions to a camera's index."""
        looking = self._subscriptions
        found = looking.get(handle) or [
            each for all_ in looking.values() for each in all_ if each.camera == handle
        ]
        if not found:
            known = ", ".join(looking) or "(none)"
            raise self.fail(method, f"{quoted(handle)} is no subscription; there are: {known}")
        return found

    def _known(self, method: str, quantity: str, value: Any, known: Any) -> int:
        number = int(self.number(method, quantity, value))
        if number not in known:
            raise self.fail(method, f"{quantity}: got {number}, expected one of {', '.join(map(str, known))}")
        return number

    def _picture(self, camera: int, resolution: int, q: NDArray[np.float64]) -> NDArray[Any]:
        """Return a camera's image, colors or distances [m]; rendered at most once a cycle.

        Args:
            camera: Index of the camera.
            resolution: Number of the resolution.
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

    def _drawn(self, subscription: VideoSubscription) -> bytes:
        """Return the pixels of a present image."""
        with self.body.time.lock:
            q = self.body.configuration(True)
        return self._drawing.submit(self._pixels, subscription, q).result()

    def _pixels(self, subscription: VideoSubscription, q: NDArray[np.float64]) -> bytes:
        """Return the pixels of an image at q [rad or m], shape (n,)."""
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
        """Convert distances [m], shape (height, width), to bytes of a color space."""
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
