"""ALMotion: methods for tasks, configuration, collision protection and breathing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pepper_kin import collision, dynamics, kinematics
from pepper_kin.naoqi.effectors import space_pose
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_names import BODY, CHAINS, WHEELS, names_of
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tables import table

BREATHING_CHAINS = ("Body", "Legs", "Arms", "LArm", "RArm", "Head")


class ConfigurationMethods(Module):
    """Methods of ALMotion for tasks, configuration, collision protection and breathing."""

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._breathing: dict[str, bool] = dict.fromkeys(BREATHING_CHAINS, False)
        self._idle_posture: dict[str, bool] = dict.fromkeys(BREATHING_CHAINS, False)
        self._breath: dict[str, float] = {"Bpm": 12.0, "Amplitude": 1.0}
        self._config: dict[str, Any] = {}
        self._breath_before: dict[str, float] = {}
        self.body.listeners.append(self._breathe)

    # Names and numbers of the robot.

    def getJointNames(self, name: str) -> list[str]:
        """Return the joints of a chain."""
        return names_of(name, self.name, "getJointNames")

    def getBodyNames(self, name: str) -> list[str]:
        """Return the joints of a chain, or the names of the chains for "Chains"."""
        if name == "Chains":
            return ["Head", "LArm", "Leg", "RArm"]
        return names_of(name, self.name, "getBodyNames")

    def getSensorNames(self) -> list[str]:
        """Return the names of the sensors."""
        return list(table("motion")["sensors"])

    def getLimits(self, name: str) -> list[list[float]]:
        """Return [min, max, velocity, torque] of joints [rad, rad/s, N m]."""
        pepper, rows = self.body.pepper, []
        for joint in names_of(name, self.name, "getLimits"):
            if joint in WHEELS:
                fastest = self.body.controller.base.geometry.wheel_speed_limit
                rows.append([-math.inf, math.inf, float(fastest), 1.4])
                continue
            k = self.body.index[joint]
            limits = (pepper.lower_limits, pepper.upper_limits, pepper.velocity_limits, pepper.effort_limits)
            rows.append([float(values[k]) for values in limits])
        return rows

    def getMotionCycleTime(self) -> int:
        """Return the period of ALMotion [ms]."""
        return round(CYCLE * 1000)

    def getRobotConfig(self) -> list[list[Any]]:
        """Return names and values of the configuration of the robot."""
        return [[*row] for row in table("motion")["robot_config"]]

    def getSummary(self) -> str:
        """Return a table of each joint's stiffness, command and sensor, and of the tasks."""
        lines = [
            "---------------------- Model ---------------------------",
            f"{'JointName':>16} {'Stiffness':>10} {'Command':>10} {'Sensor':>10}",
        ]
        with self.body.time.lock:
            for name in BODY:
                numbers = (self.body.stiffness[name], self.body.commanded(name), self.body.measured(name))
                lines.append(f"{name:>16} " + " ".join(f"{x:>10.6f}" for x in numbers))
        lines.append("---------------------- Tasks  --------------------------")
        lines += [f"{name:>24} {number:>6}" for name, number in self.getTaskList()]
        return "\n".join(lines) + "\n"

    def getMass(self, pName: str) -> float:
        """Return the mass of a joint's body, of a chain or of "Body" [kg]."""
        if pName in ("Body", "Actuators", "BodyActuators"):
            return float(dynamics.total_mass(self.body.pepper))
        return float(sum(mass for mass, _ in self._masses("getMass", pName, False)))

    def getCOM(self, pName: str, pSpace: int, pUseSensorValues: bool) -> list[float]:
        """Return the center of mass of a joint's body, of a chain or of "Body" in a frame [m]."""
        with self.body.time.lock:
            origin = space_pose(self.body, pSpace, bool(pUseSensorValues), self.name, "getCOM")
            if pName in ("Body", "Actuators", "BodyActuators"):
                q = self.body.configuration(bool(pUseSensorValues))
                point = np.asarray(dynamics.center_of_mass(self.body.pepper, q))
            else:
                parts = self._masses("getCOM", pName, bool(pUseSensorValues))
                total = sum(mass for mass, _ in parts)
                point = sum((mass * place for mass, place in parts), np.zeros(3)) / max(total, 1e-12)
        inverse = np.linalg.inv(origin)
        return [float(x) for x in inverse[:3, :3] @ point + inverse[:3, 3]]

    def _masses(self, method: str, name: str, use_sensors: bool) -> list[tuple[float, Any]]:
        """Return mass [kg] and center of mass in the world [m] of the body of each joint of a chain."""
        model = self.body.pepper.inner_model
        joints = ["HipRoll"] if name == "Torso" else names_of(name, self.name, method, wheels=False)
        q, parts = self.body.configuration(use_sensors), []
        for joint in joints:
            inertia = model.inertias[model.getJointId(joint)]
            pose = np.asarray(kinematics.frame_pose(self.body.pepper, q, table("motion")["frames"][joint]))
            parts.append((float(inertia.mass), pose[:3, :3] @ np.asarray(inertia.lever) + pose[:3, 3]))
        return parts

    def setMotionConfig(self, config: Any) -> None:
        """Set configuration values by pairs of name and value.

        The values, as ENABLE_FOOT_CONTACT_PROTECTION, have no effect on the twin.
        """
        for row in config or ():
            if not isinstance(row, list | tuple) or len(row) != 2:
                raise self.fail(
                    "setMotionConfig", f"config: got {quoted(row)}, expected pairs of name and value"
                )
            self._config[str(row[0])] = row[1]

    # Tasks and their resources.

    def getTaskList(self) -> list[list[Any]]:
        """Return [name, number] of each running or waiting task."""
        with self.body.time.lock:
            return [[task.name, task.number] for task in self.body.tasks]

    def areResourcesAvailable(self, resourceNames: Any) -> bool:
        """Return whether no running task uses any of the joints."""
        names = self._resources("areResourcesAvailable", resourceNames)
        with self.body.time.lock:
            return not self.body.tasks.booked & set(names)

    def killTask(self, motionTaskID: int) -> bool:
        """End a task; return whether a task with this number existed."""
        with self.body.time.lock:
            task = self.body.tasks.by_number(int(motionTaskID))
            if task is not None:
                self.body.tasks.kill([task], self.body)
            return task is not None

    def killTasksUsingResources(self, resourceNames: Any) -> None:
        """End the tasks that use or wait for any of the joints."""
        names = self._resources("killTasksUsingResources", resourceNames)
        with self.body.time.lock:
            self.body.tasks.stop(names, self.body)

    def killAll(self) -> None:
        """End all tasks."""
        with self.body.time.lock:
            self.body.tasks.stop(None, self.body)

    def _resources(self, method: str, names: Any) -> list[str]:
        return names_of(names, self.name, method)

    # Protection.

    def setCollisionProtectionEnabled(self, pChainName: str, pEnable: bool) -> bool:
        """Set whether arms are protected from collisions with the body."""
        for arm in self._arms("setCollisionProtectionEnabled", pChainName):
            self.body.protection.arms[arm].from_body = bool(pEnable)
        return True

    def getCollisionProtectionEnabled(self, pChainName: str) -> bool:
        """Return whether arms are protected from collisions with the body."""
        arms = self._arms("getCollisionProtectionEnabled", pChainName)
        return all(self.body.protection.arms[arm].from_body for arm in arms)

    def setExternalCollisionProtectionEnabled(self, pName: str, pEnable: bool) -> None:
        """Set whether "All", "Move", "Arms", "LArm" or "RArm" is protected from obstacles."""
        for name in self._protected("setExternalCollisionProtectionEnabled", pName):
            if name == "Move":
                self.body.move_protected = bool(pEnable)
            else:
                self.body.protection.arms[name].from_scene = bool(pEnable)

    def getExternalCollisionProtectionEnabled(self, pName: str) -> bool:
        """Return whether "All", "Move", "Arms", "LArm" or "RArm" is protected from obstacles."""
        arms = self.body.protection.arms
        return all(
            self.body.move_protected if name == "Move" else arms[name].from_scene
            for name in self._protected("getExternalCollisionProtectionEnabled", pName)
        )

    def getChainClosestObstaclePosition(self, pName: str, space: int) -> list[float]:
        """Return the point of the scene nearest to the robot, in a frame [m]."""
        method = "getChainClosestObstaclePosition"
        if self.body.scene is None:
            raise self.fail(method, "there is no obstacle")
        with self.body.time.lock:
            origin = space_pose(self.body, space, True, self.name, method)
            point = self.body.nearest_obstacle()
        if point is None:
            raise self.fail(method, "there is no obstacle within 3 m")
        inverse = np.linalg.inv(origin)
        return [float(x) for x in inverse[:3, :3] @ point + inverse[:3, 3]]

    def isCollision(self, pChainName: str) -> str:
        """Return "none", or the chain ("LArm", "RArm", "Arms") that touches the robot."""
        names_of(pChainName, self.name, "isCollision")
        with self.body.time.lock:
            touching = collision.contacts(self.body.pepper, self.body.configuration(True))
        sides = {f"{body[0]}Arm" for contact in touching for body in contact.names if body[:1] in "LRlr"}
        arms = sorted({side[0].upper() + side[1:] for side in sides})
        return "none" if not arms else arms[0] if len(arms) == 1 else "Arms"

    def _distance(self, method: str, which: str) -> float:
        return self.body.security_distance[which]

    def _set_distance(self, method: str, value: Any, which: str) -> None:
        distance = self.number(method, "securityDistance", value)
        if distance < 0:
            raise self.fail(method, f"securityDistance: got {distance:g}, expected 0 or more [m]")
        self.body.security_distance[which] = distance

    def _arms(self, method: str, name: Any) -> list[str]:
        arms = {"Arms": ["LArm", "RArm"], "LArm": ["LArm"], "RArm": ["RArm"], "Body": ["LArm", "RArm"]}.get(
            name
        )
        if arms is None:
            raise self.fail(method, f"got {quoted(name)}, expected Arms, LArm or RArm")
        return arms

    def _protected(self, method: str, name: Any) -> list[str]:
        """Return the protected parts, "Move", "LArm" and "RArm", of a name."""
        known = {
            "All": ["Move", "LArm", "RArm"],
            "Move": ["Move"],
            "Arms": ["LArm", "RArm"],
            "LArm": ["LArm"],
            "RArm": ["RArm"],
        }
        if name not in known:
            raise self.fail(method, f"got {quoted(name)}, expected one of {', '.join(known)}")
        return known[name]

    # Breathing and idling.

    def setBreathEnabled(self, pChain: str, pIsEnabled: bool) -> None:
        """Set whether a chain breathes while no task moves it."""
        self._breathing[self._breathing_chain("setBreathEnabled", pChain)] = bool(pIsEnabled)

    def getBreathEnabled(self, pChain: str) -> bool:
        """Return whether a chain breathes."""
        return self._breathing[self._breathing_chain("getBreathEnabled", pChain)]

    def setBreathConfig(self, pConfig: Any) -> None:
        """Set "Bpm" (breaths a minute, clipped to 5 to 30) and "Amplitude" (clipped to 0 to 1)."""
        method = "setBreathConfig"
        for row in pConfig:
            if not isinstance(row, list | tuple) or len(row) != 2 or row[0] not in self._breath:
                raise self.fail(method, f"got {quoted(row)}, expected pairs of Bpm or Amplitude and a number")
            least, most = (5.0, 30.0) if row[0] == "Bpm" else (0.0, 1.0)
            self._breath[row[0]] = float(np.clip(self.number(method, row[0], row[1]), least, most))

    def getBreathConfig(self) -> list[list[Any]]:
        """Return "Bpm" and "Amplitude"."""
        return [[name, value] for name, value in self._breath.items()]

    def setIdlePostureEnabled(self, pChain: str, pIsEnabled: bool) -> None:
        """Set whether a chain idles in a posture."""
        self._idle_posture[self._breathing_chain("setIdlePostureEnabled", pChain)] = bool(pIsEnabled)

    def getIdlePostureEnabled(self, pChain: str) -> bool:
        """Return whether a chain idles in a posture."""
        return self._idle_posture[self._breathing_chain("getIdlePostureEnabled", pChain)]

    def _breathing_chain(self, method: str, name: Any) -> str:
        if name == "Leg":
            name = "Legs"
        if name not in BREATHING_CHAINS:
            raise self.fail(method, f"got {quoted(name)}, expected one of {', '.join(BREATHING_CHAINS)}")
        return str(name)

    def _breathe(self) -> None:
        """Move the joints of breathing chains that no task uses; called once a cycle."""
        breath: dict[str, float] = table("motion")["breath"]
        chains = [chain for chain, on in self._breathing.items() if on]
        joints = {j for chain in chains for j in CHAINS[chain] if j in breath}
        if not joints and not self._breath_before:
            return
        phase = 2.0 * math.pi * self._breath["Bpm"] / 60.0 * self.body.time.now
        share = 0.5 * (1.0 - math.cos(phase)) * self._breath["Amplitude"]
        busy = self.body.tasks.booked
        for joint, far in breath.items():
            before = self._breath_before.pop(joint, 0.0)
            now = share * far if joint in joints and joint not in busy else 0.0
            if joint in busy:
                continue
            step = float(np.clip(now - before, -0.002, 0.002))
            self.body.command[self.body.index[joint]] += step
            if abs(before + step) > 1e-6 or joint in joints:
                self._breath_before[joint] = before + step
