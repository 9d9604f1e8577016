"""The same functions on any robot: a two-link arm from a URDF text."""

import numpy as np

import pepper_kin as pk

URDF = """<robot name="two_links">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="3"/></joint>
</robot>"""

robot = pk.load_robot(URDF)
torque = pk.dynamics.gravity_torque(robot, np.zeros(2))
print(robot)
print("torques that hold it stretched out:", torque.round(3), "N m")

# About +y a positive torque turns the arm down, so holding it up takes negative ones.
assert np.allclose(torque, [-9.81 * (0.25 + 0.75), -9.81 * 0.25])
