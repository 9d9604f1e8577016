"""Maps of cells, and shapes with their visitors, of `almath`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pepper_kin.naoqi.shims.almath_types import Numbers, Pose2D, Position2D


def roundToInt(value: float) -> int:
    """Round to the nearest integer; halves are rounded away from 0."""
    return int(value + 0.5) if value >= 0.0 else int(value - 0.5)


@dataclass
class Point2Di:
    """A cell of a map."""

    x: int = 0
    y: int = 0


@dataclass
class Pose2Di(Point2Di):
    """A cell of a map and an angle [rad], built from x, y or a `Point2Di`, and the angle."""

    theta: float = 0.0

    def __init__(self, *values: Any) -> None:
        if values and isinstance(values[0], Point2Di):
            values = (values[0].x, values[0].y, *values[1:])
        super().__init__(*values[:2])
        self.theta = values[2] if len(values) > 2 else 0.0


class OccupancyMapParams:
    """Geometry of a square map: columns increase along x, rows along -y.

    Args:
        size: Number of cells along a side.
        metersPerPixel: Side of a cell [m].
        mapCenter: Position of the map's center [m].
        obstacleThreshold: Probability from which a cell counts as occupied.
    """

    def __init__(
        self, size: int, metersPerPixel: float, mapCenter: Position2D, obstacleThreshold: float = 0.25
    ):
        self.size, self.metersPerPixel, self.obstacleProbabilityThreshold = (
            size,
            metersPerPixel,
            obstacleThreshold,
        )
        self.initOriginOffset(mapCenter)

    def initOriginOffset(self, mapCenter: Position2D) -> None:
        """Set the position of the map's center [m]."""
        half = 0.5 * self.size * self.metersPerPixel
        self.originOffset = mapCenter + Position2D(-half, half)

    @staticmethod
    def getPixelFromOffsetAndScale(
        place: Numbers, metersPerPixel: float, originOffset: Position2D
    ) -> Point2Di:
        """Return the cell of a pose or position in a map whose first cell is at an offset [m]."""
        x, y = (place.values[:2] - originOffset.values) / metersPerPixel
        return Point2Di(roundToInt(x), roundToInt(-y))

    def getPixelFromPose(self, place: Numbers) -> Point2Di:
        """Return the cell of a pose or position."""
        return self.getPixelFromOffsetAndScale(place, self.metersPerPixel, self.originOffset)

    getPixelFromPosition = getPixelFromPose

    def getDeltaPixelFromDeltaPosition(self, way: Position2D) -> Point2Di:
        """Return the number of cells of a displacement [m]."""
        return self.getPixelFromOffsetAndScale(way, self.metersPerPixel, Position2D())

    def getPositionFromPixel(self, pixel: Point2Di) -> Position2D:
        """Return the position of a cell [m]."""
        return self.originOffset + Position2D(pixel.x, -pixel.y) * self.metersPerPixel

    def getPoseFromPixel(self, pixel: Pose2Di) -> Pose2D:
        """Return the pose of a cell with an angle."""
        return Pose2D([*self.getPositionFromPixel(pixel), pixel.theta])

    def getObstacleProbabilityThreshold(self) -> float:
        return self.obstacleProbabilityThreshold


class Shape3D:
    """A shape, with getters of its sizes [m]."""

    sizes: ClassVar[tuple[str, ...]] = ()

    def __init__(self, *sizes: float) -> None:
        for name, size in zip(self.sizes, sizes, strict=True):
            setattr(self, f"get{name}", lambda size=float(size): size)

    def accept(self, visitor: Any) -> None:
        """Call the visitor's `visit` with this shape."""
        visitor.visit(self)


class Shape3DVisitor:
    """Base class of visitors of shapes; derived classes have `visit`."""


class NotImplementedShape3DVisitor(Shape3DVisitor):
    """A visitor that raises RuntimeError for every shape."""

    def __init__(self, msg: str = "not implemented") -> None:
        self.message = msg

    def visit(self, _shape: Shape3D) -> None:
        raise RuntimeError(self.message)


def _shape(name: str, doc: str, *sizes: str) -> type[Shape3D]:
    return type(name, (Shape3D,), {"sizes": sizes, "__doc__": doc, "__module__": __name__})


Sphere = _shape("Sphere", "A sphere.", "Radius")
Pill = _shape("Pill", "A capsule along z.", "HalfExtent", "Radius")
Rectangle = _shape("Rectangle", "A rectangle at z = 0.", "HalfExtentX", "HalfExtentY")
RoundedRectangle = _shape("RoundedRectangle", "What is near to one.", "HalfExtentX", "HalfExtentY", "Radius")
Plane, HalfSpace = _shape("Plane", "z = 0."), _shape("HalfSpace", "z <= 0.")
HalfLine = _shape("HalfLine", "z >= 0 on the axis.")
