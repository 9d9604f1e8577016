"""Certificates of robots with joints that mimic others, against an own reading of the URDF and Pinocchio.

Positions, velocities and accelerations of every joint follow from the chain of mimic elements, and torques of
coordinates are E^T tau_full, with tau_full those of the robot whose joints all move by themselves.
"""

import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio

import pepper_kin as pk
from pepper_kin.exceptions import ModelError, ModelWarning

ROUNDING = 1e-6
"""Of limits; a follower's limits that differ from its leader's by less change nothing."""
KINDS = ("revolute", "revolute", "prismatic", "continuous")


def vector(rng, low, high):
    return " ".join(f"{x:.9g}" for x in rng.uniform(low, high, 3))


def described(rng):
    """Return a URDF of a tree of joints, of which some follow others, also followers."""
    leaders, followers = int(rng.integers(1, 5)), int(rng.integers(1, 6))
    names, text = [f"j{k}" for k in range(leaders + followers)], '<robot name="r"><link name="l0"/>'
    for k, i in enumerate(rng.permutation(len(names))):
        size = rng.uniform(0.02, 0.3, 3)
        mass = rng.uniform(0.1, 3.0)
        around = mass / 12.0 * (np.sum(size**2) - size**2)
        axis, mimic, kind = rng.normal(size=3), "", KINDS[rng.integers(4)]
        bound = rng.uniform(0.3, 2.5, 2)
        if i >= leaders:
            gain, offset = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 2.0), rng.uniform(-0.2, 0.2)
            leader = names[rng.integers(i)]
            mimic = f'<mimic joint="{leader}" multiplier="{gain:.9g}" offset="{offset:.9g}"/>'
        text += (
            f'<link name="l{k + 1}"><inertial><origin xyz="{vector(rng, -0.1, 0.1)}"/>'
            f'<mass value="{mass:.9g}"/>'
            f'<inertia ixx="{around[0]:.9g}" iyy="{around[1]:.9g}" izz="{around[2]:.9g}" ixy="0" ixz="0" '
            f'iyz="0"/></inertial></link><joint name="{names[i]}" type="{kind}">'
            f'<origin xyz="{vector(rng, -0.3, 0.3)}" rpy="{vector(rng, -1.5, 1.5)}"/>'
            f'<parent link="l{rng.integers(k + 1)}"/><child link="l{k + 1}"/>'
            f'<axis xyz="{" ".join(f"{x:.9g}" for x in axis / np.linalg.norm(axis))}"/>'
            f'<limit lower="{-bound[0]:.9g}" upper="{bound[1]:.9g}" velocity="{rng.uniform(0.5, 4.0):.9g}" '
            f'effort="{rng.uniform(5.0, 100.0):.9g}" acceleration="{rng.uniform(3.0, 20.0):.9g}"/>'
            f"{mimic}</joint>"
        )
    return text + "</robot>"


class Reading:
    """The URDF as this file reads it: q_full = E q + e in Pinocchio's order, and limits of all joints."""

    def __init__(self, urdf, names):
        self.model = pinocchio.buildModelFromXML(urdf)
        joints = {joint.get("name"): joint for joint in ET.fromstring(urdf).findall("joint")}
        self.names, full = names, list(self.model.names)[1:]
        self.gain, self.offset = np.zeros((len(full), len(names))), np.zeros(len(full))
        for row, name in enumerate(full):
            gain, offset = 1.0, 0.0
            while (mimic := joints[name].find("mimic")) is not None:
                offset += gain * float(mimic.get("offset"))
                gain, name = gain * float(mimic.get("multiplier")), mimic.get("joint")
            self.gain[row, names.index(name)], self.offset[row] = gain, offset
        self.turning = [joints[name].get("type") == "continuous" for name in full]
        limits = {n: [float(joints[name].find("limit").get(n)) for name in full] for n in LIMITS}
        self.limit = {name: np.array(values) for name, values in limits.items()}
        self.limit["lower"][self.turning], self.limit["upper"][self.turning] = -np.inf, np.inf
        self.effort = np.array([float(joints[name].find("limit").get("effort")) for name in names])
        self.data = self.model.createData()

    def use(self, q, v, a):
        """Return by how much the worst joint is beyond its limits, by quantity, shape (T,).

        Positions in rad or m, all else as shares of the limits.
        """
        full = q @ self.gain.T + self.offset
        beyond = np.maximum(self.limit["lower"] - full, full - self.limit["upper"])
        found = {"position": beyond.max(axis=1)}
        for name, value in (("velocity", v), ("acceleration", a)):
            found[name] = (np.abs(value @ self.gain.T) / self.limit[name]).max(axis=1) - 1.0
        found["torque"] = (np.abs(self.torques(q, v, a)) / self.effort).max(axis=1) - 1.0
        return found

    def torques(self, q, v, a):
        """Return torques of the coordinates, shape (T, n)."""
        rows = zip(q @ self.gain.T + self.offset, v @ self.gain.T, a @ self.gain.T, strict=True)
        return np.array([self._rnea(*row) for row in rows]) @ self.gain

    def _rnea(self, q, v, a):
        """Return torques of all joints."""
        turned = np.concatenate(
            [[np.cos(x), np.sin(x)] if free else [x] for x, free in zip(q, self.turning, strict=True)]
        )
        return pinocchio.rnea(self.model, self.data, turned, v, a).copy()


