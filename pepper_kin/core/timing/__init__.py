"""Time-optimal path parameterization: the fastest motion along a piecewise cubic path within limits.

The order to read: `tables`, `grid` (the path at the points of a grid), `constraints` (linear rows at these
points and checks between them), `reachability` (the two passes of TOPP-RA), `parameterization` (the search
and its result).
"""
