"""Compiled Newton equations of cost plus barrier over control points and duration.

The matrix is [[A, b], [b^T, c]]: A couples neighboring control points only, b is the duration's column.
"""

from __future__ import annotations

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.row_sums import add_rows
from pepper_kin.kernels.signatures import Floats1, Floats2
from pepper_kin.kernels.tile_products import TILE_COLUMNS, TILE_ROWS, add_tile

from .banded import add_four_rows, add_row, dot, factorize, solve_factorized
from .compiled_term import FAILED, ROWS
from .merit import ask_term, box_barrier, fill_slacks, sample, term_barrier, term_square
from .tables import (
    CORNER,
    COST,
    DAMPING,
    FALL,
    FIRST,
    FIXED,
    MU,
    ORDERS,
    PARTS,
    ROWS_COUNT,
    SAMPLING,
    SLOPE,
    STEP,
    WALL,
    WALLS,
    WITHIN_ONE,
    SplineTables,
    SplineWorkspace,
)

_FOUR = 4
_SMALL = 1e-12


@compiled(lean=True)
def _slopes(value: float, barrier_bound: int) -> tuple[float, float]:
    """Return the first and the second derivative of the barrier by a value."""
    if barrier_bound == WITHIN_ONE:
        up, down = 1.0 / (1.0 - value), 1.0 / (1.0 + value)
        return up - down, up * up + down * down
    if value >= 1.0:
        return 0.0, 0.0
    return -1.0 / value, 1.0 / (value * value)


@compiled(lean=True)
def _add_outer(
    target: int, stride: int, rows: tuple[int, int, int], count: int, size: int, on_diagonal: bool
) -> None:
    """Add sum_r left_r^T right_r to a square block of a matrix.

    Args:
        target: Address of the block's first number.
        stride: Stride from one row of the matrix to the next, in numbers.
        rows: Addresses of the first left and of the first right row, and the stride of rows, in numbers.
        count: Number of rows.
        size: Number of rows and columns of the block, a multiple of a tile's.
        on_diagonal: Whether the block is on the matrix's diagonal: then only tiles that reach the upper
            triangle are added.
    """
    left, right, step = rows
    for a in range(0, size, TILE_ROWS):
        for b in range(a - a % TILE_COLUMNS if on_diagonal else 0, size, TILE_COLUMNS):
            add_tile(target + 8 * (a * stride + b), stride, left + 8 * a, right + 8 * b, step, count, 1.0)


@compiled(lean=True)
def _add_slopes(target: Floats1, rows: Floats2, count: int, shares: Floats1) -> None:
    """Add sum_r share_r row_r; rows and shares are padded as by `_pad`."""
    size = target.size
    for r in range(0, count, _FOUR):
        ends = rows[r, :size], rows[r + 1, :size], rows[r + 2, :size], rows[r + 3, :size]
        add_four_rows(target, ends, shares[r], shares[r + 1], shares[r + 2], shares[r + 3])


@compiled(lean=True)
def _pad(rows: Floats2, shares: Floats2, count: int) -> int:
    """Append rows and factors of zero; return the new number of rows."""
    while count % _FOUR != 0:
        for k in range(rows.shape[1]):
            rows[count, k] = 0.0
        shares[0, count] = shares[1, count] = 0.0
        count += 1
    return count


@compiled(lean=True)
def _spread(work: SplineWorkspace, basis: Floats2, place: int, samples: tuple[int, int], n: int) -> None:
    """Add matrices of up to four samples, times the weights of two control points there, to the band.

    Args:
        work: Workspace with the matrices in `sums`, zero for missing samples.
        basis: Weights of the control points at samples, shape (K, p + 1).
        place: Index of the interval's first control point among the free ones, below zero if it is fixed.
        samples: Index of the first sample, and number of samples.
        n: Number of coordinates.
    """
    sums, (first, count) = work.sums, samples
    size, stride, inner = sums.shape[1], work.band.shape[1] - 1, work.right.size // n
    here, band = sums.ctypes.data, work.band.ctypes.data
    for i in range(max(0, -place), min(basis.shape[1], inner - place)):
        for j in range(i, min(basis.shape[1], inner - place)):
            p = basis[first, i] * basis[first, j]
            q = basis[first + 1, i] * basis[first + 1, j] if count > 1 else 0.0
            r = basis[first + 2, i] * basis[first + 2, j] if count > 2 else 0.0
            s = basis[first + 3, i] * basis[first + 3, j] if count > 3 else 0.0
            if p == 0.0 and q == 0.0 and r == 0.0 and s == 0.0:
                continue
            for a in range(n):
                begin = a - a % _FOUR if i == j else 0
                target = ((place + i) * n + a) * stride + (place + j) * n + begin
                own, matrix = here + 8 * (a * size + begin), 8 * size * size
                places = own, own + matrix, own + 2 * matrix, own + 3 * matrix
                add_rows(int(band + 8 * target), places, (p, q, r, s), size - begin)


