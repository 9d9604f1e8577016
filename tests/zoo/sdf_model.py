"""A small reader of SDF that knows its specification and shares no code with the writer."""

import xml.etree.ElementTree as ET

import numpy as np


def pose_of(element):
    """x y z roll pitch yaw, fixed axes, as (4, 4)."""
    x, y, z, r, p, w = (float(v) for v in element.text.split())
    roll = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    pitch = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    yaw = np.array([[np.cos(w), -np.sin(w), 0], [np.sin(w), np.cos(w), 0], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = yaw @ pitch @ roll, (x, y, z)
    return pose


class SdfModel:
    """Frames and masses of an SDF model at given joint positions."""

    def __init__(self, text):
        self.root = ET.fromstring(text)
        self.model = self.root.find("model")
        self.links = {link.get("name"): link for link in self.model.findall("link")}
        self.frames = {frame.get("name"): frame for frame in self.model.findall("frame")}
        self.joints = {joint.get("name"): joint for joint in self.model.findall("joint")}
        self.by_child = {joint.find("child").text: joint for joint in self.joints.values()}

    def position(self, joint, values):
        mimic = joint.find("axis/mimic")
        if mimic is None:
            return values.get(joint.get("name"), 0.0)
        leader = self.position(self.joints[mimic.get("joint")], values)
        return float(mimic.find("multiplier").text) * leader + float(mimic.find("offset").text)

    def pose(self, name, values, known=None):
        """The pose of a link or frame in the model frame; `known` keeps those on the way to it."""
        known = {} if known is None else known
        if name not in known:
            known[name] = self.place(name, values, known)
        return known[name]

    def place(self, name, values, known):
        if name in ("__model__", "world"):
            return np.eye(4)
        if name in self.frames:
            frame = self.frames[name]
            if frame.get("attached_to") is None:  # to the model's frame, which its first link carries
                first = next(iter(self.links))
                moved = self.pose(first, values, known) @ np.linalg.inv(self.pose(first, {}))
                return moved @ pose_of(frame.find("pose"))
            return self.pose(frame.get("attached_to"), values, known) @ pose_of(frame.find("pose"))
        placement = self.links[name].find("pose")
        above = placement.get("relative_to")
        if above is None:
            return pose_of(placement)
        joint = self.joints[above]
        assert joint.find("child").text == name
        base = self.pose(joint.find("pose").get("relative_to"), values, known) @ pose_of(joint.find("pose"))
        motion, value = np.eye(4), self.position(joint, values)
        if joint.get("type") != "fixed":
            axis = np.array([float(v) for v in joint.find("axis/xyz").text.split()])
            if joint.get("type") == "prismatic":
                motion[:3, 3] = axis * value
            else:
                cross = np.cross(np.eye(3), axis)
                motion[:3, :3] = np.eye(3) + np.sin(value) * cross + (1 - np.cos(value)) * cross @ cross
        return base @ motion @ pose_of(placement)

    def bodies(self, values, known=None):
        """(mass, center, inertia about it) of each link, in the model frame."""
        known = {} if known is None else known
        for name, link in self.links.items():
            pose, inertial = self.pose(name, values, known), link.find("inertial")
            offset = inertial.find("pose")
            pose = pose if offset is None else pose @ pose_of(offset)
            i = {e.tag: float(e.text) for e in inertial.find("inertia")}
            tensor = np.array(
                [
                    [i["ixx"], i["ixy"], i["ixz"]],
                    [i["ixy"], i["iyy"], i["iyz"]],
                    [i["ixz"], i["iyz"], i["izz"]],
                ]
            )
            rotation = pose[:3, :3]
            yield float(inertial.find("mass").text), pose[:3, 3], rotation @ tensor @ rotation.T

    def mass_matrix(self, names, q, step=1e-5):
        """Sum over bodies of m Jc' Jc + Jw' I Jw, with Jacobians by central differences."""
        poses = {}
        here = list(self.bodies(dict(zip(names, q, strict=True)), poses))
        matrix = np.zeros((len(names), len(names)))
        linear, angular = [], []
        reference = [poses[link][:3, :3] for link in self.links]
        for k in range(len(names)):
            columns = []
            for sign in (1, -1):
                moved = np.array(q, dtype=float)
                moved[k] += sign * step
                poses = {}
                centers = [c for _, c, _ in self.bodies(dict(zip(names, moved, strict=True)), poses)]
                columns.append((centers, [poses[link][:3, :3] for link in self.links]))
            linear.append([(a - b) / (2 * step) for a, b in zip(columns[0][0], columns[1][0], strict=True)])
            spin = [
                ((a - b) / (2 * step)) @ r.T
                for a, b, r in zip(columns[0][1], columns[1][1], reference, strict=True)
            ]
            angular.append(
                [np.array([w[2, 1] - w[1, 2], w[0, 2] - w[2, 0], w[1, 0] - w[0, 1]]) / 2 for w in spin]
            )
        for b, (mass, _, inertia) in enumerate(here):
            jc = np.array([linear[k][b] for k in range(len(names))]).T
            jw = np.array([angular[k][b] for k in range(len(names))]).T
            matrix += mass * jc.T @ jc + jw.T @ inertia @ jw
        return matrix
