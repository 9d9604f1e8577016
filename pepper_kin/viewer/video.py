"""Motions as videos: MP4 and GIF, frame by frame from the page in a browser."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError, UnknownNameError, optional
from pepper_kin.file_access import atomic_file
from pepper_kin.viewer.browser_session import BrowserSession
from pepper_kin.viewer.camera import CameraView, Viewpoint, view_options

if TYPE_CHECKING:
    from PIL import Image

VIDEO_SUFFIXES = (".mp4", ".gif")
_QUALITY = 20  # x264's constant rate factor: 0 is lossless, 51 is the worst
_TIME_BASE = 1000  # frames per second are rounded to a thousandth
_GIF_TICK = 0.01  # [s]; a GIF has times in hundredths of a second
_COLORS = 256


def save_video(
    html_path: str | Path,
    video_path: str | Path,
    *,
    fps: float = 30.0,
    size: tuple[int, int] = (1280, 800),
    view: CameraView | Viewpoint = "three-quarter",
    on_frame: Callable[[int, int], None] = lambda done, total: None,
    timeout: float = 60.0,
) -> Path:
    """Record a video of a motion page, from its first frame to its last.

    One browser renders all frames at given times, so that slow machines record the same motion.

    Args:
        html_path: Page that `save_motion_page` has written.
        video_path: Video file to write, .mp4 (H.264) or .gif; it appears when it is complete.
        fps: Frames per second, in (0, 240]; a GIF has 50 at most and rounds times to a hundredth of a second.
        size: Width and height [pixel]; even numbers for .mp4.
        view: View: "three-quarter", "front", "side" or "top", or a `Viewpoint`.
        on_frame: Called with the numbers of rendered frames and of all frames.
        timeout: Timeout of each frame [s].

    Returns:
        The path of the video.

    Raises:
        UnknownNameError: for another suffix or view.
        InvalidValueError: for fps or a size out of range, or a page that does not exist.
        MissingDependencyError: No Chromium is installed, or for .mp4 no PyAV.
        InfeasibleError: The browser renders no image.
        FileFormatError: The video cannot be written.
    """
    suffix = Path(video_path).suffix.lower()
    check_video(suffix, fps, size, view)
    if not Path(html_path).is_file():
        raise InvalidValueError("html_path", html_path, "an existing page")
    with BrowserSession(html_path, size, view=view, timeout=timeout) as session:
        pictures = _pictures(session, frame_times(*session.span(), fps), on_frame)
        content = _encode_gif(pictures, fps) if suffix == ".gif" else _encode_mp4(pictures, fps, size)
    return atomic_file.write_bytes(video_path, content)


def check_video(suffix: str, fps: float, size: tuple[int, int], view: CameraView | Viewpoint) -> None:
    """Check the options of a video before anything is rendered; raises the errors of `save_video`."""
    if suffix not in VIDEO_SUFFIXES:
        raise UnknownNameError("video suffix", suffix, VIDEO_SUFFIXES)
    most = 1 / (2 * _GIF_TICK) if suffix == ".gif" else 240.0
    if not (math.isfinite(fps) and 0 < fps <= most):
        raise InvalidValueError("fps", fps, f"frames per second above 0, at most {most:g} for {suffix}")
    step = 2 if suffix == ".mp4" else 1
    fits = len(size) == 2 and all(isinstance(n, int) and 2 <= n <= 4096 and n % step == 0 for n in size)
    if not fits:
        even = "even " if step == 2 else ""
        raise InvalidValueError("size", size, f"width and height in pixels, {even}numbers in 2 ... 4096")
    view_options(view)
    if suffix == ".mp4":
        _av()


def frame_times(start: float, end: float, fps: float) -> NDArray[np.float64]:
    """Return the times of a video's frames [s], `fps` a second, shape (F,); the last is the end."""
    count = math.ceil((end - start) * fps - 1e-6) + 1
    return np.minimum(start + np.arange(count) / fps, end)


def _pictures(
    session: BrowserSession, times: NDArray[np.float64], on_frame: Callable[[int, int], None]
) -> Iterator[Image.Image]:
    """Yield the page's images at times [s], shape (F,)."""
    from PIL import Image

    for index, time in enumerate(times):
        yield Image.open(io.BytesIO(session.picture(time))).convert("RGB")
        on_frame(index + 1, times.size)


def _av() -> Any:
    return optional("av", extra="video", need="an MP4 film")


def _encode_mp4(pictures: Iterable[Image.Image], fps: float, size: tuple[int, int]) -> bytes:
    """Encode as H.264 in one thread, so that the same images give the same bytes."""
    av = _av()
    rate = Fraction(round(fps * _TIME_BASE), _TIME_BASE)
    film = io.BytesIO()
    with av.open(film, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"  # supported by every player and browser
        stream.options = {"crf": str(_QUALITY), "preset": "medium", "threads": "1"}
        for picture in pictures:
            for packet in stream.encode(av.VideoFrame.from_image(picture)):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return film.getvalue()


def _encode_gif(pictures: Iterable[Image.Image], fps: float) -> bytes:
    """Encode as an endless GIF in the colors of the first frame, so that unchanged parts take no space."""
    from PIL import Image

    frames: list[Image.Image] = []
    for picture in pictures:
        if frames:
            frames.append(picture.quantize(palette=frames[0], dither=Image.Dither.NONE))
        else:
            frames.append(
                picture.quantize(_COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
            )
    # Differences of rounded sums, so that rounding does not accumulate over the video.
    ticks = np.diff(np.round(np.arange(len(frames) + 1) / (fps * _GIF_TICK)))
    film = io.BytesIO()
    frames[0].save(
        film,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=[int(1000 * _GIF_TICK * count) for count in ticks],
        loop=0,
        disposal=1,
    )
    return film.getvalue()
