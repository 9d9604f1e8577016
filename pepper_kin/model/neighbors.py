"""Neighboring links, which overlap at the joint between them and are never checked."""

from __future__ import annotations

from pepper_kin.model.urdf_document import UrdfDocument

REASON = "Adjacent"


def neighboring_pairs(document: UrdfDocument) -> dict[tuple[str, str], str]:
    """Return the pairs of links that are one moving joint apart, each sorted, with the reason.

    Links that fixed joints hold together are one body.  Bodies without any shape (the middle of a universal
    joint, say) are not counted: what hangs on them is the neighbor of what carries them.
    """
    above = {joint.child: joint for joint in document.joints}
    shaped = {shape.link for shape in (*document.visuals, *document.collisions)}
    root_of: dict[str, str] = {}
    for link in document.links:
        root = link
        while root in above and above[root].type == "fixed":
            root = above[root].parent
        root_of[link] = root
    members: dict[str, list[str]] = {}
    for link in document.links:
        if link in shaped:
            members.setdefault(root_of[link], []).append(link)
    pairs = {}
    for root, links in members.items():
        body = root
        while body in above:
            body = root_of[above[body].parent]
            if body in members:
                pairs.update({(min(a, b), max(a, b)): REASON for a in links for b in members[body]})
                break
    return pairs
