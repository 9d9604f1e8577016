"""pepper_kin: Pepper kinematics, dynamics, planning, timing and twin."""