@compiled(lean=True)
def _cost_factor(tables: SplineTables, t: int, duration: float) -> float:
    """Return twice the factor of a term's squares in the cost; 0 for a constraint."""
    share = tables.shares[t]
    return 2.0 * share * duration / tables.counts[tables.terms[t, SAMPLING], 0] if share >= 0.0 else 0.0


@compiled(lean=True)
def _gather(
    tables: SplineTables,
    work: SplineWorkspace,
    t: int,
    k: int,
    factors: tuple[float, float, float],
    used: int,
) -> int:
    """Append the active rows of a sample, with gradients and curvatures; return the new number of rows."""
    term, (mu, bend, share), rows, scaled = tables.terms[t], factors, work.rows, work.scaled
    most, n, count = term[ROWS_COUNT], tables.jerk_weight.size, tables.counts[term[SAMPLING], 0]
    value = work.results[term[FIRST] :]
    for r in range(k * most, (k + 1) * most):
        first, second = share * value[r], share
        if share == 0.0:
            first, second = _slopes(value[r], term[WALL])
            first, second = mu * first, bend * second
        if second != 0.0:
            begin = count * most + r * n
            for j in range(n):
                rows[used, j] = value[begin + j]
                scaled[used, j] = second * value[begin + j]
            work.shares[0, used] = first
            used += 1
    return used


@compiled(lean=True)
def _add_by_position(
    tables: SplineTables, work: SplineWorkspace, s: int, mus: tuple[float, float], duration: float
) -> None:
    """Add all terms of one sampling that depend on positions only."""
    rows, scaled, sums, n = work.rows, work.scaled, work.sums, tables.jerk_weight.size
    count, per, pull = tables.counts[s, 0], tables.counts[s, 1], work.shares[2, :n]
    basis, inner, size = tables.basis[s, 0], work.right.size // n, sums.shape[1]
    left_and_right = scaled.ctypes.data, rows.ctypes.data, rows.shape[1]
    for begin in range(0, count, per):
        place = begin // per - FIXED
        for group in range(begin, begin + per, _FOUR):
            acting, last = False, min(group + _FOUR, begin + per)
            for i in range(_FOUR):
                for a in range(size):
                    for b in range(size):
                        sums[i, a, b] = 0.0
            for k in range(group, last):
                used = 0
                for t in range(tables.shares.size):
                    if tables.terms[t, SAMPLING] == s and tables.terms[t, PARTS] == 1:
                        used = _gather(
                            tables, work, t, k, (mus[0], mus[1], _cost_factor(tables, t, duration)), used
                        )
                if used == 0:
                    continue
                acting = True
                _add_outer(sums[k - group].ctypes.data, size, left_and_right, used, size, False)
                for j in range(n):
                    pull[j] = 0.0
                _add_slopes(pull, rows, _pad(rows, work.shares, used), work.shares[0])
                for i in range(max(0, -place), min(basis.shape[1], inner - place)):
                    if basis[k, i] != 0.0:
                        add_row(work.right[(place + i) * n : (place + i + 1) * n], basis[k, i], pull)
            if acting:
                _spread(work, basis, place, (group, last - group), n)


@compiled(lean=True)
def _fill_motion_rows(
    tables: SplineTables,
    work: SplineWorkspace,
    t: int,
    k: int,
    factors: tuple[float, float, float],
    duration: float,
) -> None:
    """Write the derivatives of a sample's rows by the control points of its interval, with curvatures."""
    term, (mu, bend, share), rows, numbers = tables.terms[t], factors, work.rows, work.numbers
    s, most, shares, n = term[SAMPLING], term[ROWS_COUNT], work.shares, tables.jerk_weight.size
    count, width, states = tables.counts[s, 0], tables.basis.shape[3], work.states[s]
    value, size, scaled = work.results[term[FIRST] :], work.sums.shape[1], work.scaled
    for r in range(most):
        row, first, second = k * most + r, share * value[k * most + r], share
        if share == 0.0:
            first, second = _slopes(value[row], term[WALL])
            first, second = mu * first, bend * second
        begin, step = count * most + row * n, count * most * n
        velocity, acceleration = states[(count + k) * n :], states[(2 * count + k) * n :]
        by_duration = -dot(value[begin + step : begin + step + n], velocity[:n]) / duration
        by_duration -= 2.0 * dot(value[begin + 2 * step : begin + 2 * step + n], acceleration[:n]) / duration
        parts = (
            value[begin : begin + n], value[begin + step : begin + step + n],
            value[begin + 2 * step : begin + 2 * step + n], value[begin : begin + n],
        )  # fmt: skip
        for i in range(width):
            own = rows[r, i * size : i * size + n]
            for j in range(n):
                own[j] = 0.0
            p, q = tables.basis[s, 0, k, i], tables.basis[s, 1, k, i] / duration
            add_four_rows(own, parts, p, q, tables.basis[s, 2, k, i] / duration**2, 0.0)
        for j in range(rows.shape[1]):
            scaled[r, j] = second * rows[r, j]
        shares[0, r], shares[1, r] = first, second * by_duration
        numbers[SLOPE] += first * by_duration
        numbers[CORNER] += second * by_duration * by_duration


