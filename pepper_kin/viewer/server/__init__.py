"""The live page: a server with the state, and pages that show and change it.

    serve                                     serves until Ctrl-C, for `pepper-kin view`
    ViewerServer, Access, DEFAULT_PORT        the server in a thread, and its rules of access

Only this machine can connect, unless `Access` allows others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.servers.access import Access
    from pepper_kin.viewer.server.server import DEFAULT_PORT, ViewerServer
    from pepper_kin.viewer.server.serving import serve

__all__ = ["DEFAULT_PORT", "Access", "ViewerServer", "serve"]

__getattr__, __dir__ = lazily(__name__)
