"""Random robots that URDF allows and that few people have: see `odd_robot`."""

import struct
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

POINTS = np.array([(0, 0, 0), (0.2, 0, 0), (0, 0.1, 0), (0, 0, 0.3)])
SOLID = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
NAMES = ("{}", "link {}", "Gelenk-ü{}", "a/{}", "{}.0", "Joint{}'", "x{}&<", "{}_joint", "{}_to_world")
RESERVED = {"sdf": ("__{}__", "a::{}"), "mjcf": ("world",)}
"""Names that a format keeps for itself, by format; SDF keeps "world", too."""


@dataclass
class OddRobot:
    """A robot's text, and what a format cannot express of it.

    Attributes:
        text: The URDF.
        refusals: Formats that may refuse it: "sdf", "mjcf".
        unread: Names of mesh files that MuJoCo cannot read.
    """

    text: str = ""
    refusals: set[str] = field(default_factory=set)
    unread: set[str] = field(default_factory=set)


def write_meshes(folder: Path) -> None:
    """Write mesh files: solid, flat, of one triangle, as text, with odd names."""

    def obj(triangles) -> str:
        corners = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS.tolist())
        return corners + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles)

    def stl(triangles) -> bytes:
        rows = (struct.pack("<12fH", 0, 0, 0, *POINTS[list(t)].ravel(), 0) for t in triangles)
        return b"solid ".ljust(80, b" ") + struct.pack("<I", len(triangles)) + b"".join(rows)

    lines = ["solid x"]
    for triangle in SOLID:
        corners = "".join("vertex {} {} {}\n".format(*POINTS[i].tolist()) for i in triangle)
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    (folder / "solid.obj").write_text(obj(SOLID))
    (folder / "my part.stl").write_bytes(stl(SOLID))
    (folder / "100%25.STL").write_bytes(stl(SOLID))
    (folder / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    (folder / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    (folder / "text.stl").write_text("\n".join([*lines, "endsolid x", ""]))


def odd_robot(rng: np.random.Generator, folder: Path) -> OddRobot:
    """Return a random robot of 1 to 7 links beside its root, with meshes of a folder (`write_meshes`).

    Joints of all types, with limits of no range, of ranges without zero or none, followers of followers with
    their own limits; bodies without mass, points, rods, plates and impossible ones; names with all signs of
    XML, equal ones of links and joints, and reserved ones; versions 1.0 to 1.2.
    """
    made = OddRobot()
    version = rng.choice(["", "1.0", "1.1", "1.2"])
    count = int(rng.integers(1, 8))
    names = [_name(rng, k, made) for k in range(count + 1)]
    parts, joints, moving = [], [], []
    for k in range(count + 1):
        shapes = "".join(_shape(rng, kind, version, folder, made) for kind in ("visual", "collision"))
        parts.append(f"<link name={quoteattr(names[k])}>{_inertial(rng, k, version, made)}{shapes}</link>")
    for k in range(1, count + 1):
        kind = str(rng.choice(["revolute", "revolute", "continuous", "prismatic", "fixed"]))
        kind = "revolute" if k == count and not moving else kind
        name = names[k] if rng.random() < 0.1 else f"j{k}"
        leader = moving[int(rng.integers(len(moving)))] if moving and rng.random() < 0.25 else None
        ends = f"<parent link={quoteattr(names[int(rng.integers(k))])}/><child link={quoteattr(names[k])}/>"
        body = _origin(rng, version) + ends + _axis(rng) + _limit(rng, kind)
        if rng.random() < 0.3:
            body += '<dynamics damping="{:.3f}" friction="{:.3f}"/>'.format(*rng.random(2))
        if leader is not None and kind != "fixed":
            gain, shift = rng.choice([-2.0, -1.0, 0.5, 1.0]), rng.choice([0.0, 0.1])
            body += f'<mimic joint={quoteattr(leader)} multiplier="{gain}" offset="{shift}"/>'
        joints.append(f"<joint name={quoteattr(name)} type={quoteattr(kind)}>{body}</joint>")
        if kind != "fixed":
            moving.append(name)
    stated = f' version="{version}"' if version else ""
    made.text = f'<robot name="odd"{stated}>{"".join(parts)}{"".join(joints)}</robot>'
    return made


def _name(rng, k, made):
    if k and rng.random() < 0.002:
        form = str(rng.choice([name for names in RESERVED.values() for name in names]))
        made.refusals |= {"sdf", *(["mjcf"] if form == "world" else [])}
        return form.format(k) if form != "world" or "world" not in made.text else f"w{k}"
    return str(rng.choice(NAMES)).format(k)


def _numbers(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def _origin(rng, version) -> str:
    turn = f'rpy="{_numbers(rng.uniform(-3, 3, 3))}"'
    if version in ("1.1", "1.2") and rng.random() < 0.5:
        turn = f'quat_xyzw="{_numbers(rng.normal(size=4))}"'
    return f'<origin xyz="{_numbers(rng.uniform(-0.3, 0.3, 3))}" {turn}/>'


def _axis(rng) -> str:
    return f'<axis xyz="{_numbers(rng.normal(size=3))}"/>' if rng.random() < 0.9 else ""


def _limit(rng, kind) -> str:
    if kind == "fixed" or (kind == "continuous" and rng.random() < 0.5):
        return ""
    low, width = rng.uniform(-2, 1), rng.uniform(0.1, 2)
    low, width = ((low, width), (0.0, 0.0), (0.3, 0.0), (0.5, 1.0))[rng.choice(4, p=[0.7, 0.1, 0.1, 0.1])]
    effort, velocity = rng.choice([0.0, 5.0, 40.0]), rng.choice([0.0, 2.0])
    bounds = (
        f'lower="{float(low)!r}" upper="{float(low + width)!r}" '
        if low or width or rng.random() < 0.5
        else ""
    )
    return f'<limit {bounds}effort="{effort}" velocity="{velocity}"/>'


def _inertial(rng, k, version, made) -> str:
    form = rng.choice(
        ["body", "none", "point", "rod", "plate", "impossible"], p=[0.62, 0.2, 0.07, 0.06, 0.048, 0.002]
    )
    if form == "none":
        return ""
    a, b, c = rng.uniform(0.001, 0.1, 3)  # half the moments of squared sizes
    moments = {
        "point": (0.0, 0.0, 0.0), "rod": (0.0, a, a), "plate": (a, b, a + b), "impossible": (a, a, 3 * a + b),
    }.get(str(form), (b + c, a + c, a + b))  # fmt: skip
    if form == "impossible":
        made.refusals |= {"sdf", "mjcf"}
    tensor = dict(zip(("ixx", "iyy", "izz"), map(float, moments), strict=True), ixy=0.0, ixz=0.0, iyz=0.0)
    told = " ".join(f'{key}="{value!r}"' for key, value in tensor.items())
    mass = f'<mass value="{float(rng.uniform(0.1, 3))!r}"/>'
    return f"<inertial>{_origin(rng, version)}{mass}<inertia {told}/></inertial>"


def _shape(rng, kind, version, folder, made) -> str:
    if rng.random() < 0.5:
        return ""
    solids = ['<box size="0.1 0.2 0.3"/>', '<sphere radius="0.1"/>', '<cylinder radius="0.1" length="0.3"/>']
    solid = str(rng.choice(solids))
    if version == "1.2" and rng.random() < 0.3:
        solid = '<capsule radius="0.05" length="0.2"/>'
    if rng.random() < 0.4:
        files = ("solid.obj", "my part.stl", "100%25.STL", "flat.obj", "one.obj", "text.stl")
        name, scale = str(rng.choice(files)), str(rng.choice(["1 1 1", "0.5 -1 2", "1 1 0", "1 0 0"]))
        if (
            name in ("one.obj", "text.stl")
            or scale == "1 0 0"
            or (name == "flat.obj" and kind == "collision")
        ):
            made.unread.add(name)
        uri = (folder / name).as_uri() if rng.random() < 0.5 else str(folder / name)
        solid = f'<mesh filename={quoteattr(uri)} scale="{scale}"/>'
    name = ' name="same"' if rng.random() < 0.3 else ""
    return f"<{kind}{name}>{_origin(rng, version)}<geometry>{solid}</geometry></{kind}>" * int(
        rng.integers(1, 3)
    )
