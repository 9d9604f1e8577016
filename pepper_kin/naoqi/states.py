"""Modules that only keep states.

Autonomous life, awareness, system, battery, robot model, touch sensors and preferences.
"""

from __future__ import annotations

from typing import Any

from pepper_kin.naoqi.errors import NotSimulatedError, quoted
from pepper_kin.naoqi.module import VERSION, Module
from pepper_kin.naoqi.tables import table

LIFE = ("solitary", "interactive", "safeguard", "disabled")


class ALAutonomousLife(Module):
    """The state of the autonomous life, which has no effect on the twin."""

    name = "ALAutonomousLife"

    def setState(self, state: str) -> None:
        """Set "solitary", "interactive", "safeguard" or "disabled"."""
        if state not in LIFE:
            raise self.fail("setState", f"state: got {quoted(state)}, expected one of {', '.join(LIFE)}")
        self.kept["state",] = state
        self.broker.memory.raiseEvent("AutonomousLife/State", state)

    def switchFocus(self, activity: str, *_: Any) -> None:
        """Raise NotSimulatedError: no activity is installed."""
        raise NotSimulatedError(self.name, "switchFocus", f"the activity {quoted(activity)} is not installed")

    def getAutonomousAbilitiesStatus(self) -> list[dict[str, Any]]:
        """Return name, "enabled" and "running" of the abilities that were set."""
        return [
            {"name": key[1], "enabled": on, "running": False}
            for key, on in self.kept.items()
            if key[0] == "ability"
        ]


class ALBasicAwareness(Module):
    """The state of the awareness, which never detects a person."""

    name = "ALBasicAwareness"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._paused = False

    def isAwarenessRunning(self) -> bool:
        """Return whether the awareness runs."""
        return bool(self.isEnabled() and not self._paused)

    def isAwarenessPaused(self) -> bool:
        """Return whether the awareness is paused."""
        return self._paused

    def isRunning(self, *arguments: Any) -> bool:
        """Return whether the awareness, or the posted call with a number, runs."""
        return super().isRunning(*arguments) if arguments else self.isAwarenessRunning()

    def pauseAwareness(self) -> bool:
        """Pause the awareness; return True."""
        self._paused = True
        return True

    def resumeAwareness(self) -> bool:
        """Resume the awareness; return True."""
        self._paused = False
        return True

    def resetAllParameters(self) -> None:
        """Remove all parameters."""
        self.kept = {key: value for key, value in self.kept.items() if key[0] != "parameter"}


class ALSystem(Module):
    """Names and versions; scripts cannot shut down the twin."""

    name = "ALSystem"

    def systemVersion(self) -> str:
        """Return the version of NAOqi."""
        return VERSION

    def systemInfo(self) -> dict[str, str]:
        """Return name of the robot and version of NAOqi."""
        return {"name": self.robotName(), "version": VERSION}

    def reboot(self) -> None:
        """Raise NotSimulatedError."""
        raise NotSimulatedError(self.name, "reboot", "scripts do not restart the twin")

    def shutdown(self) -> None:
        """Raise NotSimulatedError."""
        raise NotSimulatedError(self.name, "shutdown", "scripts do not end the twin")


class ALBattery(Module):
    """A full battery."""

    name = "ALBattery"


class ALRobotModel(Module):
    """The robot's type and equipment."""

    name = "ALRobotModel"


class ALTouch(Module):
    """The states of touch sensors and bumpers."""

    name = "ALTouch"

    def getSensorList(self) -> list[str]:
        """Return the robot's names of the sensors, as "Head/Touch/Front"."""
        return list(table("devices")["touches"])

    def getStatus(self) -> list[list[Any]]:
        """Return [name, whether touched, []] of each sensor."""
        with self.body.time.lock:
            touched = self.broker.memory.devices.touched
            return [[name, touched(own), []] for name, own in table("devices")["touches"].items()]


class ALPreferenceManager(Module):
    """Preferences by domain and name."""

    name = "ALPreferenceManager"

    def getValueList(self, domain: str) -> list[list[Any]]:
        """Return [name, value] of each preference of a domain."""
        return [[setting, value] for (_, other, setting), value in self.kept.items() if other == domain]

    def removeValue(self, domain: str, setting: str) -> None:
        """Remove a preference."""
        self.kept.pop(("value", domain, setting), None)

    def getDomainList(self) -> list[str]:
        """Return the domains that have a preference."""
        return sorted({key[1] for key in self.kept})

    def removeDomainValues(self, domain: str) -> None:
        """Remove the preferences of a domain."""
        for key in [key for key in self.kept if key[1] == domain]:
            del self.kept[key]

    def setValues(self, values: dict[str, dict[str, Any]]) -> None:
        """Set preferences, {domain: {setting: value}}."""
        for domain, settings in values.items():
            self.kept.update({("value", domain, setting): value for setting, value in settings.items()})


MODULES = (
    ALAutonomousLife,
    ALBasicAwareness,
    ALSystem,
    ALBattery,
    ALRobotModel,
    ALTouch,
    ALPreferenceManager,
)
