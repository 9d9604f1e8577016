"""Newton's equations of a spline: a block band, bordered by one column."""

from __future__ import annotations

import numpy as np

from ..vectors import FloatArray


class BorderedBand:
    """A symmetric matrix [[A, b], [b^T, c]] whose A couples only neighbouring control points.

    Args:
        count: Number of control points C.
        reach: How far apart two coupled control points may be: the degree of the spline.
        n: Number of coordinates of a control point.

    Attributes:
        blocks: Blocks (i + d, i) of A for d = 0 ... reach, shape (C, reach + 1, n, n).
        diagonals: A view of their diagonals, shape (C, reach + 1, n).
        border: b, shape (C, n).
        corner: c.
        gradient: Right-hand side of the control points, shape (C, n).
        slope: Right-hand side of the bordering variable.
    """

    def __init__(self, count: int, reach: int, n: int) -> None:
        self.blocks = np.zeros((count, reach + 1, n, n))
        self.diagonals = np.einsum("cdii->cdi", self.blocks)
        self.border, self.gradient = np.zeros((count, n)), np.zeros((count, n))
        self.corner = self.slope = 0.0

    def solve(self, fixed: int, damping: float, free_border: bool) -> tuple[FloatArray, float, float]:
        """Return minus the solution for (gradient, slope), and how much the quadratic model falls.

        Args:
            fixed: Number of control points at either end that do not move.
            damping: Share by which the diagonal is raised.
            free_border: Whether the bordering variable may move.

        Returns:
            The step of the inner control points, shape (C - 2 fixed, n), that of the bordering variable, and
            gradient . step, which is negative.

        Raises:
            numpy.linalg.LinAlgError: where the matrix is not positive definite.
        """
        from scipy.linalg import cho_solve_banded, cholesky_banded

        inner = slice(fixed, len(self.blocks) - fixed)
        band = _banded(self.blocks[inner])
        band[0] *= 1.0 + damping
        right = np.stack([self.gradient[inner].ravel(), self.border[inner].ravel()], axis=1)
        factor = cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        solved = cho_solve_banded((factor, True), right, check_finite=False)
        step, border_step = -solved[:, 0], 0.0
        if free_border:
            schur = self.corner * (1.0 + damping) - right[:, 1] @ solved[:, 1]
            border_step = (right[:, 1] @ solved[:, 0] - self.slope) / max(schur, 1e-12 * self.corner)
            step = step - solved[:, 1] * border_step
        slope = float(right[:, 0] @ step + self.slope * border_step)
        return step.reshape(-1, self.border.shape[1]), float(border_step), slope


def _banded(blocks: FloatArray) -> FloatArray:
    """Return LAPACK's lower band storage, band[i - j, j] = A[i, j], of blocks, shape (C, r + 1, n, n)."""
    count, width, n, _ = blocks.shape
    column = np.zeros((count, n, (width + 1) * n))
    column[:, :, : width * n] = blocks.transpose(0, 3, 1, 2).reshape(count, n, width * n)
    # In column j of a block the band starts at row j: each column of numbers is shifted up by j.
    bandwidth = width * n
    band = np.zeros((bandwidth, count, n))
    for j in range(n):
        band[:, :, j] = column[:, j, j : j + bandwidth].T
    return band.reshape(bandwidth, count * n)
