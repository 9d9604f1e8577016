"""A base on wheels under any robot: three more joints, and what the wheels can do."""

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
"""Frames where the wheels of a differential base stand."""

_END = re.compile(r"</robot\s*>\s*(?:<!--.*?-->\s*|<\?.*?\?>\s*)*\Z", re.DOTALL)
"""The end of a description: what comments hold that follow the robot is not it."""
_KINDS = (("prismatic", "1 0 0"), ("prismatic", "0 1 0"), ("continuous", "0 0 1"))


@dataclass(frozen=True)
class Wheels:
    """What the wheels of a base can do.

    Attributes:
        speed: Greatest speed of a wheel's rim, and so of the base [m/s].
        acceleration: Its greatest acceleration [m/s^2].
        track: Distance between the left and the right wheel [m].
        turning_radius: Least radius of the curves that a differential base is planned on [m].
        backward: Whether these go backward too.
        reach: How far from the world's origin the base may be, along each axis [m].
        differential: Whether the base goes where it points, as `load_robot(base="differential")` says.
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
            InvalidValueError: for one that is not above zero.
        """
        units = {"speed": "m/s", "acceleration": "m/s^2", "track": "m", "turning_radius": "m", "reach": "m"}
        for name, unit in units.items():
            object.__setattr__(self, name, check_positive(f"wheels: {name}", getattr(self, name), unit))

    def limits(self) -> dict[str, tuple[float, float]]:
        """Return greatest speed and acceleration of each of the base's joints.

        A differential base's wheels share their acceleration, half for going and half for turning, whatever
        the base's direction; their speed is limited by itself (`WHEEL_FRAMES`).
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
    """Return a robot's document on a base of a kind.

    Raises:
        InvalidValueError: for another kind, wheels of a fixed base, or a differential base without wheels.
        ModelError: for a robot that has joints or links of these names already.
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
        prefix: Of the names of the links between.
        reach: Bound of x and y [m].
        limits: Greatest speed and acceleration of the joints; no limit where there is none.
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
    end = _END.search(document.text)
    assert end is not None  # the text was parsed
    head, tail = document.text[: end.start()], document.text[end.start() :]
    return replace(document, text="\n".join([head.rstrip(), *elements, tail]))


def _free_name(document: UrdfDocument, name: str) -> str:
    while name in document.links:
        name += "_"
    return name
