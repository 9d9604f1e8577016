"""Rollouts of many steps with a world in one call: bit for bit those with a call-back in every step."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin import Twin, actuator_parameters
from pepper_kin.twin.sensors import SensorSuite
from pepper_kin.twin.world import World
from pepper_kin.twin.world.coal_contacts import CoalContacts

H = 0.001
PEPPER = pk.load_pepper()


class Plain:
    """A world that can do nothing but a step at a time."""

    def __init__(self, world):
        self.world = world

    def advance(self, q, v, mass_hat, force, h):
        return self.world.advance(q, v, mass_hat, force, h)

    @property
    def contacts(self):
        return self.world.contacts

    def snapshot(self):
        return self.world.snapshot()


class Watchful:
    """Sensors that get every state, since they have no clock."""

    def __init__(self, suite):
        self.suite, self.shown = suite, 0

    def observe(self, state):
        self.shown += 1
        self.suite.observe(state)

    def recorded(self, start):
        return self.suite.recorded(start)


def leaning():
    """Both hands before a wall, a box that slides on a table and a ball that falls; start and target."""
    start = PEPPER.posture("Stand").copy()
    for side, sign in (("L", 1), ("R", -1)):
        start[PEPPER.joint_index(f"{side}ShoulderPitch")] = 0.3
        start[PEPPER.joint_index(f"{side}ElbowRoll")] = -0.4 * sign
    wrist = pk.kinematics.frame_pose(PEPPER, start, "l_wrist")[0, 3]
    scene = pk.Scene().add_box("wall", (0.1, 2, 2), (wrist + 0.197, 0, 1))
    world = World(PEPPER, scene.add_box("table", (0.4, 0.4, 0.04), (-0.8, 0, 0.68)))
    world.add_box("parcel", (0.12, 0.16, 0.14), 0.4, (-0.8, 0, 0.771), velocity=(0.2, 0.1, 0, 0, 0, 1))
    world.add_ball("ball", 0.04, 0.2, (-0.7, 0.1, 0.75), velocity=(0.1, 0, 0, 0, 3, 0))
    target = start.copy()
    target[PEPPER.joint_index("HipPitch")] -= 0.03
    return world, start, target


def state_of(world):
    return [(body.pose, body.velocity) for body in world.bodies.values()]


def same(first, second):
    for name in ("position", "velocity", "torque"):
        assert np.array_equal(getattr(first, name), getattr(second, name)), name
    assert (first.status, first.message) == (second.status, second.message)
    assert first.readings.keys() == second.readings.keys()
    for name, series in first.readings.items():
        for part in ("time", "value", "truth"):
            assert np.array_equal(getattr(series, part), getattr(second.readings[name], part)), (name, part)


def same_worlds(first, second):
    for mine, other in zip(state_of(first), state_of(second), strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(mine, other, strict=True))
    assert len(first.contacts) == len(second.contacts)
    for a, b in zip(first.contacts, second.contacts, strict=True):
        assert (a.names, a.gap) == (b.names, b.gap)
        assert all(np.array_equal(getattr(a, x), getattr(b, x)) for x in ("point", "normal", "force"))
    one, two = first.last_solution, second.last_solution
    assert (one is None) == (two is None)
    if one is not None:
        assert (one.solver, one.problems, one.coulomb_error) == (two.solver, two.problems, two.coulomb_error)
        assert np.array_equal(one.impulses, two.impulses)
        assert np.array_equal(one.velocity, two.velocity)


def counted(monkeypatch):
    """Count the pairs that the compiled narrow phase left to coal."""
    calls, plain = [], CoalContacts.decide

    def decide(self, *arguments):
        calls.append(self)
        return plain(self, *arguments)

    monkeypatch.setattr(CoalContacts, "decide", decide)
    return calls


@pytest.mark.parametrize("kind", ["servo", "motor"])
def test_a_run_is_its_steps_to_the_last_bit(kind, monkeypatch):
    actuators = actuator_parameters(PEPPER, kind)
    worlds, runs, shown = [], [], []
    calls = counted(monkeypatch)
    for plain in (False, True):
        world, start, target = leaning()
        suite = SensorSuite(PEPPER, seed=2, world=Plain(world) if plain else world)
        watchful = Watchful(suite)
        twin = Twin(
            PEPPER,
            H,
            actuators=actuators,
            world=Plain(world) if plain else world,
            sensors=watchful if plain else suite,
        )
        twin.reset(start)
        load = np.zeros((120, PEPPER.n))
        load[:, PEPPER.joint_index("HeadYaw")] = np.linspace(0, 1, 120)
        runs.append(twin.follow(np.tile(target, (120, 1)), load=load))
        worlds.append(world)
        shown.append(watchful.shown)
    assert not calls
    assert shown == [0, 122]  # two resets, 120 steps
    same(*runs)
    same_worlds(*worlds)
    assert any(contact.force.any() and "wall" in contact.names for contact in worlds[0].contacts)
    assert len(runs[0].readings["left_hand_touch"]) == 7  # at 0, 20, ... 120 ms


def test_where_a_run_is_broken_off_changes_no_bit():
    world, start, target = leaning()
    twin = Twin(PEPPER, H, world=world)
    twin.reset(start)
    whole = twin.follow(np.tile(target, (60, 1)))
    other, _, _ = leaning()
    stepwise = Twin(PEPPER, H, world=other)
    stepwise.reset(start)
    states = [stepwise.step(target) for _ in range(7)]
    run = stepwise.follow(np.tile(target, (53, 1)))
    assert np.array_equal(whole.velocity[1:8], [state.velocity for state in states])
    assert np.array_equal(whole.velocity[7:], run.velocity)
    same_worlds(world, other)


def test_pairs_that_only_coal_decides_are_called_back(monkeypatch):
    """A box lands on a deck's edge with one of its own: no face decides."""
    calls, worlds = counted(monkeypatch), []
    for plain in (False, True):
        world = World(PEPPER, pk.Scene().add_box("deck", (0.4, 0.4, 0.1), (2, 0, 0.95)))
        world.add_box("box", (0.1, 0.1, 0.1), 1.0, (2.21, 0, 1.09), (0.4, 0.6, 0.3))
        twin = Twin(PEPPER, H, world=Plain(world) if plain else world)
        twin.follow(np.tile(PEPPER.neutral(), (200, 1)))
        worlds.append(world)
        if not plain:
            assert 0 < len(calls) < 200
    assert len(calls) % 2 == 0
    same_worlds(*worlds)


