"""Pepper's visible shape, made by code from measured cross-sections.

`python -m pepper_kin.urdf.visuals` rewrites `urdf/meshes/*.stl` and `urdf/xacro/visuals.xacro`.
"""
