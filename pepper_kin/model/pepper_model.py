"""The robot: names, limits, groups, postures and the Pinocchio model behind them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from pepper_kin.arrays import read_only
from pepper_kin.exceptions import InvalidValueError, UnknownNameError, suspect_degrees
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.dynamics_model import DynamicsModel, working_memory
from pepper_kin.model.follower_limits import coupled_limits
from pepper_kin.model.joint_vectors import as_finite, check_choice, check_within_limits
from pepper_kin.model.requirements import NAMED, WHEELS, MotionRequirements, as_requirements
from pepper_kin.model.semantics import Semantics
from pepper_kin.model.tree_order import depth_first, frame_ids, mimic_map
from pepper_kin.model.urdf_document import UrdfDocument

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pepper_kin.model.changed_model import JointValues
    from pepper_kin.model.export_formats import ExportOptions
    from pepper_kin.model.shapes import Shape
    from pepper_kin.model.wheels import Wheels

changed_model = lazy_module("pepper_kin.model.changed_model")

SOLVERS = ("fast", "reference")
"""Libraries that compute: this one, or the reference Pinocchio, placo, proxsuite, coal and toppra."""
export_formats = lazy_module("pepper_kin.model.export_formats")


@dataclass(frozen=True, eq=False, init=False, repr=False)
class PepperModel:
    """A robot whose every joint has one coordinate: `nq == nv == n`.

    Models are frozen and their arrays are read-only, so threads and packages may share one.

    Args:
        document: The checked URDF.
        semantics: Groups, states and pairs never checked for collision.
        sphere_set: Function from the document to `collision_spheres`; None for a robot without sphere set.
        changed: `pinocchio.Model` to use instead of the document's, or None.
        requirements: Reserves of the robot's motions; None for "reserve" if the description has the wheels on
            which it stands, else "limits".

    Raises:
        ModelError: for a joint that mimics itself, or whose limits and its leader's exclude each other.

    Attributes:
        name: Name of the robot.
        urdf: The URDF text it was built from.
        joint_names: Names of the joints, in the order of every joint vector.
        joint_units: "rad" or "m" for each joint.
        lower_limits: (n,) [rad or m], -inf where unbounded. Limits of position, velocity and acceleration of
            following joints narrow their leader's, by `full_map`: see `follower_limits`.
        upper_limits: (n,) [rad or m], inf where unbounded.
        velocity_limits: (n,) [rad/s or m/s], inf where the description gives none.
        acceleration_limits: (n,) [rad/s^2 or m/s^2], inf where the description gives none.
        effort_limits: (n,) [N m or N].
        link_names: Links in document order.
        visual_shapes: Shapes to draw.
        collision_shapes: Shapes that may not touch.
        full_map: (n_full, n) matrix E of q_full = E q + e.
        full_offset: (n_full,) vector e.
        n: Number of coordinates.
        is_coupled: Whether mimic joints follow others (`pinocchio_model` then has more coordinates than n).
        is_direct: Whether Pinocchio's results need no conversion: no joint follows another, and there is more
            than one joint, since Pinocchio's matrices of one column are vectors.
        requirements: Reserves of the robot's motions, unless a call overrides them.
        solvers: "fast" for this library's solvers, "reference" for other libraries': see `with_solvers`.
        kept: Values that packages cache for this robot, by `RobotMemory`; freed with the robot.
    """

    document: UrdfDocument
    semantics: Semantics
    sphere_set: Callable[[UrdfDocument], tuple[Shape, ...]] | None
    name: str
    urdf: str
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    lower_limits: NDArray[np.float64]
    upper_limits: NDArray[np.float64]
    velocity_limits: NDArray[np.float64]
    acceleration_limits: NDArray[np.float64]
    effort_limits: NDArray[np.float64]
    full_map: NDArray[np.float64]
    full_offset: NDArray[np.float64]
    dynamics_model: DynamicsModel
    n: int
    is_coupled: bool
    is_direct: bool
    requirements: MotionRequirements
    solvers: str
    kept: dict[Any, Any]
    _frame_ids: dict[str, int]
    _local: threading.local

    def __init__(
        self,
        document: UrdfDocument,
        semantics: Semantics,
        sphere_set: Callable[[UrdfDocument], tuple[Shape, ...]] | None = None,
        changed: Any = None,
        requirements: MotionRequirements | None = None,
        solvers: str = "fast",
    ) -> None:
        joints = {joint.name: joint for joint in document.joints if joint.type != "fixed"}
        order = depth_first(document)
        full_names = tuple(joint.name for joint in order if joint.type != "fixed")
        names = tuple(name for name in full_names if joints[name].mimic is None)
        leading = [joints[name] for name in names]
        full_map, full_offset = mimic_map(full_names, names, joints)
        if requirements is None:
            stands = set(WHEELS) <= set(document.links)
            requirements = NAMED["reserve" if stands else "limits"]
        limits = coupled_limits([joints[name] for name in full_names], full_map, full_offset)
        vars(self).update(
            document=document,
            semantics=semantics,
            sphere_set=sphere_set,
            name=document.name,
            urdf=document.text,
            joint_names=names,
            joint_units=tuple("m" if joint.type == "prismatic" else "rad" for joint in leading),
            full_map=read_only(full_map),
            full_offset=read_only(full_offset),
            dynamics_model=DynamicsModel(document, full_names, changed),
            n=len(names),
            is_coupled=len(full_names) != len(names),
            is_direct=len(full_names) == len(names) > 1,
            requirements=requirements,
            solvers=solvers,
            kept={},
            _frame_ids=frame_ids(document, order),
            _local=threading.local(),
            **{f"{what}_limits": read_only(values) for what, values in limits.items()},
        )

    def __repr__(self) -> str:
        return f"PepperModel({self.name!r}, n={self.n}, joints: {', '.join(self.joint_names)})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Rebuild from the document: Pinocchio's data are not pickled, but a changed model is."""
        return (PepperModel, self._parts())

    def _parts(self) -> tuple[Any, ...]:
        changed = self.dynamics_model.changed()
        return (self.document, self.semantics, self.sphere_set, changed, self.requirements, self.solvers)

    def with_parts(self, **parts: Any) -> PepperModel:
        """Return a robot with other parts, named as the arguments of this class; other parts are kept."""
        names = ("document", "semantics", "sphere_set", "changed", "requirements", "solvers")
        return PepperModel(**dict(zip(names, self._parts(), strict=True)) | parts)

    @property
    def pinocchio_model(self) -> Any:
        """A copy of the robot's `pinocchio.Model`, which the caller may change: see `with_pinocchio_model`.

        With mimic joints it has more coordinates than the robot: see `full_map`.
        """
        return self.inner_model.copy()

    @cached_property
    def inner_model(self) -> Any:
        """`pinocchio.Model` of the moving tree, built at its first use; it must not be changed."""
        return self.dynamics_model.get()

    @property
    def link_names(self) -> tuple[str, ...]:
        """Links, sensor frames included, in document order."""
        return self.document.links

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames: links and sensor frames."""
        return tuple(self._frame_ids)

    @property
    def visual_shapes(self) -> tuple[Shape, ...]:
        """Shapes to draw."""
        return self.document.visuals

    @property
    def collision_shapes(self) -> tuple[Shape, ...]:
        """Shapes that may not touch."""
        return self.document.collisions

    @cached_property
    def collision_spheres(self) -> tuple[Shape, ...]:
        """Spheres that contain the robot's links; empty for a robot without sphere set."""
        return () if self.sphere_set is None else self.sphere_set(self.document)

    @property
    def wheels(self) -> Wheels | None:
        """Limits of the base's wheels, if `load_robot` was given them; else None."""
        return self.document.wheels

    @property
    def posture_names(self) -> tuple[str, ...]:
        """Names of the postures, for `posture`."""
        return tuple(self.semantics.postures())

    @property
    def group_names(self) -> tuple[str, ...]:
        """Names of the joint groups, for `joint_group`."""
        return tuple(self.semantics.groups)

    @property
    def pinocchio_data(self) -> Any:
        """The `pinocchio.Data` of the calling thread, overwritten by every computation with it.

        Raises:
            ModelError: for more than 300 moving joints, whose data would take about a GB.
        """
        try:
            return self._local.data
        except AttributeError:
            self._local.data = working_memory(self.inner_model)
            return self._local.data

    @property
    def moving_center(self) -> NDArray[np.float64]:
        """View of the center of mass in `pinocchio_data`, shape (3,) [m]."""
        try:
            center: NDArray[np.float64] = self._local.center
        except AttributeError:
            center = self._local.center = self.pinocchio_data.com[0]
        return center

    def to_full(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates of `pinocchio_model`, E q + e, shape (..., n_full), of q, shape (..., n)."""
        return q @ self.full_map.T + self.full_offset if self.is_coupled else q

    def rate_to_full(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the velocities or accelerations of `pinocchio_model`, E v, shape (..., n_full)."""
        return v @ self.full_map.T if self.is_coupled else v

    def columns_from_full(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return J E, shape (k, n), of a matrix whose columns are the coordinates of `pinocchio_model`.

        Args:
            columns: J, shape (k, n_full), or (k,) where n_full is 1, as Pinocchio returns it then.
        """
        full = columns.reshape(-1, self.full_map.shape[0])
        return full @ self.full_map if self.is_coupled else full

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a link or sensor frame.

        Raises:
            UnknownNameError: listing all frames.
        """
        try:
            return self._frame_ids[name]
        except (KeyError, TypeError):
            raise UnknownNameError("frame", name, self.frame_names) from None

    def joints_above(self, frame: str) -> list[int]:
        """Return the indices of the joints that move a link or sensor frame, ascending.

        For a joint that follows another, the index is its leader's.

        Raises:
            UnknownNameError: listing all frames.
        """
        self.frame_id(frame)
        above = {joint.child: joint for joint in self.document.joints}
        named = {joint.name: joint for joint in self.document.joints}
        places = set()
        while (joint := above.get(frame)) is not None:
            frame = joint.parent
            while joint.mimic is not None:
                joint = named[joint.mimic[0]]
            if joint.type != "fixed":
                places.add(self.joint_index(joint.name))
        return sorted(places)

    def joint_index(self, name: str) -> int:
        """Return the index of a joint in every joint vector.

        Raises:
            UnknownNameError: listing all joints.
        """
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise UnknownNameError("joint", name, self.joint_names) from None

    def joint_group(self, name: str) -> tuple[str, ...]:
        """Return the names of a group's joints, in the order of the joint vector.

        Raises:
            UnknownNameError: listing all groups.
        """
        if name not in self.semantics.groups:
            raise UnknownNameError("joint group", name, self.group_names)
        members = set(self.semantics.groups[name])
        return tuple(joint for joint in self.joint_names if joint in members)

    def resolve_joints(
        self, joints: str | Iterable[str] | None, *, allow_none: bool = False
    ) -> tuple[str, ...]:
        """Return the names of joints that are given by joints and groups, in any mixture.

        All functions with an argument `joints` use this method.

        Args:
            joints: Name or list of names of joints and groups, such as `["right_arm", "HeadYaw"]`; a group
                stands for its joints in the order of the joint vector. None for all joints. A name of both a
                joint and a group means the joint.
            allow_none: Whether an empty result is allowed.

        Returns:
            The names in the order given, each once.

        Raises:
            UnknownNameError: for a name that is neither a joint nor a group, listing both.
            InvalidValueError: for anything but names, or for an empty result: the fingers of locked hands are
                groups without joints.
        """
        if joints is None:
            return self.joint_names
        allowed = 'joints and groups by name, such as ["right_arm", "HeadYaw"]: at least one moving joint'
        if not isinstance(joints, Iterable):
            raise InvalidValueError("joints", repr(joints), allowed)
        found: dict[str, None] = {}
        for name in [joints] if isinstance(joints, str) else joints:
            if name in self.joint_names:
                found[name] = None
            elif name in self.group_names:
                found.update(dict.fromkeys(self.joint_group(name)))
            else:
                raise UnknownNameError("joint or group", name, (*self.joint_names, *self.group_names))
        if not found and not allow_none:
            raise InvalidValueError("joints", repr(joints), allowed)
        return tuple(found)

    def posture(self, name: str) -> NDArray[np.float64]:
        """Return a named posture of the whole body, shape (n,) [rad or m].

        Postures are the states of the SRDF's group `whole_body`, or of all its groups if `whole_body` has
        none. Joints that the posture does not mention (a moving base) are at zero, or at the nearest limit.

        Raises:
            UnknownNameError: listing all postures.
        """
        postures = self.semantics.postures()
        if name not in postures:
            write = f"; write joint_vector({{{self.joint_names[0]!r}: 0.0, ...}}), or begin at neutral()"
            raise UnknownNameError("posture", name, postures, "" if postures else write)
        values = postures[name]
        q = np.array([values.get(joint, 0.0) for joint in self.joint_names])
        return np.clip(q, self.lower_limits, self.upper_limits)

    def neutral(self) -> NDArray[np.float64]:
        """Return Stand if the robot has it, else zero moved into the limits, shape (n,) [rad or m].

        It sets joints that a call does not name, as in `joint_vector`. A twin without a start posture begins
        there, so that commands made by `joint_vector` do not jump, and so does IK without a `start`.  In
        NAOqi's Stand Pepper's wrists are 3 mm from the pelvis: begin motions from `default_posture()`.
        """
        if "Stand" in self.posture_names:
            return self.posture("Stand")
        return np.clip(np.zeros(self.n), self.lower_limits, self.upper_limits)

    def default_posture(self) -> NDArray[np.float64]:
        """Return the posture in which viewers and demos begin, shape (n,) [rad or m].

        It is Ready, which is Stand with room around the wrists, if the robot has it, else `neutral()`.
        Viewers, the live page and the demo begin there.
        """
        return self.posture("Ready") if "Ready" in self.posture_names else self.neutral()

    def export(self, format: str, **options: Unpack[ExportOptions]) -> str:
        """Return the robot as the text of a "urdf", "srdf", "sdf" or "mjcf" file.

        See `pepper_kin.model.export` for the arguments and errors.
        """
        return export_formats.export(self, format, **options)

    def with_limits(
        self,
        *,
        lower: JointValues | None = None,
        upper: JointValues | None = None,
        velocity: JointValues | None = None,
        acceleration: JointValues | None = None,
        effort: JointValues | None = None,
    ) -> PepperModel:
        """Return a copy of the robot with other limits.

            careful = pepper.with_limits(velocity=0.5 * pepper.velocity_limits, upper={"HipPitch": 0.2})

        The new limits are written into the new model's URDF, so that all computations and exports use them;
        machine code made for the old model is not used. Named postures are moved into the new limits.

        Args:
            lower: Lower limits [rad or m]: one number for all joints, shape (n,), or a mapping from joints
                and groups to numbers, which keeps the limits of other joints. -inf, with an upper limit of
                inf, for no limits.
            upper: Upper limits [rad or m], in the forms of `lower`.
            velocity: Velocity limits [rad/s or m/s], in the forms of `lower`; inf for none.
            acceleration: Acceleration limits [rad/s^2 or m/s^2], in the forms of `lower`; inf for none.
            effort: Effort limits [N m or N], in the forms of `lower`; inf for none.

        Returns:
            A new model.

        Raises:
            UnknownNameError: for a joint or group that the robot lacks.
            InvalidValueError: naming joint and limit, for a lower limit above the upper one, a position limit
                widened beyond a turn, which is probably in degrees, another limit that is not above zero, a
                limit that a following joint does not allow, a wrong shape, or NaN.
            ModelError: after `with_pinocchio_model`, whose model the new one would lose.
        """
        changes = {"lower": lower, "upper": upper, "velocity": velocity}
        return changed_model.with_limits(self, {**changes, "acceleration": acceleration, "effort": effort})

    def with_requirements(self, requirements: MotionRequirements | str) -> PepperModel:
        """Return a copy of the robot whose motions keep other reserves.

            fast = pepper.with_requirements("limits")

        Inverse kinematics, plans, timing and live motion keep `requirements` unless an option such as
        `balance` says otherwise.

        Args:
            requirements: `MotionRequirements`, or a name: "limits" for no reserve; "reserve" for a balance of
                10 mm and 90 % of the torque, the default of robots whose wheels are known.

        Returns:
            A new model.

        Raises:
            UnknownNameError: for another name, listing the names.
            InvalidValueError: for another type.
        """
        return self.with_parts(requirements=as_requirements(requirements))

    def with_solvers(self, solvers: str) -> PepperModel:
        """Return a copy of the robot that uses this library's solvers or other libraries'.

            by_the_field = pepper.with_solvers("reference")

        "reference": Pinocchio computes dynamics and the twin, placo (proxsuite where it is not installed)
        inverse kinematics, coal every collision, toppra the timing; this library's machine code searches and
        compares. The argument `solver` of a call has priority.

        Args:
            solvers: "fast" or "reference".

        Returns:
            A new model.

        Raises:
            InvalidValueError: for another name.
        """
        return self.with_parts(solvers=check_choice("solvers", solvers, SOLVERS))

    def with_pinocchio_model(self, model: Any) -> PepperModel:
        """Return a copy of the robot with a changed `pinocchio.Model`.

            heavier = pepper.pinocchio_model
            heavier.inertias[4].mass += 0.3
            pepper = pepper.with_pinocchio_model(heavier)

        All computations use its masses, inertias, placements, rotors and gravity, in copies and other
        processes too. Its limits are not read: see `with_limits`.

        Args:
            model: A `pinocchio.Model` with the joints of `pinocchio_model`, in its order; it is copied.

        Returns:
            A new model.

        Raises:
            InvalidValueError: for another type, or other joints.
        """
        return changed_model.with_pinocchio_model(self, model)

    def with_masses(self, masses: Mapping[str, float]) -> PepperModel:
        """Return a copy of the robot with other masses of some links.

        A link's inertia about its center of mass scales with its mass; the center of mass is kept. The new
        model's URDF has the masses, as in `with_limits`. For objects in a hand, functions take `payload`.

        Args:
            masses: Link -> mass [kg], above zero.

        Returns:
            A new model.

        Raises:
            UnknownNameError: for an unknown link or one without mass, listing the links with mass.
            InvalidValueError: for a mass that is not above zero.
            ModelError: after `with_pinocchio_model`, whose model the new one would lose.
        """
        return changed_model.with_masses(self, masses)

    def joint_vector(
        self,
        values: Mapping[str, ArrayLike] | Sequence[float] | NDArray[np.float64],
        *,
        rest: str | ArrayLike | None = None,
        check_limits: bool = False,
    ) -> NDArray[np.float64]:
        """Return a joint vector with some joints set and the others from Stand, or with all set, shape (n,).

        Args:
            values: Joint name -> position [rad or m], or group name -> positions of its joints in the order
                of `joint_group`; or all n positions in the order of `joint_names`.
            rest: Positions of joints that `values` does not name: a posture's name, or n positions [rad or
                m]; `neutral()` if omitted.
            check_limits: Whether positions outside the joint limits are refused.

        Returns:
            A new array.

        Raises:
            UnknownNameError: for a joint, group or posture that the robot lacks.
            InvalidValueError: for a value that is not a finite number, a wrong number of values, or a joint
                that is named twice.
            LimitError: with `check_limits`, naming the joint that is farthest outside.
        """
        if isinstance(values, Mapping):
            q = self.posture(rest) if isinstance(rest, str) else self._rest(rest)
            for place, value in self._named(values).items():
                q[place] = value
        else:
            q = as_finite(values, "joint vector", (self.n,)).copy()
        if check_limits:
            check_within_limits(self, q, "joint vector")
        return q

    def _rest(self, rest: ArrayLike | None) -> NDArray[np.float64]:
        """Return joint positions [rad or m], shape (n,), as a new array; the neutral ones for None."""
        return self.neutral() if rest is None else as_finite(rest, "rest", (self.n,)).copy()

    def _named(self, values: Mapping[str, ArrayLike]) -> dict[int, float]:
        """Return index -> position [rad or m] of joints that are given by joint and group names.

        Args:
            values: Joint -> position [rad or m], or group -> positions of its k joints, shape (k,).

        Raises:
            UnknownNameError: for a name that is neither a joint nor a group.
            InvalidValueError: for a wrong shape, NaN or infinity, or a joint with two values.
        """
        found: dict[int, float] = {}
        for name, value in values.items():
            joints = self.resolve_joints(name)
            single = name in self.joint_names
            numbers = as_finite(value, f"position of {name}", () if single else (len(joints),))
            for joint, number in zip(joints, numbers.reshape(-1).tolist(), strict=True):
                place = self.joint_index(joint)
                if place in found:
                    raise InvalidValueError(f"position of {joint}", "two values", "each joint once")
                question = suspect_degrees(number, self.joint_units[place])
                if question and not self.lower_limits[place] <= number <= self.upper_limits[place]:
                    raise InvalidValueError(f"position of {joint}", f"{number:.6g} rad", f"radians{question}")
                found[place] = number
        return found
