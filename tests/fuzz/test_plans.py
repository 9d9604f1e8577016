"""Plans and the statuses of failures, against coal on the URDF's text, and Pinocchio's limits and torques.

Five robots among random objects.  Of a plan: its ends are start and a goal; its curve, evaluated here every
hundredth of a radian, touches nothing, keeps the limits of joints, and can be held against gravity with what
is carried, and inside of the wheels' triangle where that is kept, as Pepper does by itself; `retime` takes
it with the same balance, torque and payload.  Of a failure: what its status says is so.
"""

from __future__ import annotations

import coal_world as world
import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.motion import PlanStatus

APART = 0.01
"""Greatest change of a joint between states of a curve that are examined [rad or m]."""
SHARE = 0.95
"""Share of the effort that motions may use which ends of a path may take, as the docs say."""
PEPPERS = (0.01, 0.9)
"""Balance [m] and share of the effort that motions of Pepper keep by themselves, as the docs say."""
TO_MOVE = 0.004
"""What ends keep beyond `balance`, as messages say [m]."""
OPEN = 0.025
"""A straight line on which everything keeps this has to be found [m]."""
HANDS = ("l_gripper", "r_gripper")
WHEELS = ("WheelFL_link", "WheelFR_link", "WheelB_link")
NOT_FOUND = (PlanStatus.START_SHUT_IN, PlanStatus.GOAL_SHUT_IN, PlanStatus.NO_PATH_IN_TIME)


class Case:
    """A random problem, and what is true of its configurations by Pinocchio and coal."""

    def __init__(self, rng: np.random.Generator, name: str) -> None:
        self.robot = robot = world.robot_of(name)
        self.scene = world.random_scene(rng, robot, int(rng.integers(0, 8)), holding=rng.random() < 0.2)
        self.oracle = world.World(robot, self.scene)
        self.options = {"margin": float(rng.choice([0.0, 0.01, 0.03])), "seed": int(rng.integers(100))}
        self.payload: dict[str, float] = {}
        self.balance, self.scale = PEPPERS if name.startswith("pepper") else (None, 1.0)
        self.timing: dict[str, object] = {}
        if name == "pepper" and rng.random() < 0.4:
            self.balance = self.timing["balance"] = [None, 0.0, 0.02][rng.integers(3)]
        if rng.random() < 0.3:
            self.scale = self.timing["torque_scale"] = float(rng.choice([0.7, 1.0]))
        if name == "pepper" and rng.random() < 0.4:
            self.payload = {str(rng.choice(HANDS)): float(rng.uniform(0.05, 0.6))}
            self.timing["payload"] = self.payload
        self.options |= self.timing
        self.heeds_balance = rng.random() < 0.8
        self.start, stays = self.sound(world.random_states(rng, robot, 30)), rng.random(robot.model.n) < 0.3
        if name.startswith("pepper") and rng.random() < 0.3:
            self.start = robot.model.posture("Stand")
        goals = []
        for _ in range(int(rng.integers(1, 4))):
            drawn = world.random_states(rng, robot, 30)
            drawn = self.start + rng.uniform(0.2, 1.0) * (drawn - self.start)
            drawn[:, stays] = self.start[stays]
            goals.append(self.sound(drawn))
        self.goals = np.array(goals)

    def sound(self, states: np.ndarray) -> np.ndarray:
        """Return the first of some states that touches nothing and mostly stands, or the first of all."""
        open_ones = (q for q in states if self.stands(q) or not self.heeds_balance)
        return next((q for q in open_ones if self.oracle.verdict(q) is False), states[0])

    def stands(self, q: np.ndarray, room: float = TO_MOVE) -> bool:
        """Return whether the robot keeps the balance asked for, and some room [m], where any is."""
        return self.balance is None or self.inside(q) >= self.balance + room

    def overload(self, q: np.ndarray) -> float:
        """Return the greatest torque that holding still takes, as a share of what motions may use."""
        torque = self.robot.holding_torque(q, self.payload)
        return float((np.abs(torque) / self.robot.model.effort_limits).max() / self.scale)

    def inside(self, q: np.ndarray) -> float:
        """Return how far inside of the wheels' triangle the center of mass is, with what is carried [m]."""
        robot = self.robot
        model, data = robot.inner, robot.data
        pinocchio.framesForwardKinematics(model, data, robot.full(q))
        loads = [
            (data.oMi[i].act(model.inertias[i].lever), model.inertias[i].mass) for i in range(model.njoints)
        ]
        loads += [(data.oMf[model.getFrameId(hand)].translation, kg) for hand, kg in self.payload.items()]
        center = sum(np.array(place) * kg for place, kg in loads) / sum(kg for _, kg in loads)
        corners = [data.oMf[model.getFrameId(wheel)].translation[:2] for wheel in WHEELS]
        middle, gaps = np.mean(corners, axis=0), []
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
            normal *= np.sign(normal @ (middle - a))
            gaps.append(normal @ (center[:2] - a))
        return float(min(gaps))

    def faults_of_end(self, status: PlanStatus, q: np.ndarray) -> list[str]:
        """Return what contradicts a status that blames an end of a path."""
        match status.name.partition("_")[2]:
            case "IN_COLLISION":
                return ["it touches nothing"] if self.oracle.verdict(q) is False else []
            case "TORQUE_LIMIT":
                return ["it can be held"] if self.overload(q) < SHARE - 1e-6 else []
            case "TIPS_OVER":
                return ["it stands"] if self.stands(q, TO_MOVE - 1e-6) else []
        return [f"nothing was asked that {status.name} answers"]

    def faults(self, plan: pk.Plan) -> list[str]:
        """Return what is wrong with a plan, or with what it says of a failure."""
        if not plan.advice or not plan.message.endswith((".", ").")):
            return [f"no sentence: {plan.report()}"]
        if plan.success:
            return self.faults_of_path(plan)
        if plan.path is not None:
            return ["a path of a plan that failed"]
        if plan.status in NOT_FOUND:
            clear = [k for k, goal in enumerate(self.goals) if self.is_open(goal)]
            return [f"the straight line to goal {k} is open" for k in clear]
        return self.faults_of_end(plan.status, self.start if "START" in plan.status.name else self.goals[0])

    def is_open(self, goal: np.ndarray) -> bool:
        """Return whether everything on the straight line to a goal keeps a distance, and is held easily."""
        wide = world.World(self.robot, self.scene, OPEN, OPEN)
        count = int(np.ceil(np.abs(goal - self.start).max() / 0.05)) + 1
        for x in np.linspace(0.0, 1.0, count):
            q = self.start + x * (goal - self.start)
            if not self.stands(q, 2 * TO_MOVE) or self.overload(q) > SHARE - 0.05:
                return False
            if wide.verdict(q) is not False:
                return False
        return True

    def faults_of_path(self, plan: pk.Plan) -> list[str]:
        """Return what is wrong with a path that was found."""
        low, high = self.robot.model.lower_limits, self.robot.model.upper_limits
        states = states_along(plan)
        found = []
        if np.abs(states[0] - self.start).max() > 1e-9:
            found.append("it begins elsewhere")
        if np.abs(self.goals - states[-1]).max(axis=1).min() > 1e-9:
            found.append("it ends at no goal")
        if (states < low - 1e-9).any() or (states > high + 1e-9).any():
            found.append("it leaves the limits of joints")
        for q in states:
            if self.oracle.must_touch(q):
                found.append(f"it touches something at {q.tolist()}")
            if self.overload(q) > 1.0:
                found.append(f"it cannot be held at {q.tolist()}")
            if not self.stands(q, -1e-6):
                found.append(f"it tips over at {q.tolist()}")
        if self.robot.name == "pepper" and plan.curve is not None:
            try:
                pk.retime(self.robot.model, plan, **self.timing)
            except pk.PepperKinError as error:
                found.append(f"retime refuses it: {error}")
        return found


