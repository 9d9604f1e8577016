"""Newton's equations of cost plus barrier over control points and duration, compiled.

The matrix is [[A, b], [b^T, c]]: A couples neighboring control points only, b is the duration's column.
"""

from __future__ import annotations

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

from .banded import add_four_rows, add_row, dot, factorize, solve_factorized
from .compiled_term import ROWS
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
    Tables,
    Workspace,
)

_FOUR = 4
_SMALL = 1e-12


@compiled(lean=True)
def _slopes(value: float, wall: int) -> tuple[float, float]:
    """Return first and second derivative of the barrier by a value."""
    if wall == WITHIN_ONE:
        up, down = 1.0 / (1.0 - value), 1.0 / (1.0 + value)
        return up - down, up * up + down * down
    if value >= 1.0:
        return 0.0, 0.0
    return -1.0 / value, 1.0 / (value * value)


@compiled(lean=True)
def _add_products(window: Floats2, begin: int, rows: Floats2, count: int, size: int) -> None:
    """Add sum_r curvature_r row_r row_r^T to the upper triangle of a window that begins at a row of an array.

    Curvatures are in the last column of the rows, which are padded by zeros to a multiple of four.
    """
    last = rows.shape[1] - 1
    for first in range(0, count, _FOUR):
        one, two, three, four = rows[first], rows[first + 1], rows[first + 2], rows[first + 3]
        for a in range(size):
            p, q = one[last] * one[a], two[last] * two[a]
            r, s = three[last] * three[a], four[last] * four[a]
            if p != 0.0 or q != 0.0 or r != 0.0 or s != 0.0:
                ends = one[a:size], two[a:size], three[a:size], four[a:size]
                add_four_rows(window[begin + a, a:size], ends, p, q, r, s)


@compiled(lean=True)
def _add_slopes(target: Floats1, rows: Floats2, count: int, shares: Floats1) -> None:
    """Add sum_r share_r row_r; rows are padded as in `_add_products`, and so are the shares."""
    size = target.size
    for r in range(0, count, _FOUR):
        ends = rows[r, :size], rows[r + 1, :size], rows[r + 2, :size], rows[r + 3, :size]
        add_four_rows(target, ends, shares[r], shares[r + 1], shares[r + 2], shares[r + 3])


@compiled(lean=True)
def _pad(rows: Floats2, shares: Floats2, count: int) -> int:
    """Append rows and shares of zero; return how many there are then."""
    while count % _FOUR != 0:
        for k in range(rows.shape[1]):
            rows[count, k] = 0.0
        shares[0, count] = shares[1, count] = 0.0
        count += 1
    return count


