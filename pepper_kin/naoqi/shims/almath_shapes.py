"""Parts of `almath` beside geometry: maps of cells, and shapes with their visitors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pepper_kin.naoqi.shims.almath_types import Numbers, Pose2D, Position2D


def roundToInt(value: float) -> int:
    """Return the nearest whole number; halves go away from 0."""
    return int(value + 0.5) if value >= 0.0 else int(value - 0.5)


@dataclass
class Point2Di:
    """A cell of a map."""

    x: int = 0
    y: int = 0


@dataclass
class Pose2Di(Point2Di):
    """A cell of a map, and an angle [rad]; of x, y and the angle, or of a `Point2Di` and the angle."""

    theta: float = 0.0

    def __init__(self, *values: Any) -> None:
        if values and isinstance(values[0], Point2Di):
            values = (values[0].x, values[0].y, *values[1:])
        super().__init__(*values[:2])
        self.theta = values[2] if len(values) > 2 else 0.0


class OccupancyMapParams:
    """Where the cells of a square map are: columns go along x, rows against y.

    Args:
        size: Cells of a side.
        metersPerPixel: Of a cell [m].
        mapCenter: Where its middle is [m].
        obstacleThreshold: From which value on a cell is taken.
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
        """Place the middle of the map [m]."""
        half = 0.5 * self.size * self.metersPerPixel
        self.originOffset = mapCenter + Position2D(-half, half)

    @staticmethod
    def getPixelFromOffsetAndScale(
        place: Numbers, metersPerPixel: float, originOffset: Position2D
    ) -> Point2Di:
        """Return the cell of a pose or position, of a map with its first cell at an offset [m]."""
        x, y = (place.values[:2] - originOffset.values) / metersPerPixel
        return Point2Di(roundToInt(x), roundToInt(-y))

    def getPixelFromPose(self, place: Numbers) -> Point2Di:
        """Return the cell of a pose or position."""
        return self.getPixelFromOffsetAndScale(place, self.metersPerPixel, self.originOffset)

    getPixelFromPosition = getPixelFromPose

    def getDeltaPixelFromDeltaPosition(self, way: Position2D) -> Point2Di:
        """Return how many cells a way [m] leads on."""
        return self.getPixelFromOffsetAndScale(way, self.metersPerPixel, Position2D())

    def getPositionFromPixel(self, pixel: Point2Di) -> Position2D:
        """Return where a cell is [m]."""
        return self.originOffset + Position2D(pixel.x, -pixel.y) * self.metersPerPixel

    def getPoseFromPixel(self, pixel: Pose2Di) -> Pose2D:
        """Return where a cell with an angle is."""
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
        """Show itself to a visitor."""
        visitor.visit(self)


class Shape3DVisitor:
    """What shapes show themselves to; derived classes have `visit`."""


class NotImplementedShape3DVisitor(Shape3DVisitor):
    """A visitor of no shape."""

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
