"""Time integration of articulated robots with actuators, free bodies and contacts."""
