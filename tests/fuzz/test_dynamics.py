"""Kinematics and dynamics against a plain Newton-Euler in world axes that reads the URDF's text by itself.

It shares nothing with the library: 3-vectors and NumPy, no spatial algebra, no Pinocchio; derivatives are by
complex steps, exact to rounding.  Pepper and robots of example-robot-data, one state at a time and in batches
of all sizes, which are SIMD machine code.  MuJoCo is the second witness, on the exported MJCF.
"""

import importlib.metadata
import xml.etree.ElementTree as ET
from functools import cache
from typing import Any

import numpy as np
import pytest

import pepper_kin as pk

GRAVITY = np.array([0.0, 0.0, -9.81])
STEP = 1e-30
"""Of complex steps: f'(x) = Im f(x + i h) / h, without cancellation."""

ROBOTS = {
    "pepper": None,
    "panda": "panda_description/urdf/panda.urdf",
    "pepper on a planar base": None,
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "romeo": "romeo_description/urdf/romeo_small.urdf",
    "talos": "talos_data/robots/talos_reduced.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "anymal": "anymal_b_simple_description/robots/anymal.urdf",
    "allegro hand": "allegro_hand_description/urdf/allegro_left_hand.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
}
IN_SIZE = {"small": ("pepper", "panda"), "middle": tuple(ROBOTS)[:4], "long": tuple(ROBOTS)}
"""Kernels of a robot are compiled for half a minute."""
BATCHES = (24, 31, 64, 500, 12_000)
"""Sizes of batches that go to kernels; the last to the widest vectors."""


