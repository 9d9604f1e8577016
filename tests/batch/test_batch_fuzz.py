"""Any array at the door gives the right result or an error with a name."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pepper_kin as pk
from pepper_kin import batch, dynamics, kinematics
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, UnknownNameError

FRAME = "panda_hand"
N = 8
# Function of (robot, *vectors), number of vectors, shape of one result.
FUNCTIONS = {
    "frame_pose": (lambda p, q: kinematics.frame_pose(p, q, FRAME), 1, (4, 4)),
    "link_poses": (lambda p, q: kinematics.link_poses(p, q)[..., -1, :, :], 1, (4, 4)),
    "frame_velocity": (lambda p, q, v: kinematics.frame_velocity(p, q, v, FRAME), 2, (6,)),
    "frame_acceleration": (lambda p, q, v, a: kinematics.frame_acceleration(p, q, v, a, FRAME), 3, (6,)),
    "frame_jacobian": (lambda p, q: kinematics.frame_jacobian(p, q, FRAME), 1, (6, N)),
    "frame_jacobian_rate": (lambda p, q, v: kinematics.frame_jacobian_rate(p, q, v, FRAME), 2, (6, N)),
    "manipulability": (lambda p, q: kinematics.manipulability(p, q, FRAME), 1, ()),
    "inverse_dynamics": (dynamics.inverse_dynamics, 3, (N,)),
    "forward_dynamics": (dynamics.forward_dynamics, 3, (N,)),
    "newton_euler": (dynamics.newton_euler, 3, (N,)),
    "mass_matrix": (dynamics.mass_matrix, 1, (N, N)),
    "inverse_mass_matrix": (dynamics.inverse_mass_matrix, 1, (N, N)),
    "coriolis_matrix": (dynamics.coriolis_matrix, 2, (N, N)),
    "gravity_torque": (dynamics.gravity_torque, 1, (N,)),
    "dtau_dq": (lambda p, *x: dynamics.inverse_dynamics_derivatives(p, *x).dtau_dq, 3, (N, N)),
    "da_dv": (lambda p, *x: dynamics.forward_dynamics_derivatives(p, *x).da_dv, 3, (N, N)),
    "center_of_mass": (dynamics.center_of_mass, 1, (3,)),
    "center_of_mass_jacobian": (dynamics.center_of_mass_jacobian, 1, (3, N)),
    "centroidal_momentum": (dynamics.centroidal_momentum, 2, (6,)),
    "kinetic_energy": (dynamics.kinetic_energy, 2, ()),
    "potential_energy": (dynamics.potential_energy, 1, ()),
    "base_wrench": (dynamics.base_wrench, 3, (6,)),
    "zero_moment_point": (dynamics.zero_moment_point, 3, (2,)),
}
AXES = [(), (1,), (3,), (0,), (30,), (2, 3), (5, 6), (1, 6), (5, 1), (0, 4), (2, 1, 15)]
DTYPES = ["float64", "float32", "float16", "int64", "int8", "uint8", ">f8", "object"]
LAYOUTS = ["plain", "read-only", "columns of a wider array", "every other", "backwards", "Fortran", "list"]


def laid_out(array, layout):
    """The same numbers in another layout of memory."""
    if layout == "read-only":
        array = array.copy()
        array.flags.writeable = False
    elif layout == "columns of a wider array":
        wide = np.full((*array.shape[:-1], array.shape[-1] + 3), 7, array.dtype)
        wide[..., 1:-2] = array
        array = wide[..., 1:-2]
    elif layout == "every other":
        array = np.repeat(array, 2, axis=-1)[..., ::2]
    elif layout == "backwards":
        array = array[..., ::-1].copy()[..., ::-1]
    elif layout == "Fortran":
        array = np.asfortranarray(array)
    elif layout == "list":
        return array.tolist()
    return array


@st.composite
def good_vectors(draw, count):
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    vectors = []
    for _ in range(count):
        values = rng.uniform(0, 1.5, (*draw(st.sampled_from(AXES)), N))
        array = values.astype(draw(st.sampled_from(DTYPES)))
        vectors.append(laid_out(array, draw(st.sampled_from(LAYOUTS))))
    return vectors


@pytest.mark.parametrize("name", FUNCTIONS)
@settings(max_examples=25, deadline=None, derandomize=True)
@given(data=st.data())
def test_any_layout_gives_the_numbers_of_plain_arrays(panda, name, data):
    function, count, core = FUNCTIONS[name]
    vectors = data.draw(good_vectors(count))
    plain = [np.array(x, dtype=float) for x in vectors]
    if any(x.ndim == 0 or x.shape[-1] != N for x in plain):  # a list without rows has no columns
        with pytest.raises(InvalidValueError):
            function(panda, *vectors)
        return
    try:
        axes = np.broadcast_shapes(*(x.shape[:-1] for x in plain))
    except ValueError:
        with pytest.raises(InvalidValueError, match="broadcast"):
            function(panda, *vectors)
        return
    before = [np.array(x, dtype=float) for x in vectors]
    found = function(panda, *vectors)
    assert found.shape == (*axes, *core)
    assert found.dtype == np.float64
    for vector, old in zip(vectors, before, strict=True):
        np.testing.assert_array_equal(np.array(vector, dtype=float), old)
    flat = [np.broadcast_to(x, (*axes, N)).reshape(-1, N) for x in plain]
    for k, result in enumerate(found.reshape(-1, *core)[:3]):
        expected = function(panda, *(x[k] for x in flat))
        np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9 * (1 + np.abs(expected).max()))


WRONG = {
    "nothing": None,
    "a number": 1.0,
    "no numbers": ["x"] * N,
    "a word": "stand",
    "a set": {1, 2},
    "ragged": [[0.0] * N, [0.0] * (N - 1)],
    "short": np.zeros(N - 1),
    "long": np.zeros((30, N + 1)),
    "empty": np.zeros(0),
    "empty rows": np.zeros((30, 0)),
    "transposed": np.zeros((N, 30)),
    "objects": np.array([object()] * N),
    "dates": np.zeros((30, N), "datetime64[s]"),
    "text": np.full((30, N), "a"),
    "complex numbers": np.full((30, N), 1j),
    "record": np.zeros(N, [("x", float)]),
    "huge integers": [10**400] * N,
}
for place in ("one", "few", "many"):
    for bad in (np.nan, np.inf, -np.inf):
        array = np.zeros({"one": (N,), "few": (2, N), "many": (40, N)}[place])
        array[..., 3] = bad
        WRONG[f"{bad} in {place}"] = array


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_arrays_are_refused_by_name(panda, wrong):
    for name, (function, count, _) in FUNCTIONS.items():
        names = {"forward_dynamics": "q v tau", "da_dv": "q v tau"}.get(name, "q v a").split()
        for place in range(count):
            vectors = [np.zeros(N)] * count
            vectors[place] = WRONG[wrong]
            with pytest.raises(InvalidValueError) as caught:
                function(panda, *vectors)
            assert caught.value.quantity == names[place], name


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("count", [(), (40,)])
def test_huge_numbers_are_refused_and_large_ones_do_not_crash(panda, name, count):
    """Beyond 1e9 is refused by joint; up to there the process and the shape survive."""
    function, inputs, core = FUNCTIONS[name]
    with pytest.raises(InvalidValueError, match=r"panda_joint1|are beyond"):
        function(panda, *[np.full((*count, N), 1e200)] * inputs)
    with np.errstate(all="ignore"):
        try:
            found = function(panda, *[np.full((*count, N), 1e9)] * inputs)
        except (InvalidValueError, InfeasibleError):  # an acceleration beyond 1e9, a floor that pulls
            assert name in ("da_dv", "zero_moment_point")
            return
    assert found.shape == (*count, *core)


@pytest.mark.parametrize("frame", ["no such link", "", None, 3, ("panda_hand",)])
def test_unknown_frames_are_refused(panda, frame):
    q = np.zeros((40, N))
    for states in (q[0], q):
        for ask in (kinematics.frame_pose, kinematics.frame_jacobian, kinematics.manipulability):
            with pytest.raises(UnknownNameError, match="unknown frame"):
                ask(panda, states, frame)
        with pytest.raises(UnknownNameError, match="unknown frame"):
            kinematics.frame_velocity(panda, states, states, frame)


def test_kernels_refuse_what_they_do_not_know(panda):
    with pytest.raises(UnknownNameError, match=r"unknown quantity 'mass'; available: .*mass_matrix"):
        batch.kernel(panda, "mass")
    with pytest.raises(UnknownNameError, match="unknown frame 'nose'"):
        batch.kernel(panda, "frame_pose", "nose")
    with pytest.raises(InvalidValueError, match="float16"):
        batch.kernel(panda, "mass_matrix", dtype="float16")
    with pytest.raises(InvalidValueError, match=r"frame_poses: got .* expected names, which can be hashed"):
        batch.kernel(panda, "frame_poses", ["panda_hand"])
    with pytest.raises(InvalidValueError, match="pepper: got 'panda', expected a PepperModel"):
        batch.kernel("panda", "mass_matrix")


def test_a_point_that_does_not_exist_is_named():
    pepper = pk.load_pepper()
    fall = np.zeros((40, pepper.n))
    jacobian = dynamics.center_of_mass_jacobian(pepper, pepper.neutral())
    fall[7] = np.linalg.pinv(jacobian) @ [0, 0, -100.0]
    for states in (fall, fall[7]):
        with pytest.raises(InfeasibleError, match="the floor would have to pull"):
            dynamics.zero_moment_point(pepper, pepper.neutral(), np.zeros(pepper.n), states)
