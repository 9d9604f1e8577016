"""ALMemory: data and events."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pepper_kin.naoqi.device_keys import DeviceKeys
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.tables import table

if TYPE_CHECKING:
    from pepper_kin.naoqi.broker import Broker

HISTORY = 100
"""Number of values kept of each event."""


class MemorySignal:
    """A signal: functions that are called with its values.

    `connect` returns a number for `disconnect`; calling the signal emits it.

    Args:
        signature: Types of the values; ignored.
        on_subscribers: Called with True when the first function is connected, and False after the last.
    """

    def __init__(self, signature: str = "m", on_subscribers: Callable[[bool], Any] | None = None) -> None:
        self._callbacks: dict[int, Callable[..., Any]] = {}
        self._number = 0
        self._lock = threading.Lock()
        self._on_subscribers = on_subscribers

    def connect(self, callback: Callable[..., Any], *_: Any, **__: Any) -> int:
        """Connect a function, which is called whenever the signal is emitted; return its number."""
        with self._lock:
            self._number += 1
            self._callbacks[self._number] = callback
            number, first = self._number, len(self._callbacks) == 1
        if first and self._on_subscribers is not None:
            self._on_subscribers(True)
        return number

    def disconnect(self, number: int, *_: Any) -> bool:
        """Disconnect a function; return whether it was connected."""
        with self._lock:
            known = self._callbacks.pop(number, None) is not None
            last = known and not self._callbacks
        if last and self._on_subscribers is not None:
            self._on_subscribers(False)
        return known

    def disconnectAll(self) -> bool:
        """Disconnect all functions."""
        for number in tuple(self._callbacks):
            self.disconnect(number)
        return True

    def __call__(self, *values: Any) -> None:
        """Emit the signal: call all connected functions."""
        for callback in tuple(self._callbacks.values()):
            callback(*values)

    emit = __call__


class Subscriber:
    """The signal of an event, as returned by `ALMemory.subscriber`."""

    def __init__(self) -> None:
        self.signal = MemorySignal()


class ALMemory(Module):
    """Data by key, events and their subscribers, and the keys of the devices."""

    name = "ALMemory"
    not_simulated = {"getDataPtr": "pointers have no meaning outside the robot's process"}  # noqa: RUF012

    def __init__(self, broker: Broker) -> None:
        super().__init__(broker)
        self._devices: DeviceKeys | None = None
        self._data: dict[str, Any] = {}
        self._stamps: dict[str, float] = {}
        self._descriptions: dict[str, str] = {}
        self._events: dict[str, str] = {}
        self._micro_events: set[str] = set()
        self._history: dict[str, list[Any]] = {}
        self._subscribers: dict[str, Subscriber] = {}
        self._callbacks: dict[tuple[str, str], int] = {}
        self._mappings: dict[tuple[str, str], str] = {}
        self._touched: dict[str, bool] = {}

    @property
    def devices(self) -> DeviceKeys:
        """Keys of the devices of the body."""
        if self._devices is None:
            self._devices = DeviceKeys(self.body)
        return self._devices

    # For other modules.

    def insert(self, key: str, value: Any) -> None:
        """Set the value of a key, and raise its event."""
        self.raiseEvent(key, value)

    def press(self, sensor: str, pressed: bool) -> None:
        """Press or release a bumper or a touch sensor of the twin, and raise its events."""
        (self.devices.pressed.add if pressed else self.devices.pressed.discard)(sensor)
        self.raiseEvent(table("devices")["events"][sensor], float(pressed))
        names = [name for name, own in table("devices")["touches"].items() if own == sensor]
        self.raiseEvent("TouchChanged", [[name, bool(pressed), []] for name in names])

    # Data.

    def getData(self, key: str, deprecatedParameter: int = 0) -> Any:
        """Return the value of a key.

        Raises:
            NaoqiError: for a key without a value.
        """
        if key in self._data:
            return self._data[key]
        if key in self.devices:
            return self.devices[key]
        raise self.fail("getData", f"unable to get data for key: {key}")

    def getListData(self, keyList: Any) -> list[Any]:
        """Return the values of keys, all from one cycle; None for keys without a value."""
        with self.body.time.lock:
            return [self._data.get(key, self.devices.get(key)) for key in keyList]

    def getDataOnChange(self, key: str, deprecatedParameter: int = 0) -> Any:
        """Wait until the value of a key changes; return it."""
        stamp = self._stamps.get(key)
        self.body.time.wait_until(lambda: self._stamps.get(key) != stamp)
        return self.getData(key)

    def getTimestamp(self, key: str) -> list[Any]:
        """Return the value of a key, and the wall time at which it was written: seconds, microseconds."""
        stamp = self._stamps.get(key, self.broker.wall_time())
        return [self.getData(key), int(stamp), int(stamp % 1.0 * 1e6)]

    def getDataList(self, filter: str) -> list[str]:
        """Return the keys that contain a text."""
        return [key for key in self.getDataListName() if filter in key]

    def getDataListName(self) -> list[str]:
        """Return all keys."""
        return sorted({*self._data, *self.devices.names})

    def getType(self, key: str) -> str:
        """Return the type of a key's value."""
        value = self.getData(key)
        names = {
            bool: "Bool",
            int: "Int",
            float: "Float",
            str: "String",
            list: "Array",
            tuple: "Array",
            dict: "Map",
        }
        return names.get(type(value), "Data")

    def insertData(self, key: str, value: Any) -> None:
        """Set the value of a key, without an event."""
        self._data[str(key)] = value
        self._stamps[str(key)] = self.broker.wall_time()

    def insertListData(self, list: Any) -> None:
        """Set the values of [key, value] pairs, without events."""
        for pair in list:
            self.insertData(pair[0], pair[1])

    def removeData(self, key: str) -> None:
        """Remove a key."""
        if self._data.pop(key, self) is self:
            raise self.fail("removeData", f"unable to find key: {key}")

    def setDescription(self, name: str, description: str) -> None:
        """Set the description of a key."""
        self._descriptions[name] = description

    def getDescriptionList(self, keylist: Any) -> list[list[str]]:
        """Return name, type and description of keys."""
        return [
            [key, self.getType(key) if key in self.getDataListName() else "", self._descriptions.get(key, "")]
            for key in keylist
        ]

    # Events.

    def declareEvent(self, eventName: str, extractorName: str = "") -> None:
        """Declare an event."""
        self._events[eventName] = extractorName

    def raiseEvent(self, name: str, value: Any) -> None:
        """Set the value of a key, and call the subscribers of its event."""
        self._events.setdefault(name, "")
        self.insertData(name, value)
        history = self._history.setdefault(name, [])
        history.append(value)
        del history[:-HISTORY]
        subscriber = self._subscribers.get(name)
        if subscriber is not None:
            subscriber.signal(value)

    def raiseMicroEvent(self, name: str, value: Any) -> None:
        """Raise an event, which is listed as a micro event, too."""
        self._micro_events.add(name)
        self.raiseEvent(name, value)

    def subscriber(self, eventName: str) -> Subscriber:
        """Return the object with the signal of an event."""
        return self._subscribers.setdefault(eventName, Subscriber())

    def subscribeToEvent(
        self, name: str, callbackModule: str, callbackMessage: str, callbackMethod: str = ""
    ) -> None:
        """Call a module's method with (name, value, message) whenever an event is raised."""
        method, message = (callbackMethod, callbackMessage) if callbackMethod else (callbackMessage, "")
        module = self.broker.module(callbackModule)
        function = getattr(module, method)
        if (name, callbackModule) in self._callbacks:
            self.unsubscribeToEvent(name, callbackModule)

        def call(value: Any) -> None:
            _call_with(function, name, value, message)

        self._callbacks[name, callbackModule] = self.subscriber(name).signal.connect(call)

    def unsubscribeToEvent(self, name: str, callbackModule: str) -> None:
        """End a module's subscription to an event."""
        number = self._callbacks.pop((name, callbackModule), None)
        if number is None:
            raise self.fail("unsubscribeToEvent", f"{callbackModule} has not subscribed to {name}")
        self.subscriber(name).signal.disconnect(number)

    unsubscribeToMicroEvent = unsubscribeToEvent

    def subscribeToMicroEvent(
        self, name: str, callbackModule: str, callbackMessage: str, callbackMethod: str
    ) -> None:
        """Subscribe to an event, which is listed as a micro event, too."""
        self._micro_events.add(name)
        self.subscribeToEvent(name, callbackModule, callbackMessage, callbackMethod)

    def unregisterModuleReference(self, moduleName: str) -> None:
        """End all subscriptions of a module."""
        for name, module in tuple(self._callbacks):
            if module == moduleName:
                self.unsubscribeToEvent(name, module)

    def getSubscribers(self, name: str) -> list[str]:
        """Return the modules that have subscribed to an event."""
        return [module for event, module in self._callbacks if event == name]

    def getEventList(self) -> list[str]:
        """Return the events that were declared or raised, and those of the devices."""
        return sorted({*self._events, *table("devices")["events"].values()})

    def getMicroEventList(self) -> list[str]:
        """Return the micro events that were raised or subscribed to."""
        return sorted(self._micro_events)

    def getExtractorEvent(self, extractorName: str) -> list[str]:
        """Return the events that an extractor declared."""
        return [event for event, extractor in self._events.items() if extractor == extractorName]

    def getEventHistory(self, key: str) -> list[Any]:
        """Return the last values of an event, oldest first."""
        return list(self._history.get(key, []))

    def removeEvent(self, name: str) -> None:
        """Remove an event and its subscribers."""
        self._events.pop(name, None)
        self._subscribers.pop(name, None)

    def removeMicroEvent(self, name: str) -> None:
        """Remove a micro event and its subscribers."""
        self._micro_events.discard(name)
        self.removeEvent(name)

    def addMapping(self, service: str, signal: Any, event: str = "") -> None:
        """Raise events when signals of a service are emitted."""
        pairs = signal if isinstance(signal, dict) else {signal: event}
        module = self.broker.module(service)
        for name, raised in pairs.items():
            self._mappings[service, name] = raised
            emitter = getattr(module, name)
            emitter.connect(
                lambda *values, raised=raised: self.raiseEvent(raised, values[0] if values else None)
            )

    def look_for_touches(self) -> None:
        """Poll bumpers and touch sensors, and raise the events of those that have changed."""
        for sensor, event in table("devices")["events"].items():
            touched = self.devices.touched(sensor)
            if touched != self._touched.get(sensor, False):
                self._touched[sensor] = touched
                self.raiseEvent(event, float(touched))


def _call_with(function: Callable[..., Any], name: str, value: Any, message: str) -> None:
    """Call a function with as many of (name, value, message) as it takes: scripts use all forms."""
    code = getattr(function, "__code__", None)
    count = 3 if code is None or code.co_flags & 0x04 else code.co_argcount - (hasattr(function, "__self__"))
    everything = (name, value, message)
    function(*{0: (), 1: (value,), 2: (name, value)}.get(count, everything))