@compiled(lean=True)
def _add_by_motion(
    tables: SplineTables, work: SplineWorkspace, t: int, factors: tuple[float, float, float], duration: float
) -> None:
    """Add a term that also depends on velocities and accelerations."""
    term, rows, scaled, shares = tables.terms[t], work.rows, work.scaled, work.shares
    s, most, n = term[SAMPLING], term[ROWS_COUNT], tables.jerk_weight.size
    count, per, width = tables.counts[s, 0], tables.counts[s, 1], tables.basis.shape[3]
    inner, size, stride = work.right.size // n, work.sums.shape[1], work.band.shape[1] - 1
    left, right, band = scaled.ctypes.data, rows.ctypes.data, work.band.ctypes.data
    for k in range(count):
        _fill_motion_rows(tables, work, t, k, factors, duration)
        padded, points = _pad(rows, shares, most), width
        if tables.basis[s, 0, k, width - 1] == 0.0 and tables.basis[s, 2, k, width - 1] == 0.0:
            points -= 1  # at a knot
        place = k // per - FIXED
        for i in range(max(0, -place), min(points, inner - place)):
            begin = (place + i) * n
            for j in range(i, min(points, inner - place)):
                target = band + 8 * (begin * stride + (place + j) * n)
                here = left + 8 * i * size, right + 8 * j * size, rows.shape[1]
                _add_outer(target, stride, here, most, size, i == j)
            low, high = i * size, i * size + n
            for r in range(0, padded, _FOUR):
                ends = (
                    rows[r, low:high], rows[r + 1, low:high], rows[r + 2, low:high], rows[r + 3, low:high],
                )  # fmt: skip
                first, mixed = shares[0], shares[1]
                add_four_rows(
                    work.right[begin : begin + n], ends, first[r], first[r + 1], first[r + 2], first[r + 3]
                )
                add_four_rows(
                    work.border[begin : begin + n], ends, mixed[r], mixed[r + 1], mixed[r + 2], mixed[r + 3]
                )


