"""Trajectory optimization: path and timing together, for a minimum cost."""
