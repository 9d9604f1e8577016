"""Public functions with one wrong argument: an error of the library, or a result without NaN.

NaN, infinities, huge and negative numbers, texts, bytes, wrong shapes and types, None, for each argument.
A TypeError or an AttributeError is right only about an object of another type.  Children make the calls
(`misuse_job.py`), so that a crash or a call without end is a finding too.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PACKAGES = (
    "base_placement", "batch", "collision", "dynamics", "files", "ik", "kernels", "kinematics", "model",
    "motion", "planners", "servo", "trajectory", "twin", "twin.base", "twin.sensors", "twin.world",
)  # fmt: skip
IN_SMALL = ("kinematics", "kernels")
IN_LONG_ONLY = ("motion", "twin")
"""Packages that take long, or of which not all is known that is to be mended."""

WAITING = {
    # A number of 400 digits, a list of unequal lists, or a text in place of a number.
    "active_limits.py", "balance.py", "check.py", "checker.py", "compiled_function.py", "controller.py",
    "deadline.py", "expression.py", "jerk_limits.py", "joint_vectors.py", "key_curve.py", "motion_limits.py",
    "odometry.py", "online.py", "phase_plane.py", "place_base.py", "proposals.py", "range_sensors.py",
    "score.py", "search.py", "shapes.py", "solids.py", "task.py", "tipping.py", "vectors.py",
    # Other objects in place of lists, and texts that are no path.
    "aorrtc.py", "atomic_file.py", "constraint_manifold.py", "frontier.py", "kernel.py", "load.py",
    "metric.py", "poses.py", "problem.py", "raycast.py", "rrt_connect.py", "scene.py", "smooth.py",
    "table_file.py", "timeline.py", "vendor_meshes.py",
    # Infinite jerk; no end for 1e18 samples, or a text of 5000 letters as a list of folders.
    "jerk_rows.py", "reach_map.py", "urdf_shapes.py",
    # NaN in results: of velocities of 1e300 rad/s, of NaN in arguments.
    "base_placement.placement_map", "dynamics.base_wrench", "dynamics.forward_dynamics",
    "dynamics.inverse_dynamics", "dynamics.inverse_dynamics_derivatives", "dynamics.newton_euler",
    "dynamics.regressor", "dynamics.tip_over_margin", "dynamics.zero_moment_point",
    "kinematics.frame_acceleration", "model.Mesh", "planners.StateCost", "trajectory.check",
    "twin.sensors.Intrinsics", "twin.sensors.published_scan",
}  # fmt: skip
"""Files in which another exception arises, and functions that return NaN, which wait to be mended."""


@pytest.mark.parametrize("package", PACKAGES)
def test_wrong_arguments_are_refused_by_name(package, amount, rng, tried, request):
    size = request.config.getoption("--fuzz-size")
    if (size == "small" and package not in IN_SMALL) or (size == "middle" and package in IN_LONG_ONLY):
        pytest.skip("in a larger size")
    options = {"package": package, "count": amount(10, 12, 2000), "seed": int(rng.integers(2**31))}
    command = [sys.executable, str(HERE / "misuse_job.py"), json.dumps(options)]
    repeat = f"python tests/fuzz/misuse_job.py '{json.dumps(options)}'"
    found = subprocess.run(command, capture_output=True, text=True, timeout=4 * 3600, cwd=HERE.parents[1])
    last = found.stderr.strip().rpartition("\n")[2]
    assert found.returncode == 0, f"{repeat}\nended with {found.returncode} at {last}\n{found.stderr[-3000:]}"
    lines = [json.loads(line) for line in found.stdout.splitlines()]
    unknown = [line for line in lines if "no call that works" in line]
    assert not unknown, f"{repeat}: {unknown}"
    findings = [line for line in lines if "wrong" in line]
    fresh = [line for line in findings if place_of(line) not in WAITING]
    tried("calls with one wrong argument", lines[-1]["tried"], len(fresh))
    assert not fresh, "\n".join(
        [repeat, *(f"{f['call']}: {f['wrong']} {f['error']} {f['where']}" for f in fresh)]
    )


def place_of(finding):
    """Return the file in which an exception arises, or the function that returns NaN or does not return."""
    return finding["where"].partition(":")[0] or finding["call"].partition("(")[0]
