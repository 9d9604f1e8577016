"""Steps of the twin against the equation of motion by Pinocchio, and contacts against laws of mechanics."""

import numpy as np
import pinocchio

import pepper_kin as pk
from pepper_kin.twin import actuator_parameters
from pepper_kin.twin.world import World

PEPPER = pk.load_pepper()
MODEL = pinocchio.buildModelFromXML(PEPPER.urdf)
DATA = MODEL.createData()
CREEP = 1e-8  # [rad/s] at which a sticking joint may creep
G = 9.81


def random_twin(rng):
    """Return a twin with random actuators, and its actuators."""
    actuators = actuator_parameters(PEPPER, "motor")
    scale = lambda low, high: np.exp(rng.uniform(np.log(low), np.log(high), PEPPER.n))  # noqa: E731
    actuators = actuators.changed(
        stiffness=actuators.stiffness * scale(0.01, 30.0),
        damping=actuators.damping * scale(0.01, 30.0),
        torque_limit=actuators.torque_limit * scale(0.1, 10.0),
        coulomb_friction=actuators.coulomb_friction * rng.integers(0, 2) * scale(0.1, 3.0),
        latency=0.0,
    )
    h = float(np.exp(rng.uniform(np.log(2e-4), np.log(0.02))))
    return pk.Twin(
        PEPPER, h, actuators=actuators, feedforward=str(rng.choice(["none", "gravity"]))
    ), actuators


def references(rng, steps, h):
    """Return smooth references with steps in between, shape (T, n) each, within and beyond the limits."""
    low, high = PEPPER.lower_limits - 0.1, PEPPER.upper_limits + 0.1
    knots = rng.uniform(low, high, (5, PEPPER.n))
    at = np.linspace(0.0, 4.0, steps)
    shares = at - np.minimum(np.floor(at), 3.0)
    place = np.minimum(at.astype(int), 3)
    if rng.random() < 0.3:
        shares = np.round(shares)  # jumps
    position = knots[place] + shares[:, None] * (knots[place + 1] - knots[place])
    return position, np.gradient(position, axis=0) / h * rng.integers(0, 2)


def wrong_steps(run, actuators, references, h, gravity, load):
    """Return the number of steps that break the equation of motion or an actuator's law.

    M(q) a + J a + b(q, v) = actuator + load - D w - C sign(w) - stops, with w the velocity at the end of the
    step and a = (w - v) / h; the left side by Pinocchio's Newton-Euler recursion on the URDF's text.
    """
    q, v, w = run.position[:-1], run.velocity[:-1], run.velocity[1:]
    position, velocity = (values[: len(w)] for values in references)
    a = (w - v) / h
    inner = np.array([pinocchio.rnea(MODEL, DATA, *row) for row in zip(q, v, a, strict=True)])
    held = np.array([pinocchio.computeGeneralizedGravity(MODEL, DATA, x) for x in q]) if gravity else 0.0
    beyond = [q + h * w - PEPPER.upper_limits, q + h * w - PEPPER.lower_limits]
    stops = np.zeros_like(q)
    for sign, limit, over in zip((1, -1), (PEPPER.upper_limits, PEPPER.lower_limits), beyond, strict=True):
        damping = np.where(sign * (q - limit) > 0, actuators.stop_damping, 0.0)
        push = actuators.stop_stiffness * over + damping * w
        stops += np.where((sign * push > 0) & np.isfinite(push), push, 0.0)
    torque = run.torque[1:]
    rest = inner + actuators.rotor_inertia * a + actuators.viscous_friction * w + stops - torque - load
    size = 1.0 + np.abs(inner) + np.abs(torque) + np.abs(actuators.rotor_inertia * a) + np.abs(stops)
    coulomb = actuators.coulomb_friction
    slips = np.abs(w) > 2 * CREEP
    friction_off = np.where(
        slips, np.abs(rest + coulomb * np.sign(w)), np.maximum(np.abs(rest) - coulomb, 0.0)
    )
    motion = (friction_off > 1e-7 * size).any(axis=1)
    moved = (np.abs(run.position[1:] - q - h * w) > 1e-12).any(axis=1)
    step = actuators.encoder_resolution
    reading = np.where(step > 0, np.round(q / np.where(step > 0, step, 1.0)) * step, q)
    on_edge = (step > 0) & (np.abs(np.abs((q / np.where(step > 0, step, 1.0)) % 1.0) - 0.5) < 1e-6)
    wanted = actuators.stiffness * (position - reading - h * w) + actuators.damping * (velocity - w) + held
    limit, line = actuators.torque_limit, actuators.stall_torque / actuators.no_load_speed
    highest = np.clip(actuators.stall_torque - line * w, -limit, limit)
    lowest = np.clip(-actuators.stall_torque - line * w, -limit, limit)
    off = (np.abs(np.clip(wanted, lowest, highest) - torque) > 1e-7 * (1.0 + np.abs(wanted))) & ~on_edge
    broken = (np.abs(torque) > actuators.torque_limit * (1 + 1e-9)).any(axis=1)
    return int(np.count_nonzero(motion | moved | off.any(axis=1) | broken))


