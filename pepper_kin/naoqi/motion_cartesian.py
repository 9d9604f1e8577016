"""ALMotion: Cartesian methods for effectors."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.naoqi.effectors import (
    CHAIN_JOINTS,
    as_pose,
    find_angles,
    frame_of,
    position6d,
    space_pose,
)
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_tasks import CurveTask, SpeedTask
from pepper_kin.naoqi.module import Module
from pepper_kin.trajectory.key_curve import Key

STEP = 0.1
"""Maximum time between two configurations along a Cartesian path [s]."""

UNUSABLE = "Pepper's documents advise against the Cartesian methods"


class CartesianMethods(Module):
    """Cartesian methods of ALMotion for effectors."""

    def getPosition(self, name: str, space: int, useSensorValues: bool) -> list[float]:
        """Return the pose [x, y, z, wx, wy, wz] of an effector, joint or sensor in a frame [m, rad]."""
        return position6d(self._pose("getPosition", name, space, bool(useSensorValues)))

    def getTransform(self, name: str, space: int, useSensorValues: bool) -> list[float]:
        """Return the 4 x 4 transform of an effector, joint or sensor in a frame, row by row."""
        return [float(x) for x in self._pose("getTransform", name, space, bool(useSensorValues)).ravel()]

    def changePosition(
        self, effectorName: str, space: int, positionChange: Any, fractionMaxSpeed: float, axisMask: int
    ) -> None:
        """Move an effector by a change of position from its commanded pose; return at once."""
        method = "changePosition"
        change = self.numbers(method, "positionChange", positionChange, 6)
        now = position6d(self._pose(method, effectorName, space, False))
        target = [a + b for a, b in zip(now, change, strict=True)]
        self._set(method, [effectorName], [space], [target], fractionMaxSpeed, [axisMask])

    def changeTransform(
        self, chainName: str, space: int, transform: Any, fractionMaxSpeed: float, axisMask: int
    ) -> None:
        """Move an effector by a transform from its commanded pose; return at once."""
        method = "changeTransform"
        change = as_pose(self._pose_numbers(method, transform))
        now = self._pose(method, chainName, space, False)
        target = now.copy()
        target[:3, :3] = change[:3, :3] @ now[:3, :3]
        target[:3, 3] = now[:3, 3] + change[:3, 3]
        self._set(method, [chainName], [space], [list(target.ravel())], fractionMaxSpeed, [axisMask])

    # Reading arguments.

    def _pose(self, method: str, name: Any, space: Any, use_sensors: bool) -> Array:
        frame = frame_of(name, self.name, method)
        with self.body.time.lock:
            origin = space_pose(self.body, space, use_sensors, self.name, method)
            return np.asarray(np.linalg.inv(origin) @ self.body.frame_pose(frame, use_sensors))

    def _pose_numbers(self, method: str, value: Any) -> list[float]:
        if hasattr(value, "toVector"):
            value = value.toVector()
        numbers = self.numbers(method, "path", value)
        if len(numbers) not in (6, 12, 16):
            raise self.fail(method, f"path: got {len(numbers)} numbers, expected 6, 12 or 16")
        return numbers

    def _effectors(self, method: str, names: Any) -> list[str]:
        """Return a list of effectors that can be moved; "Arms" means both arms."""
        found = [names] if isinstance(names, str) else list(names)
        if found == ["Arms"]:
            found = ["LArm", "RArm"]
        for name in found:
            if name not in CHAIN_JOINTS:
                known = ", ".join(CHAIN_JOINTS)
                raise self.fail(method, f"{quoted(name)} is no effector that can be moved; known: {known}")
        return found

    def _each(self, method: str, quantity: str, value: Any, count: int) -> list[Any]:
        """Return a value for each effector: the list's values, or one value for all effectors."""
        if isinstance(value, Sequence) and not isinstance(value, str):
            if len(value) == 1:
                return [value[0]] * count
            if len(value) != count:
                raise self.fail(method, f"{quantity}: got {len(value)} for {count} effectors")
            return list(value)
        return [value] * count

    def _per_effector(self, method: str, quantity: str, value: Any, count: int, depth: int) -> list[Any]:
        """Return a value for each effector; the value of a single effector may be unnested."""
        levels, one = 0, value
        while isinstance(one, Sequence) and not isinstance(one, str) and len(one):
            levels, one = levels + 1, one[0]
        if levels <= depth and count == 1:
            return [value]
        return self._each(method, quantity, value, count)

    def _interpolate_one(
        self, method: str, name: Any, space: Any, path: Any, mask: Any, times: Any, absolute: bool
    ) -> None:
        self._interpolate(method, [name], [space], [path], [mask], [times], absolute)

    def _interpolate_all(
        self, method: str, names: Any, spaces: Any, paths: Any, masks: Any, times: Any, absolute: bool
    ) -> None:
        effectors = self._effectors(method, names)
        count = len(effectors)
        self._interpolate(
            method,
            effectors,
            self._each(method, "spaces", spaces, count),
            self._per_effector(method, "paths", paths, count, 2),
            self._each(method, "axisMasks", masks, count),
            self._per_effector(method, "relativeTimes", times, count, 1),
            absolute,
        )

    def _interpolate(
        self,
        method: str,
        names: Sequence[Any],
        spaces: Sequence[Any],
        paths: Sequence[Any],
        masks: Sequence[Any],
        times: Sequence[Any],
        absolute: bool,
    ) -> None:
        """Move effectors along the lines between poses, by inverse kinematics; return when done."""
        self.robot_refuses(method, UNUSABLE)
        effectors = self._effectors(method, list(names))
        curves = [
            self._knots(method, *row, absolute) for row in zip(effectors, spaces, paths, times, strict=True)
        ]
        with self.body.time.lock:
            keys = self._keys(effectors, curves, [int(m) for m in masks])
            task = self.body.do(CurveTask(method, keys))
        self.body.wait(task)

    def _knots(
        self, method: str, effector: str, space: Any, path: Any, times: Any, absolute: bool
    ) -> tuple[list[float], list[Array]]:
        """Return times [s] and poses in the world of a path, from the effector's present command."""
        rows = [path] if not _nested(path) else list(path)
        at = self.numbers(method, "times", times)
        if len(at) != len(rows):
            raise self.fail(method, f"{effector}: got {len(rows)} poses and {len(at)} times")
        if at[0] <= 0 or any(b <= a for a, b in itertools.pairwise(at)):
            raise self.fail(method, f"{effector}: got the times {at[:8]}, expected times above 0 that rise")
        origin = space_pose(self.body, space, False, self.name, method)
        here = self._pose(method, effector, 1, False)
        base = np.linalg.inv(origin) @ here
        poses = [here]
        for row in rows:
            numbers = self._pose_numbers(method, row)
            if absolute:
                pose = as_pose(numbers)
            elif len(numbers) == 6:
                pose = as_pose([a + b for a, b in zip(position6d(base), numbers, strict=True)])
            else:
                pose = base @ as_pose(numbers)
            poses.append(origin @ pose)
        return [0.0, *at], poses

    def _keys(
        self,
        effectors: Sequence[str],
        curves: Sequence[tuple[list[float], list[Array]]],
        masks: Sequence[int],
    ) -> dict[str, tuple[Key, ...]]:
        """Return the keys of all joints along the paths of all effectors.

        Args:
            effectors: Names of the effectors.
            curves: Times [s] and poses in the world [m], shape (4, 4) each, of each effector.
            masks: Axis mask of each effector.
        """
        knots = sorted({t for times, _ in curves for t in times})
        dense: list[float] = []
        for a, b in itertools.pairwise(knots):
            steps = max(int(np.ceil((b - a) / STEP)), 1)
            dense.extend(a + (b - a) * (k + 1) / steps for k in range(steps))
        found: dict[str, list[Key]] = {}
        angles: dict[str, float] = {}
        for time in dense:
            targets = {
                name: (pose_between(*curve, time), mask)
                for name, curve, mask in zip(effectors, curves, masks, strict=True)
            }
            angles = find_angles(self.body, targets, angles).angles
            for joint, angle in angles.items():
                found.setdefault(joint, []).append(Key(time, angle))
        return {joint: tuple(keys) for joint, keys in found.items()}

    def _set_one(self, method: str, name: Any, space: Any, target: Any, share: Any, mask: Any) -> None:
        self._set(method, [name], [space], [target], share, [mask])

    def _set_all(self, method: str, names: Any, spaces: Any, targets: Any, share: Any, masks: Any) -> None:
        effectors = self._effectors(method, names)
        count = len(effectors)
        self._set(
            method,
            effectors,
            self._each(method, "spaces", spaces, count),
            self._per_effector(method, "positions", targets, count, 1),
            share,
            self._each(method, "axisMask", masks, count),
        )

    def _set(
        self,
        method: str,
        names: Sequence[Any],
        spaces: Sequence[Any],
        targets: Sequence[Any],
        share: Any,
        masks: Sequence[Any],
    ) -> None:
        self.robot_refuses(method, UNUSABLE)
        effectors = self._effectors(method, list(names))
        speed = self.share(method, "fractionMaxSpeed", share)
        with self.body.time.lock:
            goals = {}
            for effector, space, target, mask in zip(effectors, spaces, targets, masks, strict=True):
                origin = space_pose(self.body, space, False, self.name, method)
                goals[effector] = (origin @ as_pose(self._pose_numbers(method, target)), int(mask))
            found = find_angles(self.body, goals, {})
            self.body.do(SpeedTask(method, found.angles, speed))


def _nested(path: Any) -> bool:
    first = path[0] if isinstance(path, Sequence) and len(path) else None
    return hasattr(first, "toVector") or (isinstance(first, Sequence) and not isinstance(first, str))


def pose_between(times: Sequence[float], poses: Sequence[Array], time: float) -> Array:
    """Return the pose at a time, on lines between poses, with rotation about one fixed axis in between.

    Args:
        times: Times of the poses, increasing [s].
        poses: Poses in one frame [m], shape (4, 4) each.
        time: Time [s]; the first pose is returned before it, and the last pose after it.
    """
    import pinocchio

    k = int(np.clip(np.searchsorted(times, time) - 1, 0, len(times) - 2))
    s = float(np.clip((time - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0))
    first, last = poses[k], poses[k + 1]
    turn = pinocchio.log3(first[:3, :3].T @ last[:3, :3])
    pose = np.eye(4)
    pose[:3, :3] = first[:3, :3] @ pinocchio.exp3(s * turn)
    pose[:3, 3] = (1.0 - s) * first[:3, 3] + s * last[:3, 3]
    return pose
