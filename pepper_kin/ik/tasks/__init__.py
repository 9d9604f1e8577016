"""Tasks of the inverse kinematics: objectives of a configuration."""
