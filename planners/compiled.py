"""Inner steps of the searches for callers that are machine code themselves, and the data of the steps.

    SearchSpace, last_valid_step, measure     box, metric and validity of a search
    first_round, grow, trace                  two trees of RRT-Connect: `Trees`, in a `Search`
    grow_on_manifold, walk                    trees on a constraint; `edges_hold`, `project_rows`
    grow_by_cost, descend, shorten_by_cost    a tree on a cost, and waypoints moved to where it is lower
    shorten, straighten_each, shortest_end    shortcuts of a `Polyline`, and other ends of it
    search_spline                             the descent of `optimization`

All are compiled functions, the tables that they take, indices into tables, or the clocks and numbers of
callers.  The library imports from `planners` only this module and the public names.
"""

from .aorrtc import checked_gap
from .cbirrt import grow as grow_on_manifold
from .cbirrt import walk
from .constraint_manifold import edges_hold, measure_rows, project_rows
from .cost_descent import descend, measure_costs, price_at, shorten_by_cost
from .deadline import PausedClock, Slices, load_code, whole
from .motion_validator import machine_code_of
from .optimization.newton import measure_cost, measure_motion
from .optimization.newton import search as search_spline
from .rejoin import PathTable, shortest_end
from .rrt_connect import LONGEST_STEP, Search
from .sampling import stream_key, uniform
from .search_space import CALLS, ITERATIONS, STATES, SearchSpace, last_valid_step, measure
from .shortcut import (
    FLAT,
    GAINED,
    SIZE,
    STREAM,
    Polyline,
    drop_flat,
    new_polyline,
    shorten,
    skip_ahead,
    straighten_each,
)
from .shortcut import FULL as LINE_FULL
from .shortcut import TIME_UP as LINE_TIME_UP
from .smooth import power_basis, schoenberg_spline, sine_waypoints
from .transition_rrt import grow as grow_by_cost
from .tree import FOUND, Trees, grown, take_trees, trace, with_room
from .tree_growth import GOAL, ROUND, WAY_POINTS, PathEnds, first_round, grow
from .vectors import seed_number

__all__ = [
    "CALLS", "FLAT", "FOUND", "GAINED", "GOAL", "ITERATIONS", "LINE_FULL", "LINE_TIME_UP", "LONGEST_STEP",
    "ROUND", "SIZE", "STATES", "STREAM", "WAY_POINTS", "PathEnds", "PathTable", "PausedClock", "Polyline",
    "Search", "SearchSpace", "Slices", "Trees", "checked_gap", "descend", "drop_flat", "edges_hold",
    "first_round", "grow", "grow_by_cost", "grow_on_manifold", "grown", "last_valid_step", "load_code",
    "machine_code_of", "measure", "measure_cost", "measure_costs", "measure_motion", "measure_rows",
    "new_polyline", "power_basis", "price_at", "project_rows", "schoenberg_spline", "search_spline",
    "seed_number", "shorten", "shorten_by_cost", "shortest_end", "sine_waypoints", "skip_ahead",
    "straighten_each", "stream_key", "take_trees", "trace", "uniform", "walk", "whole", "with_room",
]  # fmt: skip
