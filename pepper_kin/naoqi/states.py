"""Modules that keep states.

Autonomous life, awareness, the system, the tablet, subscriptions to extractors.
"""

from __future__ import annotations

from typing import Any

from pepper_kin.naoqi.errors import NotSimulatedError, quoted
from pepper_kin.naoqi.module import VERSION, Module
from pepper_kin.naoqi.tables import table

LIFE = ("solitary", "interactive", "safeguard", "disabled")


class ALAutonomousLife(Module):
    """The state of the autonomous life; the twin does nothing by itself."""

    name = "ALAutonomousLife"

    def setState(self, state: str) -> None:
        """Set "solitary", "interactive", "safeguard" or "disabled"."""
        if state not in LIFE:
            raise self.fail("setState", f"state: got {quoted(state)}, expected one of {', '.join(LIFE)}")
        self.kept["state",] = state
        self.broker.memory.raiseEvent("AutonomousLife/State", state)

    def switchFocus(self, activity: str, *_: Any) -> None:
        """Refuse: no activity is installed."""
        raise NotSimulatedError(self.name, "switchFocus", f"the activity {quoted(activity)} is not installed")

    def getAutonomousAbilitiesStatus(self) -> list[dict[str, Any]]:
        """Return name, "enabled" and "running" of the abilities that were set."""
        return [
            {"name": key[1], "enabled": on, "running": False}
            for key, on in self.kept.items()
            if key[0] == "ability"
        ]


class ALBasicAwareness(Module):
    """The state of the awareness; nobody is around."""

    name = "ALBasicAwareness"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._paused = False

    def isAwarenessRunning(self) -> bool:
        """Return whether it runs."""
        return bool(self.isEnabled() and not self._paused)

    def isAwarenessPaused(self) -> bool:
        """Return whether it is paused."""
        return self._paused

    def isRunning(self, *arguments: Any) -> bool:
        """Return whether it runs, or a posted call does."""
        return super().isRunning(*arguments) if arguments else self.isAwarenessRunning()

    def pauseAwareness(self) -> bool:
        """Pause."""
        self._paused = True
        return True

    def resumeAwareness(self) -> bool:
        """Go on."""
        self._paused = False
        return True

    def resetAllParameters(self) -> None:
        """Forget the parameters."""
        self.kept = {key: value for key, value in self.kept.items() if key[0] != "parameter"}


class ALSystem(Module):
    """Names and versions; the twin is never shut down by a script."""

    name = "ALSystem"

    def systemVersion(self) -> str:
        """Return the version."""
        return VERSION

    def systemInfo(self) -> dict[str, str]:
        """Return name and version."""
        return {"name": self.robotName(), "version": VERSION}

    def reboot(self) -> None:
        """Refuse."""
        raise NotSimulatedError(self.name, "reboot", "scripts do not restart the twin")

    def shutdown(self) -> None:
        """Refuse."""
        raise NotSimulatedError(self.name, "shutdown", "scripts do not end the twin")


class ALBattery(Module):
    """A full battery."""

    name = "ALBattery"


class ALRobotModel(Module):
    """What the robot is and has."""

    name = "ALRobotModel"


class ALTouch(Module):
    """Which touch sensors and bumpers are pressed."""

    name = "ALTouch"

    def getSensorList(self) -> list[str]:
        """Return the sensors, by the robot's names: "Head/Touch/Front"."""
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
        """Return [name, value] of a domain."""
        return [[setting, value] for (_, other, setting), value in self.kept.items() if other == domain]

    def removeValue(self, domain: str, setting: str) -> None:
        """Forget a preference."""
        self.kept.pop(("value", domain, setting), None)

    def getDomainList(self) -> list[str]:
        """Return the domains that have a preference."""
        return sorted({key[1] for key in self.kept})

    def removeDomainValues(self, domain: str) -> None:
        """Forget the preferences of a domain."""
        for key in [key for key in self.kept if key[1] == domain]:
            del self.kept[key]

    def setValues(self, values: dict[str, dict[str, Any]]) -> None:
        """Keep preferences: {domain: {setting: value}}."""
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
