"""Plots in units: the lines are the motions, limits are where they are, files are fit for print."""

import re
import zlib

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.trajectory import plot_motions


@pytest.fixture(scope="module")
def wave(pepper):
    return pk.motion.gesture(pepper, "wave")


@pytest.fixture(scope="module")
def run(pepper, wave):
    return pk.Twin(pepper, timestep=0.002).execute(wave)


def panels(figure):
    """Return the panels by joint and quantity, as their labels tell."""
    rows, columns = figure.axes[0].get_gridspec().get_geometry()
    grid = np.array(figure.axes).reshape(rows, columns)
    joints = [row[0].get_ylabel().splitlines()[0] for row in grid]
    quantities = [panel.get_title(loc="left") for panel in grid[0]]
    return {(j, q): grid[a, b] for a, j in enumerate(joints) for b, q in enumerate(quantities)}


def levels(panel):
    """Return the heights of dashed red lines."""
    return sorted(float(line.get_ydata()[0]) for line in panel.lines if line.get_color() == "#c0392b")


def test_lines_are_the_motions_in_their_units(pepper, wave, run):
    figure = plot_motions(pepper, {"plan": wave, "twin": run}, joints=["RShoulderPitch", "RElbowRoll"])
    found = panels(figure)
    assert set(found) == {
        (joint, quantity)
        for joint in ("RShoulderPitch", "RElbowRoll")
        for quantity in ("position", "velocity", "torque")
    }
    j = pepper.joint_index("RElbowRoll")
    for quantity, unit in (("position", "rad"), ("velocity", "rad/s"), ("torque", "N m")):
        panel = found["RElbowRoll", quantity]
        assert panel.get_ylabel().splitlines()[-1] == f"[{unit}]"
        plan, twin = panel.lines[:2]
        state = wave(plan.get_xdata())
        torque = pk.dynamics.newton_euler(pepper, *state)  # other code than what is drawn
        expected = torque if quantity == "torque" else getattr(state, quantity)
        np.testing.assert_allclose(plan.get_ydata(), expected[:, j], atol=1e-9)
        np.testing.assert_array_equal(twin.get_ydata(), getattr(run, quantity)[:, j])
        np.testing.assert_array_equal(twin.get_xdata(), run.time)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["plan", "twin"]


def test_limits_are_drawn_near_and_written_far(pepper, wave):
    held = pk.Trajectory.from_positions(
        pepper, [0, 1, 2], [[0.0, 0.0], [0.63, 0.3], [0.0, 0.0]], joints=["HeadPitch", "HeadYaw"]
    )
    found = panels(plot_motions(pepper, held, joints="head"))
    limits = pepper.upper_limits[pepper.joint_index("HeadPitch")]
    assert levels(found["HeadPitch", "position"]) == pytest.approx([limits])
    assert levels(found["HeadYaw", "position"]) == []
    for panel in found.values():
        assert panel.texts[0].get_text().startswith("limit")
    fast = pepper.velocity_limits[pepper.joint_index("HeadYaw")]
    assert found["HeadYaw", "velocity"].texts[0].get_text() == f"limit ±{fast:.3g}"


@pytest.mark.thorough
def test_a_run_alone_has_its_reference_and_its_error(pepper, run, tmp_path):
    figure = run.plot(pepper, tmp_path / "run.png", quantities=["position", "error"])
    joint = next(iter(panels(figure)))[0]
    j = pepper.joint_index(joint)
    position, error = panels(figure)[joint, "position"], panels(figure)[joint, "error"]
    np.testing.assert_array_equal(position.lines[1].get_ydata(), run.reference_position[:, j])
    np.testing.assert_array_equal(error.lines[0].get_ydata(), run.tracking_error[:, j])
    assert len(panels(figure)) == 12  # six joints that move most
    moved = np.ptp(run.position, axis=0)
    most = [pepper.joint_names[k] for k in np.argsort(-moved)[:6]]
    assert {name for name, _ in panels(figure)} == set(most)


def test_a_pdf_has_the_width_asked_for_and_holds_its_fonts(pepper, wave, tmp_path):
    plot_motions(pepper, wave, tmp_path / "a.pdf", joints="RElbowRoll", width=3.5)
    content = (tmp_path / "a.pdf").read_bytes()
    box = [float(x) for x in re.search(rb"/MediaBox \[ ([\d. ]+) \]", content)[1].split()]
    assert box[2] == pytest.approx(3.5 * 72)
    assert b"/FontFile2" in content  # TrueType whole, no Type 3
    assert b"/Subtype /Type3" not in content
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL)
    assert any(b" re" in zlib.decompress(s) for s in streams if s.startswith(b"x"))


@pytest.mark.parametrize(
    ("motions", "options", "error", "words"),
    [
        (
            "wave",
            {"quantities": ["power"]},
            UnknownNameError,
            "unknown quantity 'power'; available: position",
        ),
        ("wave", {"quantities": ["error"]}, InvalidValueError, "the error of a trajectory"),
        ("run", {"quantities": ["acceleration"]}, InvalidValueError, "the acceleration of a run 'run'"),
        ("none", {}, InvalidValueError, "motions and quantities: got none"),
        ("wave", {"quantities": []}, InvalidValueError, "motions and quantities: got none"),
        ("wave", {"joints": []}, InvalidValueError, r"joints: got \[\]"),
        ("wave", {"joints": "Tail"}, UnknownNameError, "unknown joint or group 'Tail'"),
        ("wave", {"width": 0}, InvalidValueError, "width: got 0"),
        ("text", {}, InvalidValueError, "motion 'b': got str, expected a trajectory, a run"),
        ("wave", {"path": "a.gif"}, UnknownNameError, "unknown suffix '.gif'"),
    ],
)
def test_misuse_is_named(pepper, wave, run, motions, options, error, words):
    given = {"wave": wave, "run": run, "none": {}, "text": {"a": wave, "b": "run.csv"}}[motions]
    with pytest.raises(error, match=words):
        plot_motions(pepper, given, **options)
