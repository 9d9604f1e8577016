"""Pinocchio's side of the comparison of one state and of loops, for any of its versions.

    dynamics_pinocchio_server.py URDF FRAME

Run by `dynamics.py --pinocchio-python`: placo keeps this library at Pinocchio 3.8, so newer ones have an
environment and a process of their own (`pip install pin`).  Reads q, v and a, then [name, calls] a line, and
writes the processor time of that many calls [s]; of [name, states, "loop"], that of a loop over states.
"""

import json
import sys
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin

WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def pinocchio_calls(model, frame_name: str, q, v, a) -> dict[str, Callable[[], object]]:
    """What a user would call for each quantity of one state."""
    data, frame = model.createData(), model.getFrameId(frame_name)

    def pose():
        pin.forwardKinematics(model, data, q)
        return pin.updateFramePlacement(model, data, frame).homogeneous

    def velocity():
        pin.forwardKinematics(model, data, q, v)
        return pin.getFrameVelocity(model, data, frame, WORLD).vector

    def acceleration():
        pin.forwardKinematics(model, data, q, v, a)
        return pin.getFrameClassicalAcceleration(model, data, frame, WORLD).vector

    def rate():
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacement(model, data, frame)
        return pin.getFrameJacobianTimeVariation(model, data, frame, WORLD)

    return {
        "frame pose": pose,
        "frame velocity": velocity,
        "frame acceleration": acceleration,
        "frame Jacobian": lambda: pin.computeFrameJacobian(model, data, q, frame, WORLD),
        "frame Jacobian rate": rate,
        "inverse dynamics": lambda: pin.rnea(model, data, q, v, a),
        "forward dynamics": lambda: pin.aba(model, data, q, v, a),
        "mass matrix": lambda: pin.crba(model, data, q),
        "inverse mass matrix": lambda: pin.computeMinverse(model, data, q),
        "Coriolis matrix": lambda: pin.computeCoriolisMatrix(model, data, q, v),
        "gravity torque": lambda: pin.computeGeneralizedGravity(model, data, q),
        "inverse dynamics derivatives": lambda: pin.computeRNEADerivatives(model, data, q, v, a),
        "forward dynamics derivatives": lambda: pin.computeABADerivatives(model, data, q, v, a),
        "regressor": lambda: pin.computeJointTorqueRegressor(model, data, q, v, a),
        "center of mass": lambda: pin.centerOfMass(model, data, q),
        "center-of-mass Jacobian": lambda: pin.jacobianCenterOfMass(model, data, q),
        "centroidal map": lambda: pin.ccrba(model, data, q, v),
        "centroidal momentum": lambda: pin.computeCentroidalMomentum(model, data, q, v),
        "kinetic energy": lambda: pin.computeKineticEnergy(model, data, q, v),
        "potential energy": lambda: pin.computePotentialEnergy(model, data, q),
        "base wrench": lambda: pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a),
    }


def seconds_of(call: Callable[[], object], count: int) -> float:
    """Processor time of so many calls."""
    begin = time.process_time()
    for _ in range(count):
        call()
    return time.process_time() - begin


LOOPS = {
    "inverse dynamics": (pin.rnea, (), 3),
    "forward dynamics": (pin.aba, (), 3),
    "mass matrix": (pin.crba, ("nv",), 1),
    "inverse dynamics derivatives": (pin.computeRNEADerivatives, ("nv",), 3),
}
"""Function of Pinocchio, further axis of its result, and number of vectors that it takes."""


def seconds_of_loop(model, name: str, count: int) -> float:
    """Processor time of a loop over states, as lean as a user would write it."""
    function, axes, inputs = LOOPS[name]
    states = np.random.default_rng(0).normal(size=(3, count, model.nv))[:inputs]
    shape = (model.nv, *(model.nv for _ in axes))
    data, out = model.createData(), np.empty((3, count, *shape))
    begin = time.process_time()
    if "derivatives" in name:
        for i, state in enumerate(zip(*states, strict=True)):
            out[0, i], out[1, i], out[2, i] = function(model, data, *state)
    else:
        first = out[0]
        for i, state in enumerate(zip(*states, strict=True)):
            first[i] = function(model, data, *state)
    return time.process_time() - begin


def main() -> None:
    model = pin.buildModelFromUrdf(sys.argv[1])
    state = [np.array(x) for x in json.loads(sys.stdin.readline())]
    calls = pinocchio_calls(model, sys.argv[2], *state)
    print(json.dumps(pin.__version__), flush=True)
    for line in sys.stdin:
        name, count, *loop = json.loads(line)
        found = seconds_of_loop(model, name, count) if loop else seconds_of(calls[name], count)
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
