"""Trajectories: a value, timing within limits, an independent check, animations by keys, pictures.

    Trajectory, State, Samples                piecewise polynomials, and what they are sampled to
    retime                                    a path or plan, timed within all limits
    check, Certificate, LimitCheck, ScalarCheck   results of an examination by independent code
    active_limits, ActiveLimits               the limit that is nearest at each instant
    phase_plane, PhasePlane, plot             a trajectory drawn as fractions of its limits
    plot_motions                              one motion or several, drawn in their units
    find_limit_violations, LimitViolation, enforce_limits   limits that a motion exceeds, and their repair
    Splice                                    a motion redirected to a new goal, by `Trajectory.replaced`
    Stop                                      from an instant of a motion to rest, by `Trajectory.stop`
    OnlineMotion                              jerk-limited motion to targets that may change while it moves
    Timeline, JointCurve, Key, Handle         an animation by keys
    import_timeline, ImportedMotion           an animation as a trajectory within the limits

Files of trajectories are in the package `pepper_kin.files`.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.trajectory.active_limits import ActiveLimits, active_limits
from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.enforce_limits import LimitViolation, enforce_limits, find_limit_violations
from pepper_kin.trajectory.key_curve import Handle, JointCurve, Key
from pepper_kin.trajectory.motion_plots import plot_motions
from pepper_kin.trajectory.online import OnlineMotion
from pepper_kin.trajectory.plot import PhasePlane, phase_plane, plot
from pepper_kin.trajectory.retiming import retime
from pepper_kin.trajectory.samples import Samples, State
from pepper_kin.trajectory.splice import Splice
from pepper_kin.trajectory.stop import Stop
from pepper_kin.trajectory.timeline import ImportedMotion, Timeline, import_timeline
from pepper_kin.trajectory.trajectory import Trajectory

__all__ = [
    "ActiveLimits",
    "Certificate",
    "Handle",
    "ImportedMotion",
    "JointCurve",
    "Key",
    "LimitCheck",
    "LimitViolation",
    "OnlineMotion",
    "PhasePlane",
    "Samples",
    "ScalarCheck",
    "Splice",
    "State",
    "Stop",
    "Timeline",
    "Trajectory",
    "active_limits",
    "check",
    "enforce_limits",
    "find_limit_violations",
    "import_timeline",
    "phase_plane",
    "plot",
    "plot_motions",
    "retime",
]

name_options(__name__)
