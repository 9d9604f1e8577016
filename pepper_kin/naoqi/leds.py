"""ALLeds: the colors of the eyes, ears, chest and shoulders."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.module import Module

Color = tuple[float, float, float]

NAMED = {
    "white": 0xFFFFFF,
    "red": 0xFF0000,
    "green": 0x00FF00,
    "blue": 0x0000FF,
    "yellow": 0xFFFF00,
    "magenta": 0xFF00FF,
    "cyan": 0x00FFFF,
}

EYES = tuple(f"{side}FaceLed{k}" for side in ("Left", "Right") for k in range(8))
EARS = tuple(f"{side}EarLed{k}" for side in ("Left", "Right") for k in range(1, 11))
CHEST = ("ChestLeds",)
SHOULDERS = ("LeftShoulderLed", "RightShoulderLed")

GROUPS: dict[str, tuple[str, ...]] = {
    "AllLeds": (*EYES, *EARS, *CHEST, *SHOULDERS),
    "FaceLeds": EYES,
    "LeftFaceLeds": EYES[:8],
    "RightFaceLeds": EYES[8:],
    "EarLeds": EARS,
    "LeftEarLeds": EARS[:10],
    "RightEarLeds": EARS[10:],
    "ChestLeds": CHEST,
    "ShoulderLeds": SHOULDERS,
    "FaceLedsBottom": (EYES[3], EYES[4], EYES[11], EYES[12]),
    "FaceLedsTop": (EYES[0], EYES[7], EYES[8], EYES[15]),
    "FaceLedsExternal": EYES,
    "FaceLedsInternal": EYES,
}
"""Name of a group -> its lights."""

CHANNELS = {"Red": (0,), "Green": (1,), "Blue": (2,)}


@dataclass(frozen=True)
class Fade:
    """A linear change of a color in time.

    Attributes:
        before: Initial red, green, blue, 0 to 1.
        after: Final red, green, blue, 0 to 1.
        start: Start time [s].
        duration: Duration [s].
    """

    before: Color
    after: Color
    start: float = 0.0
    duration: float = 0.0

    def at(self, time: float) -> Color:
        """Return the color at a time [s]."""
        s = 1.0 if self.duration <= 0 else min(max((time - self.start) / self.duration, 0.0), 1.0)
        return tuple((1 - s) * a + s * b for a, b in zip(self.before, self.after, strict=True))  # type: ignore[return-value]


class ALLeds(Module):
    """Lights: colors that fade; the page of `--view` shows them."""

    name = "ALLeds"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        white = Fade((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
        self._lights = dict.fromkeys(GROUPS["AllLeds"], white)
        self._groups: dict[str, tuple[str, ...]] = dict(GROUPS)

    def color(self, light: str) -> Color:
        """Return the present red, green and blue (0 to 1) of a light."""
        return self._lights[light].at(self.body.time.now)

    def colors(self) -> dict[str, Color]:
        """Return the present red, green and blue (0 to 1) of all lights."""
        return {light: self.color(light) for light in self._lights}

    def fadeRGB(self, name: str, *arguments: Any) -> None:
        """Fade to (name, "red", s), (name, 0xRRGGBB, s) or (name, r, g, b, s); return when done."""
        method = "fadeRGB"
        *color, duration = arguments if len(arguments) > 1 else (*arguments, 0.0)
        if len(color) == 3:
            values = tuple(self.share_of_light(method, c) for c in color)
        elif len(color) == 1:
            values = self._named(method, color[0])
        else:
            raise self.fail(
                method, f"got {len(arguments) + 1} arguments, expected a name, a color and a duration"
            )
        self._fade(method, name, values, self.number(method, "duration", duration), (0, 1, 2))  # type: ignore[arg-type]

    def fade(self, name: str, intensity: float, duration: float) -> None:
        """Fade to a brightness, 0 to 1; return when done."""
        value = self.share_of_light("fade", intensity)
        seconds = self.number("fade", "duration", duration)
        self._fade("fade", name, (value,) * 3, seconds, self._channels(name))

    def fadeListRGB(self, name: str, rgbList: Any, timeList: Any) -> None:
        """Fade through colors at times [s]; return when done."""
        before = 0.0
        for color, time in zip(rgbList, timeList, strict=True):
            self.fadeRGB(name, color, float(time) - before)
            before = float(time)

    def getIntensity(self, name: str) -> list[float]:
        """Return the brightness of each light of a name: the maximum of red, green and blue."""
        return [max(self.color(light)) for light in self._named_lights("getIntensity", name)]

    def reset(self, name: str) -> None:
        """Set lights to white."""
        self._fade("reset", name, (1.0, 1.0, 1.0), 0.0, (0, 1, 2))

    def rasta(self, duration: float) -> None:
        """Fade the eyes through green, yellow and red; return when done."""
        third = self.number("rasta", "duration", duration) / 3.0
        for color in ("green", "yellow", "red"):
            self.fadeRGB("FaceLeds", color, third)

    def randomEyes(self, duration: float) -> None:
        """Fade the eyes through four fixed colors; return when done."""
        part = self.number("randomEyes", "duration", duration) / 4.0
        for color in ("magenta", "cyan", "yellow", "white"):
            self.fadeRGB("FaceLeds", color, part)

    def rotateEyes(self, rgb: int, timeForRotation: float, totalDuration: float) -> None:
        """Rotate a color around the eyes; return when done."""
        color = self._named("rotateEyes", rgb)
        total = self.number("rotateEyes", "totalDuration", totalDuration)
        turn = max(self.number("rotateEyes", "timeForRotation", timeForRotation), 0.1)
        for k in range(max(math.ceil(8 * total / turn), 1)):
            for light in (EYES[k % 8], EYES[8 + k % 8]):
                self._fade("rotateEyes", light, color, 0.0, (0, 1, 2))
            self.body.time.sleep(turn / 8)

    def earLedsSetAngle(self, degrees: int, duration: float, leaveOnAtEnd: bool) -> None:
        """Show a direction with the ears (0 up, 90 forward) for a duration [s]; return when done."""
        number = round(self.number("earLedsSetAngle", "degrees", degrees) / 36.0) % 10
        for light in EARS:
            self._fade(
                "earLedsSetAngle", light, ((0.0, 0.0, float(light.endswith(f"Led{number + 1}")))), 0.0, (2,)
            )
        self.body.time.sleep(max(self.number("earLedsSetAngle", "duration", duration), 0.0))
        if not leaveOnAtEnd:
            self._fade("earLedsSetAngle", "EarLeds", (0.0, 0.0, 0.0), 0.0, (2,))

    def createGroup(self, groupName: str, ledNames: Any) -> None:
        """Create a group of lights."""
        self._groups[groupName] = tuple(
            light for n in ledNames for light in self._named_lights("createGroup", n)
        )

    def listGroups(self) -> list[str]:
        """Return the names of all groups."""
        return sorted(self._groups)

    def listGroup(self, groupName: str) -> list[str]:
        """Return the names of a group's lights."""
        return list(self._named_lights("listGroup", groupName))

    def listLEDs(self) -> list[str]:
        """Return the names of all lights."""
        return list(self._lights)

    def _set_intensity(self, method: str, name: str, intensity: Any) -> None:
        value = self.share_of_light("setIntensity", intensity)
        self._fade("setIntensity", name, (value,) * 3, 0.0, self._channels(name))

    def share_of_light(self, method: str, value: Any) -> float:
        """Return a brightness clipped to 0 to 1."""
        return min(max(self.number(method, "intensity", value), 0.0), 1.0)

    def _named(self, method: str, color: Any) -> Color:
        """Return red, green and blue, 0 to 1, of a color's name or 0xRRGGBB."""
        if isinstance(color, str):
            if color.lower() not in NAMED:
                raise self.fail(
                    method, f"color: got {quoted(color)}, expected one of {', '.join(NAMED)} or 0xRRGGBB"
                )
            color = NAMED[color.lower()]
        value = int(self.number(method, "color", color))
        return ((value >> 16 & 255) / 255.0, (value >> 8 & 255) / 255.0, (value & 255) / 255.0)

    def _channels(self, name: str) -> tuple[int, ...]:
        for word, channels in CHANNELS.items():
            if f"/{word}/" in name or name.endswith(f"Leds{word}") or word in name.split("/"):
                return channels
        return (0, 1, 2)

    def _named_lights(self, method: str, name: Any) -> tuple[str, ...]:
        """Return the lights of a group's or light's name, or of the group that the name contains."""
        if name in self._groups:
            return self._groups[name]
        if name in self._lights:
            return (name,)
        text = str(name)
        for part, group in (
            ("Face", "FaceLeds"),
            ("Ear", "EarLeds"),
            ("Chest", "ChestLeds"),
            ("Shoulder", "ShoulderLeds"),
            ("All", "AllLeds"),
            ("Brain", "EarLeds"),
        ):
            if part in text:
                side = next((s for s in ("Left", "Right") if s in text), "")
                return self._groups.get(f"{side}{group}", self._groups[group])
        raise self.fail(method, f"name: got {quoted(name)}, expected one of {', '.join(self._groups)}")

    def _fade(self, method: str, name: str, color: Color, duration: float, channels: tuple[int, ...]) -> None:
        """Fade the given channels of lights to a color, and wait for the duration [s]."""
        now = self.body.time.now
        for light in self._named_lights(method, name):
            before = self.color(light)
            after = tuple(color[c] if c in channels else before[c] for c in range(3))
            self._lights[light] = Fade(before, after, now, max(duration, 0.0))  # type: ignore[arg-type]
        if duration > 0:
            self.body.time.sleep(duration)


MODULES = (ALLeds,)
