"""Inverse kinematics in machine code: box-constrained steps, local descents, multi-start search."""
