"""Machine code of planners, loaded before the clock of a plan starts."""

from __future__ import annotations

from functools import cache

from pepper_kin.planners.deadline import load_code


@cache
def load_code_of(kind: str) -> None:
    """Load, or compile, what a planner runs besides what all planning does.

    Args:
        kind: "aorrtc", "costs" or "constraints"; anything else needs nothing more.
    """
    if kind in ("aorrtc", "costs"):
        from pepper_kin.planners.rejoin import shortest_end
        from pepper_kin.planners.shortcut import drop_flat, shorten
        from pepper_kin.planners.tree_growth import first_path, grow

        load_code(first_path, grow, drop_flat, shorten, shortest_end)
    if kind in ("costs", "constraints"):
        from pepper_kin.planners.cost_descent import descend, measure_costs, shorten_by_cost
        from pepper_kin.planners.transition_rrt import grow as grow_by_cost
        from pepper_kin.planners.transition_rrt import last_valid_step, price_at

        load_code(shorten_by_cost, descend, measure_costs, grow_by_cost, price_at, last_valid_step)
    if kind == "constraints":
        from pepper_kin.planners.cbirrt import grow as grow_on_manifold
        from pepper_kin.planners.cbirrt import measure_rows, walk
        from pepper_kin.planners.constraint_manifold import edges_hold, project_rows

        load_code(grow_on_manifold, walk, measure_rows, project_rows, edges_hold)