def states_along(plan: pk.Plan) -> np.ndarray:
    """Return states of a plan's curve, ends included, shape (m, n), by an evaluation of its polynomials."""
    if plan.curve is None:
        return np.array(plan.path)
    states = []
    for k, terms in enumerate(np.array(plan.curve.coefficients)):
        width = plan.curve.breaks[k + 1] - plan.curve.breaks[k]
        speed = np.abs(terms[1]) + 2 * np.abs(terms[2]) * width + 3 * np.abs(terms[3]) * width**2
        count = int(np.ceil(width * speed.max() / APART)) + 1
        x = np.linspace(0.0, width, count + 1)[:, None]
        states.append(terms[0] + x * (terms[1] + x * (terms[2] + x * terms[3])))
    return np.concatenate(states)


@pytest.mark.parametrize("name", world.ROBOTS)
def test_plans_and_failures_are_true(name, amount, rng, tried):
    paths, failures, wrong = 0, 0, []
    for _ in range(amount(2, 20, 2000)):
        case = Case(rng, name)
        goals = case.goals if len(case.goals) > 1 else case.goals[0]
        plan = pk.plan(case.robot.model, case.start, goals, case.scene, timeout=2.0, **case.options)
        faults = case.faults(plan)
        paths, failures = paths + plan.success, failures + (not plan.success)
        if faults:
            wrong.append(
                (name, plan.report(), faults[0], case.start.tolist(), case.goals.tolist(), case.options)
            )
    tried("plans", paths, wrong=sum("No path" not in fault[1] for fault in wrong))
    tried("failures to plan", failures)
    assert not wrong, wrong[0]
