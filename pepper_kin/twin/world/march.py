"""A robot and a world, many steps in one call."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.twin.command import Command
from pepper_kin.twin.integrator import Series
from pepper_kin.twin.world.colliders import Colliders
from pepper_kin.twin.world.march_loop import ABSURD, Bodies, Limbs, Robot, Shapes, Touch, march
from pepper_kin.twin.world.search import MOST_POINTS
from pepper_kin.twin.world.step import StepSolution
from pepper_kin.twin.world.tree import Tree, TreeState

if TYPE_CHECKING:
    from pepper_kin.twin.fast.single import SingleRobot

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class March:
    """The tables of a world as compiled code takes them.

    Args:
        tree: The robot's.
        state: Of the tree; written to.
        table: All shapes; written to.
        rough: Friction of each shape, shape (k,).
        bodies: The free bodies; moved.
    """

    def __init__(self, tree: Tree, state: TreeState, table: Colliders, rough: Array, bodies: Bodies) -> None:
        self._limbs = Limbs(
            tree.parent, tree.rotation, tree.position, tree.axis, tree.slides, tree.driver, tree.ratio,
            tree.offset, state.rotation, state.position, state.axis, state.linear, state.angular,
        )  # fmt: skip
        self._shapes = Shapes(
            table.kind, table.size, table.mover, table.index, table.own_rotation, table.own_position,
            table.ball, table.rotation, table.position, table.middle, table.speed, table.pairs, rough,
        )  # fmt: skip
        self._bodies = bodies
        joints = int(tree.driver.max()) + 1
        self._touch = Touch(
            rows=np.zeros((MOST_POINTS, 7)),
            shapes=np.zeros((MOST_POINTS, 2), np.int64),
            undecided=np.zeros((MOST_POINTS, 2), np.int64),
            forces=np.zeros((MOST_POINTS, 3)),
            velocity=np.zeros(joints + 6 * len(bodies.mass)),
            impulses=np.zeros(3 * MOST_POINTS),
            load=np.zeros(joints),
            numbers=np.zeros(3, np.int64),
            lift=np.zeros(1),
        )

    def run(
        self, robot: SingleRobot, q: Array, v: Array, command: Command, load: Array
    ) -> tuple[Series, int]:
        """Advance as far as machine code goes; see `World.march`.

        Returns:
            The states, and how many steps the bodies have made: one more than the good ones where the last
            state of the robot is one that diverged.
        """
        rows = np.empty((3, *command.position.shape))
        told = tuple(np.array(x, dtype=float, order="C") for x in (*command, load))
        taken, why = march(
            Robot(*robot.arrays), self._limbs, self._shapes, self._bodies, self._touch,
            np.array(q, dtype=float), np.array(v, dtype=float), told, rows,
        )  # fmt: skip
        position, velocity, torque = rows[:, :taken]
        return Series(position, velocity, torque, taken - 1 if why == ABSURD else taken), taken

    def found(self) -> tuple[Array, Indices, Array, StepSolution | None]:
        """Return points, pairs of shapes, forces and solution of the last step."""
        touch = self._touch
        count, size, problems = touch.numbers.tolist()
        solution = None
        if count:
            found = (touch.velocity[:size].copy(), touch.impulses[: 3 * count].copy())
            solution = StepSolution(*found, "compiled", problems, float(touch.lift[0]))
        return touch.rows[:count].copy(), touch.shapes[:count].copy(), touch.forces[:count].copy(), solution
