"""The modules as services of libqi, for any `qi` client on this machine (extra `naoqi`)."""

from __future__ import annotations

import inspect
import os
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from pepper_kin.exceptions import InvalidValueError, MissingDependencyError
from pepper_kin.naoqi.broker import Broker
from pepper_kin.naoqi.memory import Signal, Subscriber
from pepper_kin.naoqi.module import Module, robot_signatures

LOOPBACK = ("127.0.0.1", "localhost", "::1")

TYPES = {
    "any": "m",
    "str": "s",
    "bool": "b",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "void": "v",
    "obj": "o",
    "Vec<str>": "[s]",
    "Vec<float32>": "[f]",
    "Map<str, str>": "{ss}",
    "unknown": "m",
}
"""Type of the robot's list -> signature of libqi."""

ARRIVING = ("moveTo", "walkTo")
"""Methods that say whether they arrived, which the list calls void and the documents do not."""

PICTURE = "(iiiiiiriffff)"
"""What the methods that return a picture return: only declared bytes cross the wire as bytes."""

RETURNS = {"getImageRemote": PICTURE, "getImageLocal": PICTURE}

MOST_ARGUMENTS = 6
"""Arguments that a method with any number of them takes over the wire."""


def libqi() -> Any:
    """Return the module `qi`.

    Raises:
        MissingDependencyError: where it is not installed.
    """
    os.environ.setdefault("QI_LOG_LEVEL", "2")  # warnings; libqi logs each service that it registers
    try:
        import qi
    except ImportError as error:
        raise MissingDependencyError("qi", "hosting modules for NAOqi's clients", "naoqi") from error
    return qi


class Host:
    """A server of libqi with all modules of a broker.

    Args:
        broker: The simulated robot.
        address: Where to listen; loopback only unless `allow_remote`.
        port: Where to listen; 0 for any free port.
        allow_remote: Whether other machines may connect.  There is no encryption and no password.

    Attributes:
        url: Where clients connect, "tcp://127.0.0.1:9559".

    Raises:
        MissingDependencyError: where `qi` is not installed.
        InvalidValueError: for an address that is not this machine's, without `allow_remote`.
    """

    def __init__(
        self, broker: Broker, address: str = "127.0.0.1", port: int = 9559, *, allow_remote: bool = False
    ) -> None:
        if address not in LOOPBACK and not allow_remote:
            raise InvalidValueError("address", address, f"one of {', '.join(LOOPBACK)}, or allow_remote")
        qi = libqi()
        self.broker = broker
        self._session = qi.Session()
        self._session.listenStandalone(f"tcp://{address}:{port}")
        self.url = str(self._session.endpoints()[0])
        self._services = [service_of(broker.module(name), qi) for name in broker.module_names]
        for name, service in zip(broker.module_names, self._services, strict=True):
            self._session.registerService(name, service)

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the server."""
        self._session.close()

    def wait(self) -> None:
        """Serve until Ctrl-C."""
        ended = threading.Event()
        while not ended.wait(0.5):
            pass


def service_of(module: Module, qi: Any) -> Any:
    """Return an object that libqi can register: each method with each number of arguments that it takes."""
    methods: dict[str, Any] = {}
    for name, signature, returns in wire_methods(module):
        bound = _caller(getattr(module, name), len(signature), qi, returns)
        bound.__qi_name__ = name
        bound.__qi_signature__ = f"({''.join(signature)})"
        bound.__qi_return_signature__ = returns
        methods[f"{name}_{len(methods)}"] = bound
    for name, value in vars(module).items():
        if isinstance(value, Signal) and not name.startswith("_"):
            methods[name] = value
    kind = type(f"{module.name}Service", (), {**methods, "__doc__": inspect.getdoc(type(module)) or ""})
    return qi.multiThreaded()(kind)()


def wire_methods(module: Module) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield name, types of the arguments and type of the result, as libqi writes them, of all methods."""
    listed = [s for s in robot_signatures() if s.module == module.name]
    known_arities: set[tuple[str, int]] = set()
    for s in listed:
        types = tuple(TYPES[kind] for _, kind in s.parameters)
        known_arities.add((s.name, len(types)))
        yield s.name, types, "b" if s.name in ARRIVING else TYPES[s.returns]
    known = {s.name for s in listed}
    for name in module.getMethodList():
        if name in known:
            continue
        for count in _counts(getattr(module, name)):
            if (name, count) not in known_arities:
                known_arities.add((name, count))
                yield name, ("m",) * count, RETURNS.get(name, "m")


def _counts(method: Callable[..., Any]) -> list[int]:
    """Return the numbers of arguments that a method takes."""
    least, most = 0, 0
    for parameter in inspect.signature(method).parameters.values():
        if parameter.kind is parameter.VAR_POSITIONAL:
            most = MOST_ARGUMENTS
        elif parameter.kind is not parameter.KEYWORD_ONLY:
            most += 1
            least += parameter.default is parameter.empty
    return list(range(least, most + 1))


def _caller(method: Callable[..., Any], count: int, qi: Any, returns: str) -> Any:
    """Return a function with exactly so many arguments, which libqi can bind; errors keep their text."""

    def call(*arguments: Any) -> Any:
        try:
            value = method(*map(as_plain, arguments))
            if returns == PICTURE:
                return tuple(value)
            return None if returns == "v" else as_wire(value, qi)
        except Exception as error:
            promise = qi.Promise()
            promise.setError(str(error))
            return promise.future()

    names = ", ".join(f"a{k}" for k in range(count))
    space: dict[str, Any] = {"call": call}
    exec(f"def bound(self{', ' if names else ''}{names}):\n    return call({names})", space)
    return space["bound"]


def as_plain(value: Any) -> Any:
    """Return a value from the wire as lists, numbers, strings and dictionaries."""
    if isinstance(value, tuple | list):
        return [as_plain(one) for one in value]
    return value


def as_wire(value: Any, qi: Any) -> Any:
    """Return a value as libqi sends it."""
    if isinstance(value, Subscriber):
        return _wire_subscriber(value, qi)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple | list):
        return [as_wire(one, qi) for one in value]
    return value


def _wire_subscriber(subscriber: Subscriber, qi: Any) -> Any:
    """Return the object of libqi with the signal of an event, made once."""
    kept = subscriber.__dict__.get("_wire")
    if kept is None:
        kept = type("Subscriber", (), {})()
        kept.signal = qi.Signal("(m)")
        subscriber.signal.connect(lambda value: kept.signal(as_wire(value, qi)))
        subscriber.__dict__["_wire"] = kept
    return kept
