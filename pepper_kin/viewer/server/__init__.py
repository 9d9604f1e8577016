"""The live page: a server that holds the state, and pages that show and change it.

    serve                                     blocks until Ctrl-C: what `pepper-kin view` runs
    ViewerServer, Access, DEFAULT_PORT        the server in a thread, and who may reach it

Only this machine reaches it, unless `Access` says otherwise.
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
