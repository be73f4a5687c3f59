"""The first answer of a vehicle: whether anybody is there, and whether it is one that is flown."""

from __future__ import annotations

from typing import Final

from missions.errors import LinkError
from uavmap.mavlink.autopilots import AUTOPILOTS
from uavmap.mavlink.session import Session

ANSWER_S: Final = 10.0


async def answered(session: Session, name: str) -> None:
    """Wait for the heartbeat of an autopilot that this version flies. Raises `LinkError`."""
    view = session.view
    wait_s = max(ANSWER_S, 4.0 * session.ack_wait_s)  # longer where time runs faster
    if not await session.until(lambda: view.autopilot is not None, wait_s):
        raise LinkError(
            f"{name}: no vehicle answered within {wait_s:g} s; is it switched on, and is this "
            "the URL that it speaks to?"
        )
    if view.autopilot not in AUTOPILOTS:
        flown = " and ".join(kind.name for kind in AUTOPILOTS.values())
        raise LinkError(
            f"{name}: the autopilot is none that this version can fly "
            f"(MAV_AUTOPILOT {view.autopilot}); it flies {flown} copters"
        )
