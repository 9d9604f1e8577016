"""The page as one text; it fetches nothing else, and opens only the web socket."""

from __future__ import annotations

import html

from pepper_kin.viewer.page_template import filled_page

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


def page_text(title: str, nonce: str) -> str:
    """Return the text of the page.

    Args:
        title: Title of the page.
        nonce: Nonce of the page's own scripts, so that no other script may run.
    """
    return filled_page("live", _SCRIPTS, title=html.escape(title), nonce=html.escape(nonce))


def content_policy(nonce: str, host: str) -> str:
    """Return the policy that allows the page only its own scripts and its own server."""
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
