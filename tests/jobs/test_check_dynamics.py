import functools
import json

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import jobs, symbolic
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.jobs import DynamicsCheckRow, check_dynamics

# Two joints in a plane; small, so that its kernels compile at once.
ARM = """<robot name="arm"><link name="floor"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.2"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.05 0 -0.1"/><mass value="{mass}"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/></inertial></link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute"><parent link="floor"/><child link="upper"/><axis xyz="0 1 0.3"/>
    <limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="1 0.2 0"/>
    <origin xyz="0 0 -0.4"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
  <joint name="grip" type="fixed"><parent link="lower"/><child link="tool"/><origin xyz="0 0.1 -0.2"/></joint>
</robot>"""
QUANTITIES = [
    "inverse dynamics",
    "mass matrix",
    "forward dynamics",
    "frame Jacobian",
    "frame Jacobian rate",
    "center-of-mass Jacobian",
    "d tau / d q",
    "d tau / d v",
    "d tau / d a",
    "d a / d q",
    "d a / d v",
    "d a / d tau",
    "energy over one second",
]


def arm(mass=1.0):
    return pk.load_robot(ARM.format(mass=mass))


def failing(check):
    return {name.rsplit(" (", 1)[0] for name in check.failures}


@pytest.mark.thorough
def test_a_sound_robot_passes():
    check = check_dynamics(arm(), states=30)
    assert check.success
    assert check.failures == ()
    assert (check.robot, check.joints, check.states, check.seed) == ("arm", 2, 30, 0)
    assert check.frame == "lower"
    assert [row.quantity for row in check.rows] == QUANTITIES
    for row in check.rows[:-1]:
        by_one = {"pinocchio"} if "Jacobian" in row.quantity else {"pinocchio", "compiled"}
        assert set(row.errors) == by_one | {"symbolic", "batch"}
        assert 0 < max(row.errors.values()) <= row.limit
    assert set(check.rows[-1].errors) == {"pinocchio", "compiled"}
    assert 0 < max(check.rows[-1].errors.values()) < 1e-9


def test_a_robot_of_one_joint_passes():
    """Its Jacobians have one column, which batches return as vectors: the check ended in a traceback."""
    one = ARM.format(mass=1).replace('"elbow" type="revolute"', '"elbow" type="fixed"')
    check = check_dynamics(pk.load_robot(one), states=5)
    assert check.success, check.report()
    assert check.joints == 1


def test_the_same_seed_gives_the_same_numbers():
    pepper = arm()
    first, again, other = (check_dynamics(pepper, states=5, seed=seed) for seed in (3, 3, 4))
    assert first == again
    assert first.rows != other.rows


@pytest.mark.thorough
def test_pepper_with_fingers_passes_and_says_so():
    check = check_dynamics(pk.load_pepper(), states=20)
    assert check.success, check.report()
    lines = check.report().splitlines()
    assert lines[0] == "Dynamics of pepper: 15 joints, 20 random states, seed 0, frame l_wrist"
    assert lines[-1] == "All within the limits (relative errors, largest over joints and states)."
    assert [line.split("  ")[0] for line in lines[3:16]] == QUANTITIES


def test_a_wrong_mass_in_the_symbolic_form_is_named(monkeypatch):
    """One part in a million of one link is found, in the form that has it and no other."""
    true, heavy, ask = arm(), arm(1.000001), symbolic.function
    monkeypatch.setattr(symbolic, "function", lambda pepper, *args: ask(heavy, *args))
    check = check_dynamics(true, states=10)
    assert not check.success
    assert all(name.endswith("(symbolic)") for name in check.failures)
    assert failing(check) == {
        "inverse dynamics", "mass matrix", "forward dynamics", "center-of-mass Jacobian",
        "d tau / d q", "d tau / d v", "d tau / d a", "d a / d q", "d a / d v", "d a / d tau",
    }  # fmt: skip
    assert check.report().splitlines()[-1].startswith("Beyond the limit: inverse dynamics (symbolic), ")
    assert " !" in check.report()


def test_a_wrong_mass_in_one_state_at_a_time_is_named_and_keeps_its_energy(monkeypatch):
    """One state at a time with another mass is wrong; as a mechanism it is still sound."""
    heavy = arm(1.001)

    def of_the_heavy_arm(function):
        return functools.wraps(function)(lambda pepper, *state, **options: function(heavy, *state, **options))

    for name in ("inverse_dynamics", "forward_dynamics", "kinetic_energy", "potential_energy"):
        monkeypatch.setattr(pk.dynamics, name, of_the_heavy_arm(getattr(pk.dynamics, name)))
    check = check_dynamics(arm(), states=10)
    forms = ("pinocchio", "compiled")
    names = ("inverse dynamics", "forward dynamics")
    assert set(check.failures) == {f"{name} ({form})" for name in names for form in forms}
    assert all(1e-4 < check.rows[0].errors[form] < 1e-2 for form in forms)
    assert check.rows[-1].success