LIMITS = ("lower", "upper", "velocity", "acceleration")


def robots(rng, count):
    """Yield readings and robots; those whose limits exclude each other, or leave no room, are left out."""
    while count:
        urdf = described(rng)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            try:
                robot = pk.load_robot(urdf)
            except ModelError as error:
                if "no position is within the limits of both" not in str(error):
                    raise
                continue
        low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -2.0)
        high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, 2.0)
        if (high - low < 0.05).any():
            continue
        count -= 1
        yield Reading(urdf, list(robot.joint_names)), robot, low, high


def test_certificates_with_followers(amount, rng, tried):
    """Motions through random positions, too fast, too heavy or in order: each quantity has our verdict.

    Within the bound that a certificate states between its states nothing is worse, and what it says is the
    worst of a quantity is what this file computes there.
    """
    passed = {name: [0, 0] for name in ("position", "velocity", "acceleration", "torque")}
    for reading, robot, low, high in robots(rng, amount(40, 150, 20_000)):
        middle, half = (low + high) / 2, (high - low) / 2
        points = middle + rng.uniform(0.3, 1.1) * half * rng.uniform(-1.0, 1.0, (5, robot.n))
        motion = pk.Trajectory.from_positions(
            robot, np.arange(5) * rng.uniform(0.3, 2.0), points, overshoot=10.0
        )
        found, wrong = motion.check(robot, collisions=False), 0
        states = motion(np.linspace(0.0, motion.duration, 997))
        use = reading.use(*states)
        for name, counts in passed.items():
            check, most = found.checks[name], float(use[name].max())
            sizes = np.maximum(np.abs(np.where(np.isfinite(check.upper), check.upper, 1.0)), 1e-9)
            between = float((check.resolution / sizes).max())
            wrong += check.success and most > between + ROUNDING
            if not check.success:  # where it says it is, it is
                times = check.time[check.margin < -check.tolerance]
                there = {key: value.max() for key, value in reading.use(*motion(times)).items()}
                wrong += there[name] < -ROUNDING
            counts[check.success] += 1
        j, torque = found.torque.worst, reading.torques(*motion(found.torque.time))
        wrong += abs(torque[j, j] - found.torque.value[j]) > 1e-6 * max(1.0, abs(torque[j, j]))
        tried("certificates of robots with followers", 1, wrong)
    assert min(min(counts) for counts in passed.values()) > 0, passed


def test_timed_motions_of_robots_with_followers(amount, rng, tried):
    """Motions that `retime` made, with limits of torque, keep those of all joints and are certified."""
    for reading, robot, low, high in robots(rng, amount(10, 40, 5000)):
        middle = (low + high) / 2
        points = middle + 0.9 * rng.uniform(-1.0, 1.0, (3, robot.n)) * (high - low) / 2
        heavy = (
            np.abs(pk.dynamics.inverse_dynamics(robot, points, 0 * points, 0 * points))
            > 0.7 * robot.effort_limits
        ).any()
        motion = pk.retime(robot, points, torque=not heavy)
        found = motion.check(robot, collisions=False)
        use = reading.use(*motion(np.linspace(0.0, motion.duration, 997)))
        names = ["position", "velocity", "acceleration"] + ([] if heavy else ["torque"])
        wrong = any(use[name].max() > (1e-3 if name == "torque" else ROUNDING) for name in names)
        wrong = wrong or any(not found.checks[name].success for name in names)
        tried("timed motions of robots with followers", 1, wrong)
