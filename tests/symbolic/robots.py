"""Robots of every kind of joint: Pepper's variants, three of example-robot-data, and an odd one."""

from functools import cache
from importlib import metadata

import pepper_kin as pk

PEPPERS = {f"pepper-{b}-{h}": (b, h) for b in ("fixed", "planar") for h in ("locked", "mimic", "independent")}
OTHERS = {
    "panda": "panda_description/urdf/panda.urdf",
    "romeo": "romeo_description/urdf/romeo_small.urdf",
    "talos": "talos_data/robots/talos_reduced.urdf",
}
# Every kind of joint, skew axes, branches, a mimic joint with an offset, masses on all links and gears.
ODD = """<robot name="odd">
  <link name="world"/>
  {links}
  <joint name="lift" type="prismatic"><parent link="world"/><child link="l0"/><axis xyz="0.3 0.1 1"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.1 0.2 -0.3"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="turn" type="continuous"><parent link="l0"/><child link="l1"/><axis xyz="1 2 -0.5"/>
    <origin xyz="0.2 0 0.1" rpy="-0.4 0.1 0.6"/></joint>
  <joint name="slide" type="prismatic"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
    <origin xyz="0 0.1 0.2" rpy="0 0 1.1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="swing" type="revolute"><parent link="l2"/><child link="l3"/><axis xyz="0 0 -1"/>
    <origin xyz="-0.3 0.1 0" rpy="0.5 0 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="follow" type="revolute"><parent link="l1"/><child link="l4"/><axis xyz="1 0 0"/>
    <origin xyz="0 0.3 0.1"/><limit lower="-2" upper="2" effort="1" velocity="1"/>
    <mimic joint="swing" multiplier="-0.7" offset="0.4"/></joint>
  <joint name="reach" type="prismatic"><parent link="l4"/><child link="l5"/><axis xyz="0 0.6 0.8"/>
    <origin xyz="0.1 0 0" rpy="0.2 0 0.1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="slide" multiplier="2" offset="-0.1"/></joint>
</robot>""".format(
    links="".join(
        f"""<link name="l{k}"><inertial><origin xyz="{0.1 * k} 0.05 -0.02" rpy="0.1 {0.2 * k} 0"/>
        <mass value="{1 + 0.3 * k}"/><inertia ixx="0.02" ixy="0.001" ixz="-0.002" iyy="0.03" iyz="0.003"
        izz="0.025"/></inertial></link>"""
        for k in range(6)
    )
)


def load_example(place):
    """Load a robot of example-robot-data, wherever that is installed; its meshes are not needed."""
    share = "cmeel.prefix/share/example-robot-data/robots"
    return pk.load_robot(metadata.distribution("example-robot-data").locate_file(f"{share}/{place}"))


@cache
def loaded(name):
    """Return a robot, the same one at each call; the odd one has the inertia of gears, which URDF lacks."""
    if name in PEPPERS:
        return pk.load_pepper(*PEPPERS[name])
    if name in OTHERS:
        return load_example(OTHERS[name])
    odd = pk.load_robot(ODD)
    model = odd.pinocchio_model
    model.armature[:] = [0.1, 0.2, 0.05, 0.3, 0.15, 0.25]
    return odd.with_pinocchio_model(model)


NAMES = (*PEPPERS, *OTHERS, "odd")
