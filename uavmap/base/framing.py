"""The page that may show a page of this program within it: that of `uavmap app`, else none."""

from __future__ import annotations

import os
from typing import Final

SHOWN_IN: Final = "UAVMAP_SHOWN_IN"
"""Variable of the environment: the origin of the page that has begun a command."""


def frame_ancestors() -> str:
    """Return the source list of `frame-ancestors` for a content security policy."""
    return os.environ.get(SHOWN_IN) or "'none'"
