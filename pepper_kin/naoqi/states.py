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

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._state = "disabled"
        self._safeguard: dict[str, bool] = {}
        self._abilities: dict[str, bool] = {}

    def setState(self, state: str) -> None:
        """Set "solitary", "interactive", "safeguard" or "disabled"."""
        if state not in LIFE:
            raise self.fail("setState", f"state: got {quoted(state)}, expected one of {', '.join(LIFE)}")
        self._state = state
        self.broker.memory.raiseEvent("AutonomousLife/State", state)

    def getState(self) -> str:
        """Return the state."""
        return self._state

    def focusedActivity(self) -> str:
        """Return the activity in focus: none."""
        return ""

    def stopAll(self) -> None:
        """Stop activities: there are none."""

    def stopFocus(self) -> None:
        """Stop the activity in focus: there is none."""

    def switchFocus(self, activity: str, *_: Any) -> None:
        """Refuse: no activity is installed."""
        raise NotSimulatedError(self.name, "switchFocus", f"the activity {quoted(activity)} is not installed")

    def setSafeguardEnabled(self, name: str, enabled: bool) -> None:
        """Keep whether a safeguard is on."""
        self._safeguard[name] = bool(enabled)

    def isSafeguardEnabled(self, name: str) -> bool:
        """Return whether a safeguard is on."""
        return self._safeguard.get(name, True)

    def setAutonomousAbilityEnabled(self, ability: str, enabled: bool) -> None:
        """Keep whether an ability is on."""
        self._abilities[ability] = bool(enabled)

    def getAutonomousAbilityEnabled(self, ability: str) -> bool:
        """Return whether an ability is on."""
        return self._abilities.get(ability, False)

    def getAutonomousAbilitiesStatus(self) -> list[dict[str, Any]]:
        """Return name, "enabled" and "running" of the abilities that were set."""
        return [{"name": n, "enabled": on, "running": False} for n, on in self._abilities.items()]


class ALBasicAwareness(Module):
    """The state of the awareness; nobody is around."""

    name = "ALBasicAwareness"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._on = self._paused = False
        self._engagement, self._tracking = "Unengaged", "Head"
        self._stimuli: dict[str, bool] = {}
        self._parameters: dict[str, Any] = {}

    def startAwareness(self) -> None:
        """Switch it on."""
        self._on = True

    def stopAwareness(self) -> None:
        """Switch it off."""
        self._on = False

    def setEnabled(self, enabled: bool) -> None:
        """Switch it on or off."""
        self._on = bool(enabled)

    def isEnabled(self) -> bool:
        """Return whether it is on."""
        return self._on

    def isAwarenessRunning(self) -> bool:
        """Return whether it runs."""
        return self._on and not self._paused

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

    def setEngagementMode(self, modeName: str) -> None:
        """Set "Unengaged", "FullyEngaged" or "SemiEngaged"."""
        self._engagement = str(modeName)

    def getEngagementMode(self) -> str:
        """Return the mode of engagement."""
        return self._engagement

    def setTrackingMode(self, modeName: str) -> None:
        """Set "Head", "BodyRotation", "WholeBody" or "MoveContextually"."""
        self._tracking = str(modeName)

    def getTrackingMode(self) -> str:
        """Return the mode of tracking."""
        return self._tracking

    def setStimulusDetectionEnabled(self, stimulusName: str, isStimulusDetectionEnabled: bool) -> None:
        """Keep whether a stimulus is looked for."""
        self._stimuli[stimulusName] = bool(isStimulusDetectionEnabled)

    def isStimulusDetectionEnabled(self, stimulusName: str) -> bool:
        """Return whether a stimulus is looked for."""
        return self._stimuli.get(stimulusName, True)

    def setParameter(self, paramName: str, newVal: Any) -> None:
        """Keep a parameter."""
        self._parameters[paramName] = newVal

    def getParameter(self, paramName: str) -> Any:
        """Return a parameter."""
        return self._parameters.get(paramName)

    def resetAllParameters(self) -> None:
        """Forget the parameters."""
        self._parameters.clear()


class ALSystem(Module):
    """Names and versions; the twin is never shut down by a script."""

    name = "ALSystem"
    _name = "pepper"

    def robotName(self) -> str:
        """Return the name of the robot."""
        return self._name

    def setRobotName(self, name: str) -> bool:
        """Set the name of the robot."""
        self._name = str(name)
        return True

    def systemVersion(self) -> str:
        """Return the version."""
        return VERSION

    def systemInfo(self) -> dict[str, str]:
        """Return name and version."""
        return {"name": self._name, "version": VERSION}

    def timezone(self) -> str:
        """Return the time zone."""
        return "UTC"

    def freeMemory(self) -> int:
        """Return the free memory [kB]."""
        return 1_000_000

    def totalMemory(self) -> int:
        """Return the memory [kB]."""
        return 4_000_000

    def reboot(self) -> None:
        """Refuse."""
        raise NotSimulatedError(self.name, "reboot", "scripts do not restart the twin")

    def shutdown(self) -> None:
        """Refuse."""
        raise NotSimulatedError(self.name, "shutdown", "scripts do not end the twin")


class ALBattery(Module):
    """A full battery."""

    name = "ALBattery"

    def getBatteryCharge(self) -> int:
        """Return the charge [%]."""
        return 100


class ALRobotModel(Module):
    """What the robot is and has."""

    name = "ALRobotModel"

    def getRobotType(self) -> str:
        """Return the type of the robot."""
        return "Juliette"

    def hasArms(self) -> bool:
        """Return True."""
        return True

    def hasHands(self) -> bool:
        """Return True."""
        return True

    def hasLegs(self) -> bool:
        """Return False: Pepper stands on wheels."""
        return False

    def hasWheels(self) -> bool:
        """Return True."""
        return True

    def getConfigMap(self) -> list[list[str]]:
        """Return names and values of the configuration."""
        return [["RobotConfig/Body/Type", "Juliette"], ["RobotConfig/Body/BaseVersion", "V1.8"]]


class ALTouch(Module):
    """Which touch sensors and bumpers are pressed."""

    name = "ALTouch"

    def getSensorList(self) -> list[str]:
        """Return the sensors."""
        return list(table("devices")["touches"].values())

    def getStatus(self) -> list[list[Any]]:
        """Return [name, whether pressed] of each sensor."""
        with self.body.time.lock:
            return [[name, self.broker.memory.devices.touched(name)] for name in self.getSensorList()]


class ALPreferenceManager(Module):
    """Preferences by domain and name."""

    name = "ALPreferenceManager"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._values: dict[tuple[str, str], Any] = {}

    def setValue(self, domain: str, setting: str, value: Any) -> bool:
        """Keep a preference."""
        self._values[domain, setting] = value
        return True

    def getValue(self, domain: str, setting: str) -> Any:
        """Return a preference, or None."""
        return self._values.get((domain, setting))

    def getValueList(self, domain: str) -> list[list[Any]]:
        """Return [name, value] of a domain."""
        return [[setting, value] for (other, setting), value in self._values.items() if other == domain]

    def removeValue(self, domain: str, setting: str) -> None:
        """Forget a preference."""
        self._values.pop((domain, setting), None)


MODULES = (
    ALAutonomousLife,
    ALBasicAwareness,
    ALSystem,
    ALBattery,
    ALRobotModel,
    ALTouch,
    ALPreferenceManager,
)
