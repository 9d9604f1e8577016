"""The page as one text: nothing else is fetched but the web socket."""

from __future__ import annotations

import html
from functools import lru_cache
from importlib.resources import files

from pepper_kin.viewer.drawing import meshcat_bundle

_SCRIPTS = (
    "stage.js",
    "live_link.js",
    "live_quality.js",
    "live_cutout.js",
    "live_sketch.js",
    "live_scene.js",
    "live_drag.js",
    "axes.js",
    "live_controls.js",
    "live_things.js",
    "live_motion.js",
    "live_plots.js",
    "live.js",
)


@lru_cache(maxsize=1)
def _parts() -> dict[str, str]:
    folder = files("pepper_kin.viewer") / "page"
    bundle = meshcat_bundle()
    return {
        "template": (folder / "live.html").read_text(encoding="utf-8"),
        "style": (folder / "live.css").read_text(encoding="utf-8"),
        "meshcat": bundle.replace("</script", "<\\/script").replace("<!--", "<\\!--"),
        "scripts": "\n".join((folder / name).read_text(encoding="utf-8") for name in _SCRIPTS),
    }


def page_text(title: str, nonce: str) -> str:
    """Return the page.

    Args:
        title: Its title.
        nonce: What marks its own scripts, so that no other may run.
    """
    parts = {**_parts(), "title": html.escape(title), "nonce": html.escape(nonce)}
    split = parts["template"].split("{{")
    filled = [split[0]]
    for part in split[1:]:
        name, rest = part.split("}}", 1)
        filled += [parts[name], rest]
    return "".join(filled)


def content_policy(nonce: str, host: str) -> str:
    """Return the header that lets the page run its own scripts and talk to its own server, nothing else."""
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src 'nonce-{nonce}'",
            "style-src 'unsafe-inline'",
            "img-src data: blob:",
            f"connect-src 'self' ws://{host}",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'self' http://localhost:* http://127.0.0.1:* vscode-webview:",
        )
    )
