"""Diagnosis of a robot that does not answer or does not follow commands."""

from __future__ import annotations

import contextlib
import socket
import ssl
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi.errors import NaoqiError, RobotConnectionError
from pepper_kin.naoqi.link import PORT, RobotLink

SECURE_PORT = 9503
"""TCP port of NAOqi 2.9, encrypted."""

WAIT = 3.0
"""Default timeout of an answer [s]."""

HOT = 70.0
"""Temperature from which motors are called hot [degrees Celsius] (assumed: no document gives a number)."""

_KNOWN = ("2.4", "2.5")


class Finding(NamedTuple):
    """One cause that prevents motions, or may surprise.

    Attributes:
        cause: Short name: "nothing listens", "no answer", "encrypted", "password", ...
        what: Observation.
        advice: Advice: what to do.
        hinders: Whether motions fail until the cause is removed.
    """

    cause: str
    what: str
    advice: str
    hinders: bool = True


def examine(address: str, token: str | None = None, timeout: float = WAIT) -> list[Finding]:
    """Return the causes that prevent motions of a robot, or may surprise; nothing is moved or changed.

    Args:
        address: Address, as "pepper.local" or "tcp://192.168.1.7:9559".
        token: Token of a simulated robot that requires one.
        timeout: Timeout of each answer [s].

    Returns:
        The findings; empty if the robot is ready.

    Raises:
        InvalidValueError: for an address without a host.
        MissingDependencyError: if `qi` is not installed.
    """
    url = address if "://" in address else f"tcp://{address}"
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port or PORT
    except ValueError:
        host, port = None, 0
    if not host:
        raise InvalidValueError("address", repr(address), "a host, or tcp://HOST:PORT")
    network = _network(host, port, timeout)
    if network is not None:
        return [network]
    link: RobotLink | None = None
    try:
        link = RobotLink(f"tcp://{host}:{port}", token, timeout)
        names = link.names()
        return [found for check in _CHECKS for found in check(link, names)]
    except (RobotConnectionError, NaoqiError) as error:
        return [_refused(str(error))]
    finally:
        if link is not None:
            with contextlib.suppress(Exception):
                link.close()


def _network(host: str, port: int, timeout: float) -> Finding | None:
    """Return why there is no unencrypted connection, or None if there is one."""
    where = f"{host}:{port}"
    try:
        socket.create_connection((host, port), timeout).close()
    except TimeoutError:
        return Finding(
            "no answer", f"{where} did not answer within {timeout:g} s",
            "check that both are in one network, and that no firewall drops connections to this port",
        )  # fmt: skip
    except socket.gaierror:
        return Finding(
            "unknown host", f"no address is known for {host}",
            "press the button on the chest: the robot says its address; give that",
        )  # fmt: skip
    except OSError as error:
        if port != SECURE_PORT and _is_encrypted(host, SECURE_PORT, timeout):
            return _encrypted(f"{where} is closed, {host}:{SECURE_PORT} answers encrypted")
        return Finding(
            "nothing listens", f"{where}: {error.strerror or error}",
            "switch the robot on and wait two minutes for NAOqi; the port is usually 9559",
        )  # fmt: skip
    if _is_encrypted(host, port, timeout):
        return _encrypted(f"{where} answers encrypted")
    return None