class Tree:
    """The links and joints of a URDF, and its mechanics in world axes for S states at once.

    A link: its parent, place and rotation in that, kind, axis, coordinate that moves it, factor and offset.
    """

    def __init__(self, text: str, joint_names: tuple[str, ...]) -> None:
        robot = ET.fromstring(text)
        joints = {}
        for joint in robot.findall("joint"):
            joints[joint.find("child").get("link")] = joint  # type: ignore[union-attr]
        elements = {link.get("name"): link for link in robot.findall("link")}
        places: dict[str, int] = {}
        self.n, self.links = len(joint_names), []

        def add(name: str) -> None:
            if name in places:
                return
            joint, link = joints.get(name), {"parent": -1, "kind": "fixed", "place": -1, "axis": np.zeros(3)}
            link.update(origin=np.zeros(3), rotation=np.eye(3), factor=1.0, offset=0.0, name=name)
            if joint is not None:
                parent = joint.find("parent").get("link")
                add(parent)
                origin, rotation = placed(joint.find("origin"))
                link.update(parent=places[parent], kind=joint.get("type"), origin=origin, rotation=rotation)
                if link["kind"] != "fixed":
                    axis = joint.find("axis")
                    vector = numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
                    link["axis"] = vector / np.linalg.norm(vector)
                    mimic, mover = joint.find("mimic"), joint.get("name")
                    if mimic is not None:
                        mover = mimic.get("joint")
                        link["factor"] = float(mimic.get("multiplier", 1.0))
                        link["offset"] = float(mimic.get("offset", 0.0))
                    link["place"] = joint_names.index(mover)
            link.update(inertial(elements[name].find("inertial")))
            places[name] = len(self.links)
            self.links.append(link)

        for name in elements:
            add(name)
        self.places = places

    def motion(self, q: Any, v: Any, a: Any) -> dict[str, list[Any]]:
        """Return rotation R, origin p, axis, angular velocity w, velocity u and their rates, of all links."""
        out: dict[str, list[Any]] = {name: [] for name in ("R", "p", "axis", "w", "dw", "u", "du")}
        count, kind = len(q), np.result_type(q, v, a)
        zero = np.zeros((count, 3), kind)
        for link in self.links:
            k = link["parent"]
            if k < 0:
                R, p, w, dw, u, du = (
                    np.tile(np.eye(3, dtype=kind), (count, 1, 1)),
                    zero,
                    zero,
                    zero,
                    zero,
                    zero,
                )
            else:
                R, p, w, dw, u, du = (out[name][k] for name in ("R", "p", "w", "dw", "u", "du"))
            arm, R = R @ link["origin"], R @ link["rotation"]
            axis, j, c = R @ link["axis"], link["place"], link["factor"]
            moves, speed, rate = 0.0, 0.0, 0.0
            if j >= 0:
                moves, speed, rate = c * q[:, j, None] + link["offset"], c * v[:, j, None], c * a[:, j, None]
            if link["kind"] == "prismatic":
                arm = arm + axis * moves
            swing = np.cross(w, arm)
            p, u, du = p + arm, u + swing, du + np.cross(dw, arm) + np.cross(w, swing)
            if link["kind"] == "prismatic":
                u, du = u + axis * speed, du + 2 * np.cross(w, axis * speed) + axis * rate
            elif link["kind"] in ("revolute", "continuous"):
                R = R @ turned(link["axis"], moves[:, 0])
                w, dw = w + axis * speed, dw + np.cross(w, axis * speed) + axis * rate
            for name, value in zip(out, (R, p, axis, w, dw, u, du), strict=True):
                out[name].append(value)
        return out

    def torques(self, q: Any, v: Any, a: Any, gravity: Any = GRAVITY) -> Any:
        """Return joint torques, shape (S, n), by F = m a and N = I dw + w x I w, summed from the tips."""
        m = self.motion(q, v, a)
        force = [np.zeros_like(m["p"][0]) for _ in self.links]
        moment = [np.zeros_like(m["p"][0]) for _ in self.links]
        tau = np.zeros((len(q), self.n), force[0].dtype)
        for k in reversed(range(len(self.links))):
            link, w, dw = self.links[k], m["w"][k], m["dw"][k]
            center = m["R"][k] @ link["center"]
            speed_up = m["du"][k] + np.cross(dw, center) + np.cross(w, np.cross(w, center))
            F = link["mass"] * (speed_up - gravity)
            inertia = m["R"][k] @ link["inertia"] @ np.swapaxes(m["R"][k], 1, 2)
            N = times(inertia, dw) + np.cross(w, times(inertia, w))
            force[k] = force[k] + F
            moment[k] = moment[k] + N + np.cross(center, F)
            if link["place"] >= 0:
                acts = force if link["kind"] == "prismatic" else moment
                tau[:, link["place"]] += link["factor"] * (m["axis"][k] * acts[k]).sum(axis=1)
            up = link["parent"]
            if up >= 0:
                force[up] = force[up] + force[k]
                moment[up] = moment[up] + moment[k] + np.cross(m["p"][k] - m["p"][up], force[k])
        return tau

    def sums(self, q: Any, v: Any) -> dict[str, Any]:
        """Return energies, center of mass and momentum about it."""
        m = self.motion(q, v, 0 * v)
        kinetic, potential, total = 0.0, 0.0, sum(link["mass"] for link in self.links)
        first, linear, angular = 0.0, 0.0, 0.0
        moving = self.moving()
        for k, link in enumerate(self.links):
            arm = m["R"][k] @ link["center"]
            center, u = m["p"][k] + arm, m["u"][k] + np.cross(m["w"][k], arm)
            inertia = m["R"][k] @ link["inertia"] @ np.swapaxes(m["R"][k], 1, 2)
            spin = times(inertia, m["w"][k])
            kinetic = kinetic + 0.5 * (link["mass"] * (u * u).sum(axis=1) + (m["w"][k] * spin).sum(axis=1))
            potential = potential - link["mass"] * moving[k] * (center @ GRAVITY)
            first, linear = first + link["mass"] * center, linear + link["mass"] * u
            angular = angular + spin + link["mass"] * np.cross(center, u)
        middle = first / total
        momentum = np.concatenate([linear, angular - np.cross(middle, linear)], axis=1)
        return {"kinetic": kinetic, "potential": potential, "center": middle, "momentum": momentum}

    def moving(self) -> list[bool]:
        """Return which links a joint moves."""
        found: list[bool] = []
        for link in self.links:
            found.append(link["place"] >= 0 or (link["parent"] >= 0 and found[link["parent"]]))
        return found


