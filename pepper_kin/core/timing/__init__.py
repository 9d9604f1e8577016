"""Time-optimal path parameterization: the fastest motion along a piecewise cubic path within limits.

Reading order: `tables`, `grid` (the path at the points of a grid), `constraints` (linear rows at the grid
points and checks between them), `reachability` (the two passes of TOPP-RA), `parameterization` (the search
and its result).
"""