def _is_encrypted(host: str, port: int, timeout: float) -> bool:
    """Return whether a port accepts a TLS connection."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE  # no confidential data is sent
    try:
        with socket.create_connection((host, port), timeout) as plain, context.wrap_socket(plain):
            return True
    except OSError:
        return False


def _encrypted(what: str) -> Finding:
    return Finding(
        "encrypted", what,
        "this is NAOqi 2.9, whose API is Android's QiSDK; its ALMotion takes only tcps with the user nao and "
        "its password, which this library does not speak",
    )  # fmt: skip


def _refused(reason: str) -> Finding:
    """Return the finding for a connection that NAOqi refused or did not understand."""
    said = reason.splitlines()[-1].strip()
    if any(word in reason.lower() for word in ("authenti", "password", "token")):
        return Finding("password", said, "give the password or the token that the robot asks for")
    return Finding(
        "no NAOqi", said,
        "something listens that does not speak NAOqi's protocol: check address and port, restart NAOqi",
    )  # fmt: skip


def _data(link: RobotLink, key: str) -> Any:
    """Return the value of a key, or None if the robot does not have it."""
    try:
        return link.call("ALMemory", "getData", key)
    except NaoqiError:
        return None


def _asked(link: RobotLink, module: str, method: str, *arguments: Any) -> Any:
    """Return the value of a method, or None if the robot returns an error."""
    try:
        return link.call(module, method, *arguments)
    except NaoqiError:
        return None


def _version(link: RobotLink, names: list[str]) -> Iterator[Finding]:
    """Check that ALMotion runs, and which robot and version it is."""
    if "ALMotion" not in names:
        advice = "wait until NAOqi has started, or restart it: nao restart"
        yield Finding("no ALMotion", f"{len(names)} services, and ALMotion is none of them", advice)
        return
    kind, version = _data(link, "RobotConfig/Body/Type"), _asked(link, "ALSystem", "systemVersion")
    if kind is not None and str(kind).lower() not in ("juliette", "pepper"):
        yield Finding("wrong robot", f"it is a {kind}", "take a Pepper: limits and joints are others'")
    if version is not None and not str(version).startswith(_KNOWN):
        advice = f"this library was written for NAOqi {' and '.join(_KNOWN)}: try with the hand at the switch"
        yield Finding("wrong version", f"NAOqi {version}", advice, False)


def _hatch(link: RobotLink, _: list[str]) -> Iterator[Finding]:
    if _data(link, "BatteryTrapIsOpen"):
        yield Finding(
            "hatch open", "the hatch over the charging socket is open: the base does not drive",
            "unplug the robot and close the hatch at its back",
        )  # fmt: skip


def _life(link: RobotLink, _: list[str]) -> Iterator[Finding]:
    """Check that the autonomous life is disabled."""
    state = _asked(link, "ALAutonomousLife", "getState")
    if state not in (None, "disabled"):
        yield Finding(
            "autonomous life", f"the autonomous life is {state}: it moves the robot between your motions",
            'ALAutonomousLife.setState("disabled"), then ALMotion.wakeUp()',
        )  # fmt: skip


def _asleep(link: RobotLink, _: list[str]) -> Iterator[Finding]:
    if _asked(link, "ALMotion", "robotIsWakeUp") is False:
        yield Finding("asleep", "the motors are off", "ALMotion.wakeUp()")


def _hot(link: RobotLink, _: list[str]) -> Iterator[Finding]:
    """Check the temperatures of the motors."""
    names = _asked(link, "ALMotion", "getBodyNames", "Body") or []
    key = "Device/SubDeviceList/{}/Temperature/Sensor/Value"
    degrees = {name: _data(link, key.format(name)) for name in names if not str(name).startswith("Wheel")}
    hot = {name: value for name, value in degrees.items() if value is not None and value >= HOT}
    if hot:
        listed = ", ".join(f"{name} {value:.0f}" for name, value in hot.items())
        advice = "let them cool: ALMotion.rest() for some minutes; warm motors are weaker"
        yield Finding("motors hot", f"{listed} degrees Celsius", advice)


def _in_use(link: RobotLink, _: list[str]) -> Iterator[Finding]:
    tasks = _asked(link, "ALMotion", "getTaskList") or []
    if tasks:
        listed = ", ".join(sorted({str(task[0]) for task in tasks}))
        advice = "wait until the other program has ended, or ALMotion.killAll()"
        yield Finding("in use", f"motions of another program go on: {listed}", advice)


def _protection(link: RobotLink, _: list[str]) -> Iterator[Finding]:
    """Check whether collision protection is on, which changes motions, or off."""
    on = _asked(link, "ALMotion", "getExternalCollisionProtectionEnabled", "All")
    arms = _asked(link, "ALMotion", "getCollisionProtectionEnabled", "Arms")
    if on is False or arms is False:
        yield Finding(
            "protection off", "arms or base are not kept from what is near",
            'ALMotion.setExternalCollisionProtectionEnabled("All", True), '
            'setCollisionProtectionEnabled("Arms", True)',
            False,
        )  # fmt: skip
    elif on or arms:
        yield Finding(
            "protection on", "arms stop short of the body and of what is near; motions then end elsewhere",
            "keep 5 cm of clearance: plan(..., margin=0.05), and compare what was measured",
            False,
        )  # fmt: skip


_CHECKS: tuple[Callable[[RobotLink, list[str]], Iterator[Finding]], ...] = (
    _version, _hatch, _life, _asleep, _hot, _in_use, _protection,
)  # fmt: skip
