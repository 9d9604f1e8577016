"""The generators of the visual meshes, against closed forms."""

import math

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.urdf.visuals.decals import Projector, Relief, band, ring, spot, strip
from pepper_kin.urdf.visuals.loft import Loft, superellipse
from pepper_kin.urdf.visuals.measurements import link_shape
from pepper_kin.urdf.visuals.mesh import Mesh, join
from pepper_kin.urdf.visuals.part import measured_loft
from pepper_kin.urdf.visuals.solids import drum, ellipsoid
from pepper_kin.urdf.visuals.stl import FACET, to_bytes

RADII = np.array([0.05, 0.08, 0.11])
CENTER = np.array([0.01, -0.02, 0.03])


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_ellipsoid_has_its_volume_and_surface(axis: str) -> None:
    mesh = ellipsoid(CENTER, RADII, axis).mesh(120, 90)
    assert mesh.volume == pytest.approx(4.0 / 3.0 * math.pi * np.prod(RADII), rel=0.01)
    level = np.linalg.norm((mesh.vertices - CENTER) / RADII, axis=1)
    assert np.abs(level - 1.0).max() < 0.01


@pytest.mark.parametrize("exponent", [2.0, 2.5, 3.0, 4.0, 6.0])
def test_superellipse_area_is_the_gamma_function_formula(exponent: float) -> None:
    phi = np.linspace(0.0, 2.0 * math.pi, 20_000, endpoint=False)
    area = 0.5 * np.mean(superellipse(phi, np.asarray(exponent)) ** 2) * 2.0 * math.pi
    exact = 4.0 * math.gamma(1.0 + 1.0 / exponent) ** 2 / math.gamma(1.0 + 2.0 / exponent)
    assert area == pytest.approx(exact, rel=1e-6)


def test_drum_volume_grows_to_that_of_the_cylinder_as_the_fillets_vanish() -> None:
    exact = math.pi * 0.03**2 * 0.1
    volumes = [
        drum("y", np.zeros(3), (0.03, 0.03), (0.0, 0.1), fillets=(f, f)).mesh(160, 60).volume
        for f in (0.01, 0.004, 0.0)
    ]
    assert volumes[0] < volumes[1] < volumes[2]
    assert volumes[2] == pytest.approx(exact, rel=0.002)


def test_rays_hit_the_sphere_at_its_radius() -> None:
    ball = ellipsoid(CENTER, np.full(3, 0.07))
    generator = np.random.default_rng(4)
    directions = generator.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distance = np.linalg.norm(ball.hit(CENTER, directions) - CENTER, axis=1)
    assert np.abs(distance - 0.07).max() < 0.0005


def test_hit_points_lie_on_the_gauge_and_origins_outside_are_refused() -> None:
    surface = measured_loft("Pelvis")
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.6, 0.8, 0.0]])
    origin = np.array([0.01, 0.0, 0.15])
    assert surface.gauge(surface.hit(origin, directions)) == pytest.approx(1.0, abs=1e-9)
    with pytest.raises(InvalidValueError, match="origins: got points outside"):
        surface.hit(np.array([0.3, 0.0, 0.15]), directions)


@pytest.mark.parametrize("name", ["Pelvis", "torso", "Head", "LBicep", "l_wrist", "phalanx", "wheel"])
def test_lofts_pass_near_the_measured_sections(name: str) -> None:
    # The outermost sections are left out: some links end flat there, and the default ends are round.
    rows = link_shape(name).sections[1:-1]
    center, half, _ = measured_loft(name).section(rows[:, 0])
    assert np.abs(center - rows[:, 1:3]).max() < 0.005
    assert np.abs(half - rows[:, 3:5]).max() < 0.005
    assert np.median(np.abs(half - rows[:, 3:5])) < 0.001


