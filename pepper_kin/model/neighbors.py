"""Neighboring links, which overlap at their joint and are never checked for collision."""

from __future__ import annotations

from pepper_kin.exceptions import ModelError
from pepper_kin.model.urdf_document import UrdfDocument

REASON = "Adjacent"
MOST_PAIRS = 2_000_000
"""Maximum number of pairs."""


def neighboring_pairs(document: UrdfDocument) -> dict[tuple[str, str], str]:
    """Return the pairs of links that one moving joint connects, names sorted -> reason.

    Links connected by fixed joints are one body. Bodies without any shape, such as the middle of a universal
    joint, are skipped: their children are neighbors of their parent.

    Raises:
        ModelError: for more than MOST_PAIRS pairs.
    """
    above = {joint.child: joint for joint in document.joints}
    shaped = {shape.link for shape in (*document.visuals, *document.collisions)}
    root_of: dict[str, str] = {}
    for link in document.links:
        chain = [link]  # up to a known or moving link, so that each link is visited once
        while chain[-1] not in root_of and chain[-1] in above and above[chain[-1]].type == "fixed":
            chain.append(above[chain[-1]].parent)
        root = root_of.get(chain[-1], chain[-1])
        root_of.update(dict.fromkeys(chain, root))
    members: dict[str, list[str]] = {}
    for link in document.links:
        if link in shaped:
            members.setdefault(root_of[link], []).append(link)
    pairs: dict[tuple[str, str], str] = {}
    for root, links in members.items():
        body = root
        while body in above:
            body = root_of[above[body].parent]
            if body in members:
                if len(pairs) + len(links) * len(members[body]) > MOST_PAIRS:
                    raise ModelError(f"URDF: more than {MOST_PAIRS} pairs of shaped links are neighbors")
                pairs.update({(min(a, b), max(a, b)): REASON for a in links for b in members[body]})
                break
    return pairs