def test_every_step_obeys_the_equation_of_motion(amount, rng, tried):
    steps, goal = 400, amount(8_000, 250_000, 10_000_000)
    done = wrong = 0
    while done < goal:
        twin, actuators = random_twin(rng)
        twin.reset(rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits), rng.normal(0, 1.0, PEPPER.n))
        commands = references(rng, steps, twin.timestep)
        load = np.zeros((steps, PEPPER.n)) if rng.random() < 0.7 else rng.normal(0, 1.0, (steps, PEPPER.n))
        run = twin.follow(*commands, load=load if load.any() else None)
        taken = len(run) - 1
        wrong += wrong_steps(
            run, actuators, commands, twin.timestep, twin.feedforward == "gravity", load[:taken]
        )
        done += max(taken, 1)
    tried("twin steps", done, wrong)
    assert wrong == 0


def test_contacts_push_as_they_say_and_momentum_is_balanced(amount, rng, tried):
    """J^T of the contacts' forces by Pinocchio moves the robot; what falls loses what the robot gets."""
    done = wrong = touched = 0
    for _ in range(amount(10, 200, 5000)):
        h = float(rng.choice([0.001, 0.002, 0.005]))
        mass, world = float(rng.uniform(0.05, 2.0)), World(PEPPER)
        place = (*rng.uniform(-0.1, 0.15, 2), float(rng.uniform(1.25, 1.5)))
        if rng.random() < 0.5:
            world.add_ball(
                "body", float(rng.uniform(0.01, 0.1)), mass, place, velocity=(0, 0, -2.0, 0, 5.0, 0)
            )
        else:
            world.add_box(
                "body",
                rng.uniform(0.03, 0.2, 3),
                mass,
                place,
                rng.uniform(-3, 3, 3),
                velocity=(0, 0, -2.0, 0, 0, 0),
            )
        twin = pk.Twin(PEPPER, h, world=world)
        for _ in range(60):
            before, state = world.bodies["body"], twin.state
            after = twin.step(PEPPER.neutral())
            a = (after.velocity - state.velocity) / h
            load = pinocchio.rnea(MODEL, DATA, state.position, state.velocity, a) - after.torque
            force, touched = np.zeros(PEPPER.n), touched + bool(world.contacts)
            total = np.array([0.0, 0.0, -mass * G])
            for contact in world.contacts:
                (link,) = (name for name in contact.names if name != "body")
                pushed = contact.force if contact.names[0] == link else -contact.force
                total = total - pushed
                frame = MODEL.frames[MODEL.getFrameId(link)]
                joints = pinocchio.computeFrameJacobian(
                    MODEL, DATA, state.position, MODEL.getFrameId(link), pinocchio.WORLD
                )
                assert frame.name == link
                force += joints[:3].T @ pushed + joints[3:].T @ np.cross(contact.point, pushed)
            free = (np.abs(after.position - PEPPER.lower_limits) > 1e-3) & (
                np.abs(after.position - PEPPER.upper_limits) > 1e-3
            )
            off = np.abs(load - force)[free].max() > 1e-6 * (1.0 + np.abs(force).max())
            gain = mass * (world.bodies["body"].velocity[:3] - before.velocity[:3])
            off |= bool(np.abs(gain - h * total).max() > 1e-9 * (1.0 + np.abs(total).max()))
            done, wrong = done + 1, wrong + bool(off)
    tried("twin steps beside a body, in contact", touched, wrong)
    assert touched > 0.1 * done
    assert wrong == 0


def test_free_bodies_keep_energy_and_momentum_and_never_pass_the_floor(amount, rng, tried):
    """Energy and momentum of bodies in flight, by the laws of mechanics, and that none passes the floor."""
    done = wrong = 0
    for _ in range(amount(6, 150, 4000)):
        size = float(np.exp(rng.uniform(np.log(1e-5), np.log(10.0))))
        mass = float(np.exp(rng.uniform(np.log(1e-12), np.log(1e4))))
        world = World(
            None, pk.Scene().add_half_space("floor", (0, 0, 1)), friction=float(rng.uniform(0, 1.5))
        )
        sides = size * rng.uniform(0.3, 1.0, 3)
        speed = rng.normal(0, 1.0, 6) * [size * 20] * 6 / np.array([1, 1, 1, size, size, size])
        world.add_box("body", sides, mass, (0, 0, 1.2 * size), rng.uniform(-3, 3, 3), velocity=speed)
        start, energy = world.bodies["body"], np.inf
        spin = start.velocity[3:]
        for step in range(150):
            world.advance_alone(0.001)
            body = world.bodies["body"]
            corners = np.array(np.meshgrid(*([-0.5, 0.5] * 1 for _ in range(3)))).reshape(3, -1).T * sides
            lowest = (corners @ body.pose[:3, :3].T)[:, 2].min() + body.position[2]
            now = body.kinetic_energy + mass * G * body.position[2]
            scale = start.kinetic_energy + mass * G * 2 * size
            # Contacts are linear in the turn of a step, whose arc leaves its chord by (w h)^2 r / 2.
            turn = 0.001 * max(np.linalg.norm(spin), np.linalg.norm(body.velocity[3:]))
            off = lowest < -0.05 * size - turn**2 / 2 * np.linalg.norm(sides) / 2
            spin = body.velocity[3:]
            # What is let loose overlaps not at all; taking overlaps back adds at most 0.2 m/s.
            off |= now > energy + mass * (0.5 * 0.2**2 + G * 0.001 * 0.3) + 1e-6 * scale
            energy = min(energy, now)
            done, wrong = done + 1, wrong + bool(off)
            assert np.isfinite(body.pose).all(), step
    tried("steps of free bodies", done, wrong)
    assert wrong == 0