def test_a_robot_with_a_changed_model_is_checked_as_it_is_now():
    """Newton-Euler takes the masses that the model has, in every form."""
    robot = arm()
    model = robot.pinocchio_model
    model.inertias[2].mass *= 1.5
    assert check_dynamics(robot.with_pinocchio_model(model), states=10).success


def test_torques_that_make_energy_are_named(monkeypatch):
    """A motor that gives one part in a million more than it is told breaks the balance, and nothing else."""
    forward = pk.dynamics.forward_dynamics

    def forward_dynamics(pepper, q, v, tau, *, solver="compiled"):
        return forward(pepper, q, v, np.asarray(tau) * (1 + 1e-6), solver=solver)

    monkeypatch.setattr(pk.dynamics, "forward_dynamics", forward_dynamics)
    check = check_dynamics(arm(), states=5)
    names = ("forward dynamics", "energy over one second")
    assert set(check.failures) == {f"{name} ({form})" for name in names for form in ("pinocchio", "compiled")}


@pytest.mark.parametrize("wrong", ["frame_jacobian", "frame_jacobian_rate"])
def test_a_wrong_jacobian_is_named(monkeypatch, wrong):
    right = getattr(pk.kinematics, wrong)

    def off(pepper, *args):
        return right(pepper, *args) * (1 + 1e-5)

    off.__name__ = wrong
    monkeypatch.setattr(pk.kinematics, wrong, off)
    check = check_dynamics(arm(), states=5)
    assert f"{wrong.replace('_', ' ').replace('jacobian', 'Jacobian')} (pinocchio)" in check.failures


def test_a_joint_without_mass_is_a_note():
    loose = ARM.format(mass=1).replace('<mass value="1"/>', '<mass value="0"/>')
    loose = loose.replace('ixx="0.01"', 'ixx="0"').replace('iyy="0.01"', 'iyy="0"').replace("0.005", "0")
    check = check_dynamics(pk.load_robot(loose), states=5)
    notes = [row for row in check.rows if row.note]
    assert [row.quantity for row in notes] == [QUANTITIES[2], *QUANTITIES[9:]]
    assert all("no mass is moved by elbow" in row.note and not row.errors for row in notes)
    assert "d a / d q: not evaluated: the mass matrix has no inverse" in check.report()
    assert check.success


def test_a_number_that_is_none_fails():
    row = DynamicsCheckRow("x", "y", 1e-9, {"compiled": float("nan"), "batch": 1e-10})
    assert row.failed_forms == ("compiled",)
    check = jobs.DynamicsCheck("r", 1, "f", 1, 0, (row,))
    summary = json.loads(json.dumps(check.as_dict(), allow_nan=False))
    assert summary["rows"][0]["errors"] == {"compiled": None, "batch": 1e-10}
    assert summary["failures"] == ["x (compiled)"]


def test_numbers_of_states_that_are_none_are_refused():
    for states in [0, -1, 2.5, True, "many"]:
        with pytest.raises(InvalidValueError, match=r"states: got .* expected an integer of at least 1"):
            check_dynamics(arm(), states=states)


@pytest.mark.thorough
def test_the_command_checks_a_file(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM.format(mass=1))
    done = run("check", "dynamics", "arm.urdf", "--states", "8", "--seed", "2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Dynamics of arm: 2 joints, 8 random states, seed 2, frame lower")
    summary = json.loads(run("check", "dynamics", "arm.urdf", "--states", "8", "--json", cwd=tmp_path).stdout)
    assert summary["success"] is True
    assert len(summary["rows"]) == len(QUANTITIES)


def test_the_command_fails_where_the_check_does(run, tmp_path, monkeypatch):
    right = pk.dynamics.mass_matrix

    def mass_matrix(pepper, q, *, solver="compiled"):
        return right(pepper, q, solver=solver) * (1.01 if solver == "compiled" else 1.0)

    monkeypatch.setattr(pk.dynamics, "mass_matrix", mass_matrix)
    (tmp_path / "arm.urdf").write_text(ARM.format(mass=1))
    done = run("check", "dynamics", "arm.urdf", "--states", "4", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].startswith("Beyond the limit: mass matrix (compiled)")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("missing.urdf",), "missing.urdf: cannot be read"),
        (("--states", "0"), "states: got 0, expected an integer of at least 1"),
        (("--seed", "-1"), "seed: got -1, expected an integer of at least 0"),
    ],
)
def test_check_misuse_ends_with_one_line(run, tmp_path, arguments, message):
    done = run("check", "dynamics", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert message in done.stderr
