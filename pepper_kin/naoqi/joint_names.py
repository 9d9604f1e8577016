"""Names of NAOqi: joints, chains and effectors of Pepper."""

from __future__ import annotations

from collections.abc import Iterable

from pepper_kin.naoqi.errors import NaoqiError, quoted

HEAD = ("HeadYaw", "HeadPitch")
LEFT_ARM = ("LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw", "LHand")
RIGHT_ARM = ("RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll", "RWristYaw", "RHand")
LEG = ("HipRoll", "HipPitch", "KneePitch")
WHEELS = ("WheelFL", "WheelFR", "WheelB")
HANDS = ("LHand", "RHand")
BODY = (*HEAD, *LEFT_ARM, *LEG, *RIGHT_ARM, *WHEELS)
"""The order of `getBodyNames("Body")` on Pepper."""

ACTUATED = BODY[:-3]
"""Joints that hold a position: all but the wheels."""

CHAINS: dict[str, tuple[str, ...]] = {
    "Head": HEAD,
    "LArm": LEFT_ARM,
    "RArm": RIGHT_ARM,
    "Leg": LEG,
    "Legs": LEG,
    "Arms": (*LEFT_ARM, *RIGHT_ARM),
    "Wheels": WHEELS,
    "Body": BODY,
    "Actuators": BODY,
    "BodyActuators": BODY,
    "JointActuators": ACTUATED,
    "Joints": tuple(name for name in ACTUATED if name not in HANDS),
    "BodyJoints": tuple(name for name in ACTUATED if name not in HANDS),
}
"""Name of a chain -> its joints, in order."""

CHAIN_OF = {joint: chain for chain in ("Head", "LArm", "Leg", "RArm", "Wheels") for joint in CHAINS[chain]}
"""Name of a joint -> the chain that it belongs to."""

BASE_RESOURCES = ("WheelFL", "WheelFR", "WheelB")
"""Resources that a motion of the base uses."""


def names_of(value: object, module: str, method: str, *, wheels: bool = True) -> list[str]:
    """Return the joints of a name or a list of names of joints and chains.

    Args:
        value: Name of a joint or a chain, or a list of names.
        module: Module of the call, for the message.
        method: Method of the call, for the message.
        wheels: Whether "Body" and "Actuators" include the wheels.

    Raises:
        NaoqiError: for a value that is neither a name nor a list of names, or for an unknown name.
    """
    if isinstance(value, str):
        known = CHAINS.get(value)
        if known is None and value in CHAIN_OF:
            known = (value,)
        if known is None:
            raise NaoqiError(module, method, f"{quoted(value)} is no joint and no chain; known: {_known()}")
        return [name for name in known if wheels or name not in WHEELS]
    if not isinstance(value, Iterable) or isinstance(value, bytes | dict):
        raise NaoqiError(module, method, f"names: got {quoted(value)}, expected a name or a list of names")
    found: list[str] = []
    for one in value:
        if not isinstance(one, str):
            raise NaoqiError(module, method, f"names: got {quoted(one)}, expected a string")
        found.extend(names_of(one, module, method, wheels=wheels))
    return found


def _known() -> str:
    return ", ".join((*CHAINS, *BODY))
