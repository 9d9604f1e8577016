"""The order in which Pinocchio counts the joints and frames of a URDF."""

from __future__ import annotations

from pepper_kin.model.urdf_document import Joint, UrdfDocument


def depth_first(document: UrdfDocument) -> tuple[Joint, ...]:
    """Return all joints, parents before children, those of one link by name."""
    below: dict[str, list[Joint]] = {}
    for joint in sorted(document.joints, key=lambda joint: joint.name, reverse=True):
        below.setdefault(joint.parent, []).append(joint)
    waiting, order = list(below.get(document.root, ())), []
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += below.get(joint.child, ())
    return tuple(order)


def frame_ids(document: UrdfDocument, order: tuple[Joint, ...]) -> dict[str, int]:
    """Return the number of each link's frame, by link in document order.

    Frame 0 is the universe, 1 the root link; each joint then adds its frame and that of its child.

    Args:
        document: The robot.
        order: Its joints, as `depth_first` returns them.
    """
    found = {document.root: 1} | {joint.child: 2 * place + 3 for place, joint in enumerate(order)}
    return {link: found[link] for link in document.links}