@compiled(lean=True)
def _flush(work: Workspace, first: int, n: int) -> None:
    """Add the window of an interval, whose first control point is given, to the band."""
    band, window = work.band, work.window
    inner, width = band.shape[0] // n, window.shape[0]
    for i in range(width // n):
        row = first + i - FIXED
        if row < 0 or row >= inner:
            continue
        for a in range(n):
            own = i * n + a
            count = min(width - own, (inner - row) * n - a)
            add_row(band[row * n + a, :count], 1.0, window[own, own : own + count])


@compiled(lean=True)
def _clear(window: Floats2) -> None:
    for a in range(window.shape[0]):
        for b in range(a, window.shape[0]):
            window[a, b] = 0.0


@compiled(lean=True)
def _spread(window: Floats2, basis: Floats2, first: int, count: int, sums: Floats2, n: int) -> None:
    """Add matrices of up to four samples, times the weights of two control points there, to the window.

    Args:
        window: Of the interval; its upper triangle is added to.
        basis: Weights of the control points at samples, shape (K, p + 1).
        first: The first of the samples.
        count: Their number.
        sums: The matrices, one below the other, zero where there is none, shape (4 n, n).
        n: Number of coordinates.
    """
    for i in range(basis.shape[1]):
        for j in range(i, basis.shape[1]):
            p = basis[first, i] * basis[first, j]
            q = basis[first + 1, i] * basis[first + 1, j] if count > 1 else 0.0
            r = basis[first + 2, i] * basis[first + 2, j] if count > 2 else 0.0
            s = basis[first + 3, i] * basis[first + 3, j] if count > 3 else 0.0
            if p == 0.0 and q == 0.0 and r == 0.0 and s == 0.0:
                continue
            for a in range(n):
                begin = a if i == j else 0
                ends = (
                    sums[a, begin:n], sums[n + a, begin:n], sums[2 * n + a, begin:n],
                    sums[3 * n + a, begin:n],
                )  # fmt: skip
                add_four_rows(window[i * n + a, j * n + begin : (j + 1) * n], ends, p, q, r, s)


@compiled(lean=True)
def _gather(tables: Tables, work: Workspace, t: int, k: int, factors: tuple[float, float]) -> int:
    """Copy the rows of a sample that act, with slopes and curvatures; return their number, padded."""
    term, (mu, share), rows, shares = tables.terms[t], factors, work.rows, work.shares
    most, n, count = term[ROWS_COUNT], tables.jerk_weight.size, tables.counts[term[SAMPLING], 0]
    used, value = 0, work.results[term[FIRST] :]
    for r in range(k * most, (k + 1) * most):
        first, second = share * value[r], share
        if share == 0.0:
            first, second = _slopes(value[r], term[WALL])
            first, second = mu * first, mu * second
        if second != 0.0:
            begin = count * most + r * n
            for j in range(n):
                rows[used, j] = value[begin + j]
            rows[used, rows.shape[1] - 1], shares[0, used] = second, first
            used += 1
    return _pad(rows, shares, used)


@compiled(lean=True)
def _add_by_position(tables: Tables, work: Workspace, t: int, factors: tuple[float, float], n: int) -> None:
    """Add a term that depends on positions only; `factors` are those of the barrier and of the square."""
    term, rows, sums, pull = tables.terms[t], work.rows, work.sums, work.shares[2, :n]
    count, per = tables.counts[term[SAMPLING], 0], tables.counts[term[SAMPLING], 1]
    basis, inner = tables.basis[term[SAMPLING], 0], work.right.size // n
    for begin in range(0, count, per):
        dirty = False
        for group in range(begin, begin + per, _FOUR):
            size, acting = min(_FOUR, begin + per - group), False
            for a in range(_FOUR * n):
                for b in range(n):
                    sums[a, b] = 0.0
            for k in range(group, group + size):
                used = _gather(tables, work, t, k, factors)
                if used == 0:
                    continue
                acting = True
                _add_products(sums, (k - group) * n, rows, used, n)
                for j in range(n):
                    pull[j] = 0.0
                _add_slopes(pull, rows, used, work.shares[0])
                for i in range(basis.shape[1]):
                    place = begin // per + i - FIXED
                    if 0 <= place < inner and basis[k, i] != 0.0:
                        add_row(work.right[place * n : (place + 1) * n], basis[k, i], pull)
            if acting:
                if not dirty:
                    _clear(work.window)
                    dirty = True
                for a in range(_FOUR * n):
                    for b in range(a % n):
                        sums[a, b] = sums[a - a % n + b, a % n]
                _spread(work.window, basis, group, size, sums, n)
        if dirty:
            _flush(work, begin // per, n)


@compiled(lean=True)
def _fill_motion_rows(
    tables: Tables, work: Workspace, t: int, k: int, factors: tuple[float, float], duration: float
) -> None:
    """Write the rows of a sample by all control points of its interval, with slopes and curvatures."""
    term, (mu, share), rows, numbers = tables.terms[t], factors, work.rows, work.numbers
    s, most, shares, n = term[SAMPLING], term[ROWS_COUNT], work.shares, tables.jerk_weight.size
    count, width, states = tables.counts[s, 0], tables.basis.shape[3], work.states[s]
    value = work.results[term[FIRST] :]
    for r in range(most):
        row, first, second = k * most + r, share * value[k * most + r], share
        if share == 0.0:
            first, second = _slopes(value[row], term[WALL])
            first, second = mu * first, mu * second
        begin, step = count * most + row * n, count * most * n
        by_duration = (
            -1.0
            / duration
            * dot(value[begin + step : begin + step + n], states[(count + k) * n : (count + k + 1) * n])
        )
        by_duration -= (
            2.0
            / duration
            * dot(
                value[begin + 2 * step : begin + 2 * step + n],
                states[(2 * count + k) * n : (2 * count + k + 1) * n],
            )
        )
        parts = (
            value[begin : begin + n], value[begin + step : begin + step + n],
            value[begin + 2 * step : begin + 2 * step + n], value[begin : begin + n],
        )  # fmt: skip
        for i in range(width):
            own = rows[r, i * n : (i + 1) * n]
            for j in range(n):
                own[j] = 0.0
            p, q = tables.basis[s, 0, k, i], tables.basis[s, 1, k, i] / duration
            add_four_rows(own, parts, p, q, tables.basis[s, 2, k, i] / duration**2, 0.0)
        rows[r, rows.shape[1] - 1], shares[0, r], shares[1, r] = second, first, second * by_duration
        numbers[SLOPE] += first * by_duration
        numbers[CORNER] += second * by_duration * by_duration


@compiled(lean=True)
def _add_by_motion(
    tables: Tables, work: Workspace, t: int, factors: tuple[float, float], duration: float
) -> None:
    """Add a term that depends on velocities and accelerations, too."""
    term, rows, shares = tables.terms[t], work.rows, work.shares
    s, most, n = term[SAMPLING], term[ROWS_COUNT], tables.jerk_weight.size
    count, per, width = tables.counts[s, 0], tables.counts[s, 1], tables.basis.shape[3]
    inner = work.right.size // n
    for k in range(count):
        if k % per == 0:
            _clear(work.window)
        _fill_motion_rows(tables, work, t, k, factors, duration)
        padded, size = _pad(rows, shares, most), width * n
        if tables.basis[s, 0, k, width - 1] == 0.0 and tables.basis[s, 2, k, width - 1] == 0.0:
            size -= n  # at a knot
        _add_products(work.window, 0, rows, padded, size)
        place = k // per - FIXED
        low, high = max(0, -place) * n, min(size, (inner - place) * n)
        if low < high:
            # Columns of those control points that are free.
            for r in range(0, padded, _FOUR):
                ends = (
                    rows[r, low:high], rows[r + 1, low:high], rows[r + 2, low:high], rows[r + 3, low:high],
                )  # fmt: skip
                right = work.right[place * n + low : place * n + high]
                add_four_rows(right, ends, shares[0, r], shares[0, r + 1], shares[0, r + 2], shares[0, r + 3])
                border = work.border[place * n + low : place * n + high]
                add_four_rows(
                    border, ends, shares[1, r], shares[1, r + 1], shares[1, r + 2], shares[1, r + 3]
                )
        if k % per == per - 1:
            _flush(work, k // per, n)


@compiled(lean=True)
def _add_jerk(tables: Tables, work: Workspace, control: Floats2, duration: float) -> float:
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
def _add_boxes(tables: Tables, work: Workspace, duration: float, mu: float) -> None:
    """Add the barriers of positions, velocities, accelerations and jerks, whose slacks are known."""
    slacks, numbers = work.slacks, work.numbers
    n, count = slacks.shape[2], slacks.shape[1]
    inner, rates = count - 2 * FIXED, tables.rates
    for i in range(inner):
        for j in range(n):
            below, above = 1.0 / slacks[0, FIXED + i, j], 1.0 / slacks[1, FIXED + i, j]
            size = tables.box[2, j]
            work.right[i * n + j] += mu / size * (above - below)
            work.band[i * n + j, 0] += mu / (size * size) * (below * below + above * above)
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
                first, second = mu * (up - down), mu * (up * up + down * down)
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
def fill_system(tables: Tables, work: Workspace, control: Floats2, duration: float, mu: float) -> bool:
    """Write Newton's equations of cost + mu * barrier, and the two; return whether all terms answered."""
    numbers, n = work.numbers, control.shape[1]
    numbers[SLOPE], numbers[CORNER], numbers[MU] = tables.time_weight[0], 0.0, mu
    for i in range(work.band.shape[0]):
        work.right[i], work.border[i] = 0.0, 0.0
        for j in range(work.band.shape[1]):
            work.band[i, j] = 0.0
    fill_slacks(tables, work, control, duration)
    sample(tables, work, control, duration)
    _add_boxes(tables, work, duration, mu)
    cost = tables.time_weight[0] * duration + _add_jerk(tables, work, control, duration)
    walls = box_barrier(work)
    for t in range(tables.shares.size):
        if not ask_term(tables, work, t, ROWS):
            return False
        share, term = tables.shares[t], tables.terms[t]
        factor = 0.0
        if share >= 0.0:
            total = term_square(tables, work, t)
            factor = 2.0 * share * duration / tables.counts[term[SAMPLING], 0]
            cost += 0.5 * factor * total
            numbers[SLOPE] += 0.5 * factor * total / duration
        else:
            walls += term_barrier(tables, work, t)
        if term[PARTS] == 1:
            _add_by_position(tables, work, t, (mu, factor), n)
        else:
            _add_by_motion(tables, work, t, (mu, factor), duration)
    numbers[COST], numbers[WALLS] = cost, walls
    return True


@compiled(lean=True)
def solve_system(work: Workspace, damping: float, free_duration: bool) -> bool:
    """Write the steps of control points and duration, and gradient . step.

    The matrix is replaced by its factor.

    Args:
        work: Workspace with Newton's equations.
        damping: Share by which the diagonal is raised.
        free_duration: Whether the duration may change.

    Returns:
        Whether the matrix is positive definite.
    """
    numbers, band, step, n_all = work.numbers, work.band, work.step, work.right.size
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