@compiled(lean=True)
def _add_jerk(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> float:
    """Add w |r|^2 with r = jerk T^(1/2); in the duration, r falls as T^(-5/2).  Return the cost."""
    count, n = control.shape
    inner, reach = count - 2 * FIXED, tables.jerk.shape[1]
    scale, cost, numbers = 2.0 / duration**5, 0.0, work.numbers
    for i in range(count):
        place = i - FIXED
        for j in range(n):
            pull = 0.0
            for d in range(reach):
                if i + d < count:
                    pull += tables.jerk[i, d] * control[i + d, j]
                if d > 0 and i - d >= 0:
                    pull += tables.jerk[i - d, d] * control[i - d, j]
            pull *= scale * tables.jerk_weight[j]
            cost += 0.5 * pull * control[i, j]
            if 0 <= place < inner:
                work.right[place * n + j] += pull
                work.border[place * n + j] -= 2.5 / duration * pull
        if 0 <= place < inner:
            for d in range(min(reach, inner - place)):
                weight = scale * tables.jerk[i, d]
                for j in range(n):
                    work.band[place * n + j, d * n] += weight * tables.jerk_weight[j]
    numbers[SLOPE] -= 5.0 / duration * cost
    numbers[CORNER] += 12.5 / duration**2 * cost
    return cost


@compiled(lean=True)
def _add_boxes(
    tables: SplineTables, work: SplineWorkspace, duration: float, mus: tuple[float, float]
) -> None:
    """Add the barriers of positions, velocities, accelerations and jerks, whose slacks are known."""
    slacks, numbers, (mu, bend) = work.slacks, work.numbers, mus
    n, count = slacks.shape[2], slacks.shape[1]
    inner, rates = count - 2 * FIXED, tables.rates
    for i in range(inner):
        for j in range(n):
            below, above = 1.0 / slacks[0, FIXED + i, j], 1.0 / slacks[1, FIXED + i, j]
            size = tables.box[2, j]
            work.right[i * n + j] += mu / size * (above - below)
            work.band[i * n + j, 0] += bend / (size * size) * (below * below + above * above)
    time_scale = 1.0
    for order in range(1, ORDERS + 1):
        time_scale /= duration
        for i in range(count - order):
            for j in range(n):
                scale = tables.inverse_limits[order - 1, j] * time_scale
                if scale == 0.0:
                    continue
                share = 1.0 - slacks[2 * order, i, j]
                up, down = 1.0 / slacks[2 * order, i, j], 1.0 / slacks[2 * order + 1, i, j]
                first, second = mu * (up - down), bend * (up * up + down * down)
                by_duration = -order / duration * share
                numbers[SLOPE] += first * by_duration
                numbers[CORNER] += second * by_duration * by_duration
                first, mixed, second = first * scale, second * scale * by_duration, second * scale * scale
                for a in range(order + 1):
                    row = i + a - FIXED
                    if row < 0 or row >= inner:
                        continue
                    weight = rates[order - 1, i, a]
                    work.right[row * n + j] += first * weight
                    work.border[row * n + j] += mixed * weight
                    for b in range(a + 1):
                        if row - a + b >= 0:
                            entry = second * weight * rates[order - 1, i, b]
                            work.band[(row - a + b) * n + j, (a - b) * n] += entry


@compiled(lean=True)
def fill_system(
    tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float, mus: tuple[float, float]
) -> bool:
    """Write Newton's equations of cost + mu * barrier, cost and barrier; return whether no term failed.

    Args:
        tables: Costs and constraints.
        work: Workspace.
        control: Control points, shape (C, n).
        duration: The duration.
        mus: Weight mu of the barrier in the gradient, and its value in the matrix.
    """
    numbers, (mu, bend) = work.numbers, mus
    numbers[SLOPE], numbers[CORNER], numbers[MU] = tables.time_weight[0], 0.0, mu
    for i in range(work.right.size):
        work.right[i], work.border[i] = 0.0, 0.0
    for i in range(work.band.shape[0]):
        for j in range(work.band.shape[1]):
            work.band[i, j] = 0.0
    fill_slacks(tables, work, control, duration)
    sample(tables, work, control, duration)
    _add_boxes(tables, work, duration, mus)
    cost = tables.time_weight[0] * duration + _add_jerk(tables, work, control, duration)
    walls = box_barrier(work)
    for t in range(tables.shares.size):
        if ask_term(tables, work, t, ROWS) == FAILED:
            return False
        factor = _cost_factor(tables, t, duration)
        if tables.shares[t] >= 0.0:
            total = term_square(tables, work, t)
            cost += 0.5 * factor * total
            numbers[SLOPE] += 0.5 * factor * total / duration
        else:
            walls += term_barrier(tables, work, t)
        if tables.terms[t, PARTS] != 1:
            _add_by_motion(tables, work, t, (mu, bend, factor), duration)
    for s in range(tables.counts.shape[0]):
        _add_by_position(tables, work, s, mus, duration)
    numbers[COST], numbers[WALLS] = cost, walls
    return True


@compiled(lean=True)
def solve_system(work: SplineWorkspace, damping: float, free_duration: bool) -> bool:
    """Write the steps of control points and duration, and gradient . step.

    The matrix is replaced by its factor.

    Args:
        work: Workspace with Newton's equations.
        damping: Ratio by which the diagonal is raised.
        free_duration: Whether the duration may change.

    Returns:
        Whether the matrix is positive definite.
    """
    numbers, band, step, n_all = work.numbers, work.band[: work.right.size], work.step, work.right.size
    for i in range(n_all):
        band[i, 0] *= 1.0 + damping
        step[i] = -work.right[i]
    if not factorize(band):
        return False
    solve_factorized(band, step)
    numbers[STEP] = 0.0
    if free_duration:
        across = work.across
        for i in range(n_all):
            across[i] = work.border[i]
        solve_factorized(band, across)
        schur, pull = numbers[CORNER] * (1.0 + damping), -numbers[SLOPE]
        for i in range(n_all):
            schur -= work.border[i] * across[i]
            pull -= work.border[i] * step[i]
        numbers[STEP] = pull / max(schur, _SMALL * numbers[CORNER])
        for i in range(n_all):
            step[i] -= across[i] * numbers[STEP]
    fall = numbers[SLOPE] * numbers[STEP]
    for i in range(n_all):
        fall += work.right[i] * step[i]
    numbers[FALL], numbers[DAMPING] = fall, damping
    return True
