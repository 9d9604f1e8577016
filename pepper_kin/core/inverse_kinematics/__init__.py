"""Inverse kinematics in machine code: box-constrained steps, descents, multi-start search."""