def test_round_ends_close_and_flat_ends_stay_open() -> None:
    surface = measured_loft("Neck", round_ends=(True, False))
    _, half, _ = surface.section(np.array([surface.start, surface.end]))
    assert half[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert half[1].min() > 0.005


def test_between_keeps_the_surface() -> None:
    whole = measured_loft("Pelvis")
    part = whole.between(0.10, 0.20, knots=30)
    s = np.linspace(0.11, 0.19, 20)
    for ours, theirs in zip(part.section(s), whole.section(s), strict=True):
        assert np.abs(ours - theirs).max() < 5e-4 * (1.0 + np.abs(theirs).max() * 20)


def test_decals_stand_where_the_relief_says() -> None:
    radius = 0.1
    ball = ellipsoid(np.zeros(3), np.full(3, radius))
    front = Projector.toward(np.zeros(3), [1.0, 0.0, 0.0])
    relief = Relief(lift=0.002, sink=0.001, depth=0.004)
    patch = spot(ball, front, (0.02, 0.01), relief=relief)
    assert patch.bounds[1, 0] == pytest.approx(radius + 0.002, abs=5e-4)
    assert patch.bounds[:, 1:] == pytest.approx(np.array([[-0.02, -0.01], [0.02, 0.01]]), abs=5e-4)
    hoop = ring(ball, front, (0.02, 0.02), 0.004, relief=relief)
    across = np.hypot(hoop.vertices[:, 1], hoop.vertices[:, 2])
    assert (across.min(), across.max()) == pytest.approx((0.016, 0.02), abs=5e-4)
    belt = band(ball, -0.01, 0.01, relief=relief)
    assert np.linalg.norm(belt.vertices, axis=1).max() == pytest.approx(radius + 0.002, abs=5e-4)
    for mesh in (patch, hoop, belt):
        assert mesh.volume > 0.0


def test_strip_faces_outward() -> None:
    ball = ellipsoid(np.zeros(3), np.full(3, 0.1))
    across, up = np.meshgrid(np.linspace(-0.03, 0.03, 7), np.linspace(-0.02, 0.02, 5))
    origins = np.stack([np.zeros_like(up), across, up], axis=-1)
    directions = np.broadcast_to([1.0, 0.0, 0.0], origins.shape)
    mesh = strip(ball, origins, directions, relief=Relief(0.002, 0.001))
    assert mesh.volume > 0.0
    assert mesh.bounds[1, 0] == pytest.approx(0.102, abs=5e-4)


def test_relief_runs_from_lift_to_sink() -> None:
    relief = Relief(lift=0.003, sink=0.001, edge=4.0)
    assert relief.height([0.0, 1.0, -1.0]) == pytest.approx([0.003, -0.001, -0.001])


def test_mirroring_keeps_volume_and_flips_y() -> None:
    mesh = measured_loft("LBicep").mesh(24, 12)
    mirrored = mesh.mirrored()
    assert mirrored.volume == pytest.approx(mesh.volume)
    assert mirrored.bounds[:, 1] == pytest.approx(-mesh.bounds[::-1, 1])
    assert np.array_equal(mirrored.mirrored().vertices, mesh.vertices)


def test_join_adds_volumes_and_refuses_nothing() -> None:
    ball = ellipsoid(np.zeros(3), np.full(3, 0.02)).mesh(16, 10)
    both = join([ball, ball.shifted([0.1, 0.0, 0.0])])
    assert both.volume == pytest.approx(2.0 * ball.volume, rel=1e-3)
    with pytest.raises(InvalidValueError, match="meshes: got an empty sequence"):
        join([])


def test_mesh_is_a_read_only_copy() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mesh = Mesh(vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    vertices[0] = 7.0
    assert mesh.volume == pytest.approx(1.0 / 6.0)
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 1.0


def test_stl_round_trip() -> None:
    mesh = measured_loft("phalanx").mesh(10, 6)
    content = to_bytes(mesh)
    assert np.frombuffer(content, "<u4", 1, 80)[0] == len(mesh.faces)
    facets = np.frombuffer(content, FACET, offset=84)
    assert np.abs(facets["corners"] - mesh.corners).max() < 1e-8


def test_bad_meshes_are_refused() -> None:
    for vertices, faces, message in [
        ([[0.0, 0.0, float("nan")]], [[0, 0, 0]], "vertices"),
        ([[0.0, 0.0]], [[0, 0, 0]], r"vertices: got shape \(1, 2\)"),
        ([[0.0, 0.0, 0.0]], [[0, 0, 1]], r"faces: got 0\.\.1, expected indices from 0 to 0"),
        ([[0.0, 0.0, 0.0]], [[0, 0]], r"faces: got shape \(1, 2\)"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            Mesh(np.array(vertices), np.array(faces))


def test_bad_lofts_are_refused() -> None:
    for change, message in [
        ({"axis": "w"}, "axis: got w, expected one of x, y, z"),
        ({"sections": np.ones((2, 6))}, "increasing positions"),
        ({"sections": np.array([[0.0, 0, 0, 1, -1, 2], [1.0, 0, 0, 1, 1, 2]])}, "positive half widths"),
        ({"sections": np.array([[0.0, 0, 0, 1, np.nan, 2]])}, "finite numbers"),
        ({"start": 0.5}, "an interval around all sections"),
    ]:
        good = {
            "axis": "z",
            "sections": np.array([[0.0, 0, 0, 1, 1, 2], [1.0, 0, 0, 1, 1, 2]]),
            "start": 0.0,
            "end": 1.0,
        }
        Loft(**good)
        with pytest.raises(InvalidValueError, match=message):
            Loft(**(good | change))


def test_unknown_link_names_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="unknown measured link 'Tail'; available: Tibia, Pelvis"):
        link_shape("Tail")
