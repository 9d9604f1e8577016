"""The live page: a server that holds the state, and pages that show and change it."""

from pepper_kin.viewer.server.access import Access
from pepper_kin.viewer.server.serve import serve
from pepper_kin.viewer.server.server import DEFAULT_PORT, ViewerServer

__all__ = ["DEFAULT_PORT", "Access", "ViewerServer", "serve"]
