"""The TAK link of a flight, on the side of the flight, which never waits for it."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Iterator
from typing import Final

from missions.errors import UavmapError
from uavmap.base.extras import install_command
from uavmap.ui.page.feed import Feed
from uavmap.ui.page.live_board import log_reports

UPDATE_S: Final = 0.5
"""Minimum time between two messages to the process of the link, real s."""
AIRCRAFT_S: Final = 1.0
"""Minimum time between two events of an aircraft, real s."""
SHAPES_S: Final = 5.0
"""Minimum time between two events of an area, a track or a path, real s."""


@contextlib.contextmanager
def open_tak_link(
    url: str, *, simulated: bool, aircraft_s: float = AIRCRAFT_S, shapes_s: float = SHAPES_S
) -> Iterator[Feed]:
    """Send to a TAK server in the context, even if it does not answer.

    Raises `UavmapError` without pytak, for a wrong URL, and for unusable certificates.
    """
    if importlib.util.find_spec("pytak") is None:
        raise UavmapError(f"--tak needs pytak: {install_command('tak')}")
    config = {
        "url": url, "simulated": simulated, "aircraft_s": aircraft_s, "shapes_s": shapes_s,
    }  # fmt: skip
    feed = Feed("uavmap.ui.tak.tak_child", "the TAK link", config)
    try:
        feed.wait_ready()
        yield feed
    finally:
        log_reports(feed.close())
