"""Rows of a data set of IK solutions, some of which cannot be solved: benchmarks/ik_rows.py [--rows 20000].

Reachable targets are where the left hand is in random postures clear of self-collision.  Others are drawn
evenly in a box around the robot and kept where `solve_batch` finds no solution; they are mixed in between.
Collisions are examined.  Each kind is measured in turn, a thousand rows at a time, in processor time.  Then
all rows are solved with the search for the closest configuration too, and what is solved is compared.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np
from ik_targets import HIGH, LEFT, LOW, PEPPER

import pepper_kin as pk
from pepper_kin.ik.batch import CODES, BatchResult

LEAST, MOST = (-0.5, -1.0, 0.0), (1.0, 1.0, 1.7)
PIECE, SHARE = 1000, 0.03


def reachable(count: int, generator: np.random.Generator) -> np.ndarray:
    """Return where the hand is in postures clear of self-collision [m], shape (count, 3)."""
    found = np.empty((0, 3))
    while len(found) < count:
        q = generator.uniform(LOW, HIGH, (4096, PEPPER.n))
        q = q[~pk.collision.in_collision(PEPPER, q)]
        found = np.concatenate([found, pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3]])
    return found[:count]


def unsolvable(count: int, generator: np.random.Generator) -> np.ndarray:
    """Return points of the box that are not reached [m], shape (count, 3)."""
    points = generator.uniform(LEAST, MOST, (2 * count + 50, 3))
    return points[~solve(points, closest=False).success][:count]


def solve(points: np.ndarray, *, closest: bool) -> BatchResult:
    return pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points), closest=closest)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--long", type=int, default=2_000, help="rows that are solved with `closest`")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    generator = np.random.default_rng(arguments.seed)
    solvable = reachable(arguments.rows, generator)
    mixed = solvable.copy()
    places = generator.permutation(arguments.rows)[: round(SHARE * arguments.rows)]
    mixed[places] = unsolvable(places.size, generator)
    kinds = {
        "all reachable": (solvable, False, arguments.rows),
        "3 % not, `closest=False`": (mixed, False, arguments.rows),
        "3 % not, `closest=True`": (mixed, True, min(arguments.long, arguments.rows)),
    }
    spent, reasons = dict.fromkeys(kinds, 0.0), Counter[str]()
    for begin in range(0, arguments.rows, PIECE):
        for name, (points, closest, count) in kinds.items():
            piece = points[begin : min(begin + PIECE, count)]
            if len(piece):
                start = time.process_time()
                found = solve(piece, closest=closest)
                spent[name] += time.process_time() - start
                if points is mixed and not closest:
                    proven = np.any(found.shortfalls > 1e-3, axis=1)
                    reasons.update(
                        CODES[code].value + (", proven out of reach" if sure else "")
                        for code, sure in zip(found.codes, proven, strict=True)
                    )
                    assert all(found.reason(int(row)) for row in np.flatnonzero(~found.success))
    print("| rows | count | us a row | of all reachable |\n|---|---|---|---|")
    each = {name: 1e6 * spent[name] / kinds[name][2] for name in kinds}
    for name, micro in each.items():
        print(f"| {name} | {kinds[name][2]} | {micro:.1f} | {micro / each['all reachable']:.2f} |")
    print(dict(reasons))
    before, after = (solve(solvable, closest=closest) for closest in (True, False))
    print(
        f"of {len(solvable)} reachable rows {int(before.success.sum())} are solved with closest=True, "
        f"{int(after.success.sum())} with False, {int(np.sum(before.success & ~after.success))} lost; "
        f"{int(np.sum(np.all(before.q == after.q, axis=1)))} answers are the same to the last bit"
    )


if __name__ == "__main__":
    main()