def numbers(text: str) -> np.ndarray:
    """Return numbers of a text."""
    return np.array([float(word) for word in text.split()])


def placed(origin: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return position and rotation of an `origin`: Rz(yaw) Ry(pitch) Rx(roll)."""
    if origin is None:
        return np.zeros(3), np.eye(3)
    x, y, z = numbers(origin.get("rpy", "0 0 0"))
    about = [turned(axis, np.array([angle]))[0] for axis, angle in zip(np.eye(3), (x, y, z), strict=True)]
    return numbers(origin.get("xyz", "0 0 0")), about[2] @ about[1] @ about[0]


def inertial(element: Any) -> dict[str, Any]:
    """Return mass, center and inertia about it, in the link's axes."""
    if element is None:
        return {"mass": 0.0, "center": np.zeros(3), "inertia": np.zeros((3, 3))}
    center, rotation = placed(element.find("origin"))
    i = {key: float(value) for key, value in element.find("inertia").attrib.items()}
    own = np.array(
        [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
    )
    mass = float(element.find("mass").get("value"))
    return {"mass": mass, "center": center, "inertia": rotation @ own @ rotation.T}


def turned(axis: np.ndarray, angle: Any) -> Any:
    """Return rotations about an axis, shape (S, 3, 3), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross)


def times(matrix: Any, vector: Any) -> Any:
    """Return matrix times vector for each state."""
    return (matrix @ vector[..., None])[..., 0]


@cache
def loaded(name: str) -> tuple[pk.PepperModel, Tree]:
    """Return a robot, and the same text read here."""
    if name == "pepper":
        robot = pk.load_pepper()
    elif name.startswith("pepper"):
        robot = pk.load_pepper(base="planar", hands="mimic")
    else:
        package = importlib.metadata.distribution("example-robot-data")
        path = next(f for f in package.files or () if str(f).endswith(f"robots/{ROBOTS[name]}"))
        robot = pk.load_robot(package.locate_file(path))
    return robot, Tree(robot.urdf, robot.joint_names)


def drawn(robot: pk.PepperModel, rng: np.random.Generator, count: int) -> tuple[np.ndarray, ...]:
    """Return states: within the limits, from rest to 10 rad/s and 100 rad/s^2, some joints at zero."""
    lower, upper = np.maximum(robot.lower_limits, -3.1), np.minimum(robot.upper_limits, 3.1)
    q = rng.uniform(lower, upper, (count, robot.n))
    fast = 10.0 ** rng.uniform(-3, 1, (2, count, 1))
    v, a = (fast * [[[1.0]], [[10.0]]]) * rng.normal(size=(2, count, robot.n))
    rest = rng.random((count, robot.n)) < 0.1
    return q, np.where(rest, 0.0, v), np.where(rng.random((count, robot.n)) < 0.1, 0.0, a)


def wrong(found: Any, expected: Any, scale: Any = None, tolerance: float = 1e-9) -> int:
    """Count states whose relative error, of the largest element, is above a tolerance."""
    found, expected = (
        np.asarray(found).reshape(len(expected), -1),
        np.asarray(expected).reshape(len(expected), -1),
    )
    size = np.abs(expected).max(axis=1) if scale is None else scale
    good = np.abs(found - expected).max(axis=1) <= tolerance * (1e-3 + size)
    return int((~good).sum())


@pytest.fixture(params=ROBOTS)
def robot(request):
    if request.param not in IN_SIZE[request.config.getoption("--fuzz-size")]:
        pytest.skip("in a larger size")
    return loaded(request.param)


def chunks(total: int, rng: np.random.Generator) -> Any:
    """Yield sizes of batches, large ones where many states are asked for, that add up to a number."""
    while total > 0:
        size = min(total, int(rng.choice(BATCHES[-2:] if total > 5000 else BATCHES[:-1])))
        yield size
        total -= size


def test_torques_and_accelerations(robot, amount, rng, tried):
    """RNEA and ABA, batch and single: torques of Newton-Euler, and the accelerations that they came from."""
    pepper, tree = robot
    for size in chunks(amount(300, 6_000, 420_000), rng):
        q, v, a = drawn(pepper, rng, size)
        expected = tree.torques(q, v, a)
        still = np.abs(tree.torques(q, 0 * v, 0 * a)).max(axis=1)
        # Kernels take angles within 1e-11 of pi / 2 for it: an arm that stands upright has such a torque.
        scale = still + np.abs(expected).max(axis=1) + 0.02 * still.max()
        bad = wrong(pk.dynamics.inverse_dynamics(pepper, q, v, a), expected, scale)
        tried("states: inverse dynamics, batch", size, bad)
        back = pk.dynamics.forward_dynamics(pepper, q, v, expected)
        # An acceleration is as good as the mass matrix lets it be: the torques that it takes are compared.
        tried("states: forward dynamics, batch", size, wrong(tree.torques(q, v, back), expected, scale, 1e-8))
        held = pk.dynamics.gravity_torque(pepper, q)
        tried("states: gravity torques, batch", size, wrong(held, tree.torques(q, 0 * v, 0 * a), scale))
        for k in rng.choice(size, max(1, size // 50), replace=False):
            state = q[k], v[k], a[k]
            one = pk.dynamics.inverse_dynamics(pepper, *state)
            tried("states: inverse dynamics, single", 1, wrong(one[None], expected[k][None], scale[k]))
            one = pk.dynamics.forward_dynamics(pepper, q[k], v[k], expected[k])
            again = tree.torques(q[k][None], v[k][None], one[None])
            tried("states: forward dynamics, single", 1, wrong(again, expected[k][None], scale[k], 1e-8))


def test_mass_energy_and_momentum(robot, amount, rng, tried):
    """Mass matrix, energies, center of mass, momentum: sums over the links, torques of unit accelerations."""
    pepper, tree = robot
    dynamics = pk.dynamics
    for size in chunks(amount(100, 1_000, 40_000), rng):
        q, v, _ = drawn(pepper, rng, size)
        sums, zero = tree.sums(q, v), np.zeros_like(q)
        units = [zero + np.eye(pepper.n)[k] for k in range(pepper.n)]
        mass = np.stack([tree.torques(q, zero, unit, 0 * GRAVITY) for unit in units], axis=2)
        bad = wrong(dynamics.mass_matrix(pepper, q), mass)
        bad += wrong(
            dynamics.coriolis_matrix(pepper, q, v) @ v[..., None], tree.torques(q, v, zero, 0 * GRAVITY)
        )
        identity = dynamics.inverse_mass_matrix(pepper, q) @ mass
        condition = np.linalg.cond(mass)
        bad += wrong(identity, np.broadcast_to(np.eye(pepper.n), identity.shape), condition, 1e-11)
        tried("states: mass, inverse mass and Coriolis matrix", size, bad)
        bad = wrong(dynamics.kinetic_energy(pepper, q, v), sums["kinetic"])
        bad += wrong(dynamics.potential_energy(pepper, q), sums["potential"], 1.0 + np.abs(sums["potential"]))
        bad += wrong(dynamics.center_of_mass(pepper, q), sums["center"])
        bad += wrong(dynamics.centroidal_momentum(pepper, q, v), sums["momentum"])
        bad += wrong(dynamics.centroidal_map(pepper, q) @ v[..., None], sums["momentum"])
        jacobian = dynamics.center_of_mass_jacobian(pepper, q)
        total = sum(link["mass"] for link in tree.links)
        bad += wrong(jacobian @ v[..., None] * total, sums["momentum"][:, :3])
        tried("states: energies, center of mass and momentum", size, bad)


def test_frames(robot, amount, rng, tried):
    """Poses, velocities, accelerations and Jacobians of links: those of the plain recursion."""
    pepper, tree = robot
    links = [name for name in tree.places if name in pepper.frame_names]
    for size in chunks(amount(100, 1_000, 100_000), rng):
        q, v, a = drawn(pepper, rng, size)
        name = str(rng.choice(links))
        k, m = tree.places[name], tree.motion(q, v, a)
        pose = pk.kinematics.frame_pose(pepper, q, name)
        bad = wrong(pose[:, :3, 3], m["p"][k]) + wrong(pose[:, :3, :3], m["R"][k])
        speed = np.concatenate([m["u"][k], m["w"][k]], axis=1)
        bad += wrong(pk.kinematics.frame_velocity(pepper, q, v, name), speed)
        bad += wrong(pk.kinematics.frame_jacobian(pepper, q, name) @ v[..., None], speed)
        faster = np.concatenate([m["du"][k], m["dw"][k]], axis=1)
        bad += wrong(pk.kinematics.frame_acceleration(pepper, q, v, a, name), faster)
        tried("states: pose, velocity, acceleration and Jacobian of a frame", size, bad)


def test_derivatives(robot, amount, rng, tried):
    """Derivatives of torques and accelerations, single: complex steps through the plain Newton-Euler."""
    pepper, tree = robot
    count = amount(3, 20, 2_000)
    q, v, a = drawn(pepper, rng, count)
    expected = complex_steps(tree, q, v, a)
    tau, mass = tree.torques(q, v, a), expected[2]
    for k in range(count):
        found = pk.dynamics.inverse_dynamics_derivatives(pepper, q[k], v[k], a[k])
        bad = sum(wrong(x[None], y[k][None]) for x, y in zip(found, expected, strict=True))
        found = pk.dynamics.forward_dynamics_derivatives(pepper, q[k], v[k], tau[k])
        # M da = -dtau at constant acceleration, and M da/dtau = 1.
        aims = (-expected[0][k], -expected[1][k], np.eye(pepper.n))
        for x, y in zip(found, aims, strict=True):
            bad += wrong((mass[k] @ x)[None], y[None], np.abs(mass[k]).max() * np.abs(x).max(), 1e-9)
        tried("states: derivatives of torques and accelerations, single", 1, int(bad > 0))


def test_derivatives_in_batches(amount, rng, tried):
    """Derivatives of Pepper's torques by kernels: complex steps through the plain Newton-Euler."""
    pepper, tree = loaded("pepper")
    for size in chunks(amount(24, 500, 50_000), rng):
        q, v, a = drawn(pepper, rng, size)
        found = pk.dynamics.inverse_dynamics_derivatives(pepper, q, v, a)
        bad = sum(wrong(x, y) for x, y in zip(found, complex_steps(tree, q, v, a), strict=True))
        tried("states: derivatives of torques, batch", size, bad)


def complex_steps(tree: Tree, q: Any, v: Any, a: Any) -> tuple[Any, ...]:
    """Return the derivatives of torques by q, v and a, shape (S, n, n) each."""
    results = []
    for which in range(3):
        columns = []
        for k in range(tree.n):
            state = [x.astype(complex) for x in (q, v, a)]
            state[which][:, k] += STEP * 1j
            columns.append(tree.torques(*state).imag / STEP)
        results.append(np.stack(columns, axis=2))
    return tuple(results)


def test_mujoco_agrees(amount, rng, tried):
    """MuJoCo's mass matrix and bias forces on the exported MJCF; it shares no code with Pinocchio."""
    import mujoco

    for base in ("fixed", "planar"):
        pepper = pk.load_pepper(base=base)
        model = mujoco.MjModel.from_xml_string(pk.model.export(pepper, "mjcf"))
        data = mujoco.MjData(model)
        order = [model.joint(name).dofadr[0] for name in pepper.joint_names]
        places = [model.joint(name).qposadr[0] for name in pepper.joint_names]
        for _ in range(amount(20, 500, 50_000)):
            q, v, a = (x[0] for x in drawn(pepper, rng, 1))
            data.qpos[places], data.qvel[order] = q, v
            mujoco.mj_forward(model, data)
            along, product = np.zeros(model.nv), np.zeros(model.nv)
            along[order] = a
            mujoco.mj_mulM(model, data, product, along)
            armature = model.dof_armature[order] * a
            tau = pk.dynamics.inverse_dynamics(pepper, q, v, a)
            expected = (product[order] - armature + data.qfrc_bias[order])[None]
            tried(
                "states: inverse dynamics against MuJoCo",
                1,
                wrong(tau[None], expected, 1 + abs(tau).max(), 1e-8),
            )