@pytest.mark.parametrize("way", ["robot", "points"])
def test_a_run_stops_where_its_steps_do(way):
    runs, worlds = [], []
    for plain in (False, True):
        world = World(PEPPER, pk.Scene().add_box("deck", (4, 4, 0.1), (3, 0, 0.95)))
        for k in range(65 if way == "points" else 2):
            place = (1.5 + 0.2 * (k % 13), 0.2 * (k // 13), 1.06)
            world.add_box(f"box {k}", (0.1, 0.1, 0.1), 1.0, place)
        twin = Twin(PEPPER, H, world=Plain(world) if plain else world)
        load = np.zeros((60, PEPPER.n))
        if way == "robot":
            load[30:, 1] = 1e300
        with np.errstate(all="ignore"):
            runs.append(twin.follow(np.tile(PEPPER.neutral(), (60, 1)), load=load))
        worlds.append(world)
        assert runs[-1].status.value == "stopped"
    same(*runs)
    for mine, other in zip(*map(state_of, worlds), strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(mine, other, strict=True))


def test_pushes_break_a_run_where_they_act():
    runs = []
    for plain in (False, True):
        world, start, target = leaning()
        twin = Twin(PEPPER, H, world=Plain(world) if plain else world)
        twin.reset(start)
        twin.push("Head", [5.0, 3.0, 0.0], start=0.013, duration=0.009)
        runs.append(twin.follow(np.tile(target, (40, 1))))
    same(*runs)
    still = Twin(PEPPER, H, world=leaning()[0])
    still.reset(start)
    assert not np.array_equal(still.follow(np.tile(target, (40, 1))).velocity, runs[0].velocity)


@pytest.mark.parametrize("solver", ["compiled", "proxsuite"])
def test_an_advance_of_ones_own_is_never_passed_over(solver):
    """A subclass that overrides `advance` is called in every step."""

    class Sticky(World):
        calls = 0

        def advance(self, q, v, mass_hat, force, h):
            self.calls += 1
            return super().advance(q, v, mass_hat, force, h)

    world = Sticky(PEPPER, pk.Scene().add_box("wall", (0.1, 2, 2), (3, 0, 1)), solver=solver)
    Twin(PEPPER, H, world=world).follow(np.tile(PEPPER.neutral(), (12, 1)))
    assert world.calls == 12
