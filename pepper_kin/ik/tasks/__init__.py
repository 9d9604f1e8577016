"""Tasks of the inverse kinematics: what a configuration should fulfill."""
