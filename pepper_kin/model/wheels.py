"""Wheeled bases of any robot: three more joints, and the limits of the wheels."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from pepper_kin.exceptions import InvalidValueError, ModelError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.joint_vectors import check_choice, check_positive
from pepper_kin.model.urdf_document import Joint, UrdfDocument

saxutils = lazy_module("xml.sax.saxutils")

BASES = ("fixed", "planar", "differential")
BASE_JOINTS = ("BaseX", "BaseY", "BaseYaw")
WHEEL_FRAMES = ("BaseWheelLeft", "BaseWheelRight")
"""Frames at the wheels of a differential base."""

_END = re.compile(r"</robot\s*>\s*(?:<!--.*?-->\s*|<\?.*?\?>\s*)*\Z", re.DOTALL)
"""Closing tag of a description, also if comments follow it."""
_KINDS = (("prismatic", "1 0 0"), ("prismatic", "0 1 0"), ("continuous", "0 0 1"))


@dataclass(frozen=True)
class Wheels:
    """Limits of the wheels of a base.

    Attributes:
        speed: Maximum speed of a wheel's rim, and so of the base [m/s].
        acceleration: Maximum acceleration of a wheel's rim [m/s^2].
        track: Distance between the left and the right wheel [m].
        turning_radius: Minimum radius of the curves on which a differential base is planned [m].
        backward: Whether planned curves may go backward, too.
        reach: Maximum distance of the base from the world's origin along each axis [m].
        differential: Whether the base moves only where it points; set by `load_robot(base="differential")`.
    """

    speed: float
    acceleration: float
    track: float
    turning_radius: float = 0.3
    backward: bool = True
    reach: float = 10.0
    differential: bool = False

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: for a number that is not above zero.
        """
        units = {"speed": "m/s", "acceleration": "m/s^2", "track": "m", "turning_radius": "m", "reach": "m"}
        for name, unit in units.items():
            object.__setattr__(self, name, check_positive(f"wheels: {name}", getattr(self, name), unit))

    def limits(self) -> dict[str, tuple[float, float]]:
        """Return the maximum speed [m/s or rad/s] and acceleration [per second] of each joint of the base.

        The wheels of a differential base use half of their acceleration for translation in any direction and
        half for rotation; their speed is limited at the wheels (`WHEEL_FRAMES`).
        """
        turning = 2.0 * self.speed / self.track
        if not self.differential:
            straight, twist = self.acceleration, 2.0 * self.acceleration / self.track
        else:
            straight, twist = self.acceleration / (2.0 * math.sqrt(2.0)), self.acceleration / self.track
        return {
            "BaseX": (self.speed, straight),
            "BaseY": (self.speed, straight),
            "BaseYaw": (turning, twist),
        }


def with_wheels(document: UrdfDocument, base: str, wheels: Wheels | None) -> UrdfDocument:
    """Return a document with a robot on a fixed, planar or differential base.

    Raises:
        InvalidValueError: for another base, wheels of a fixed base, or a differential base without wheels.
        ModelError: for a robot that has joints or links with the names of the base already.
    """
    check_choice("base", base, BASES)
    if base == "fixed":
        if wheels is not None:
            raise InvalidValueError("wheels", wheels, "None for a fixed base")
        return document
    if base == "differential":
        if wheels is None:
            raise InvalidValueError(
                "wheels", None, "Wheels(speed, acceleration, track, turning_radius) of the base"
            )
        wheels = replace(wheels, differential=True)
    taken = [name for name in (joint.name for joint in document.joints) if name in BASE_JOINTS]
    taken += [name for name in document.links if name in WHEEL_FRAMES]
    if taken:
        raise ModelError(f"URDF: the robot has {', '.join(taken)} already: load it with base='fixed'")
    reach = Wheels.reach if wheels is None else wheels.reach
    moving = on_planar_base(document, "base", reach, {} if wheels is None else wheels.limits())
    if wheels is not None and wheels.differential:
        moving = _with_wheel_frames(moving, document.root, wheels.track)
    return replace(moving, wheels=wheels)


def on_planar_base(
    document: UrdfDocument, prefix: str, reach: float, limits: dict[str, tuple[float, float]]
) -> UrdfDocument:
    """Return a document with `BASE_JOINTS` between the world and its root link.

    Args:
        document: The robot.
        prefix: Prefix of the names of the added links.
        reach: Maximum magnitude of x and y [m].
        limits: Joint -> maximum speed [m/s or rad/s] and acceleration [per second]; inf for joints left out.
    """
    links = [_free_name(document, f"{prefix}_{name}") for name in ("world", "x", "y")]
    joints, elements = [], [f"  <link name={saxutils.quoteattr(name)}/>" for name in links]
    children = (*links[1:], document.root)
    for name, (kind, axis), parent, child in zip(BASE_JOINTS, _KINDS, links, children, strict=True):
        bound = reach if kind == "prismatic" else math.inf
        speed, acceleration = limits.get(name, (math.inf, math.inf))
        joints.append(
            Joint(name, kind, parent, child, -bound, bound, speed, acceleration, math.inf, mimic=None)
        )
        attributes = (
            f' velocity="{speed!r}" acceleration="{acceleration!r}"' if name in limits else ' velocity="1e3"'
        )
        ends = f"<parent link={saxutils.quoteattr(parent)}/><child link={saxutils.quoteattr(child)}/>"
        limit = f'<limit lower="{-reach}" upper="{reach}" effort="1e6"{attributes}/>'
        elements.append(f'  <joint name="{name}" type="{kind}">{ends}<axis xyz="{axis}"/>{limit}</joint>')
    moving = _extended(document, elements)
    return replace(moving, links=(*links, *document.links), joints=(*joints, *document.joints))


def _with_wheel_frames(document: UrdfDocument, root: str, track: float) -> UrdfDocument:
    """Return a document with `WHEEL_FRAMES` fixed to the root link, half a track to its left and right."""
    joints, elements, parent = [], [], saxutils.quoteattr(root)
    for name, y in zip(WHEEL_FRAMES, (0.5 * track, -0.5 * track), strict=True):
        joint = f"{name}Joint"
        joints.append(Joint(joint, "fixed", root, name, 0.0, 0.0, math.inf, math.inf, math.inf, mimic=None))
        elements += [
            f'  <link name="{name}"/>',
            f'  <joint name="{joint}" type="fixed"><parent link={parent}/><child link="{name}"/>'
            f'<origin xyz="0 {y!r} 0"/></joint>',
        ]
    extended = _extended(document, elements)
    return replace(extended, links=(*document.links, *WHEEL_FRAMES), joints=(*document.joints, *joints))


def _extended(document: UrdfDocument, elements: list[str]) -> UrdfDocument:
    """Return a document with elements added before the closing tag of its text."""
    end = _END.search(document.text)
    assert end is not None  # the text was parsed
    head, tail = document.text[: end.start()], document.text[end.start() :]
    return replace(document, text="\n".join([head.rstrip(), *elements, tail]))


def _free_name(document: UrdfDocument, name: str) -> str:
    """Return a name that no link has, made by appending underscores."""
    while name in document.links:
        name += "_"
    return name
