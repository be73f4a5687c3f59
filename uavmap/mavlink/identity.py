"""The identity of the vehicle on a link: it answers, is supported, and is not on another link."""

from __future__ import annotations

from typing import Final

from missions.errors import LinkError
from uavmap.mavlink.autopilots import AUTOPILOTS
from uavmap.mavlink.continuity import distance_m
from uavmap.mavlink.session import Session
from uavmap.mavlink.vehicle_view import VehicleView

ANSWER_S: Final = 10.0


async def wait_for_autopilot(session: Session, name: str) -> None:
    """Wait for the heartbeat of an autopilot that this version flies. Raises `LinkError`."""
    view = session.view
    wait_s = max(ANSWER_S, 4.0 * session.ack_wait_s)  # longer where time runs faster
    if not await session.until(lambda: view.autopilot is not None, wait_s):
        raise LinkError(f"{name}: no vehicle answered within {wait_s:g} s; {_silence_reason(view)}")
    if view.autopilot not in AUTOPILOTS:
        flown = " and ".join(kind.name for kind in AUTOPILOTS.values())
        raise LinkError(
            f"{name}: the autopilot is none that this version can fly "
            f"(MAV_AUTOPILOT {view.autopilot}); it flies {flown} copters"
        )


def _silence_reason(view: VehicleView) -> str:
    refused = [(n, why) for (kind, why), n in view.gate.refused.items() if kind == "frames"]
    if not refused:
        return "is it switched on, and is this the URL that it sends to?"
    _, why = max(refused)
    return (
        f"{sum(n for n, _ in refused)} frames were refused for their signature ({why}); give the "
        "vehicle's key with --key, or install this one: uavmap keys install"
    )


SAME_PLACE_M: Final = 0.5
SAME_BOOT_S: Final = 0.2


def same_aircraft(view_a: VehicleView, view_b: VehicleView) -> bool:
    """Return whether two views, on one loop's clock, are of the same aircraft.

    Both have its system and component id. Beyond that its hardware number decides, if both report
    one, else the same place and time of start.
    """
    addresses = [(view.system_id, view.autopilot_component) for view in (view_a, view_b)]
    if addresses[0] != addresses[1] or view_a.system_id == 0:
        return False
    if view_a.uid and view_b.uid:
        return view_a.uid == view_b.uid
    boots_s = view_a.boot_offset_s, view_b.boot_offset_s
    if view_a.position is None or view_b.position is None or None in boots_s:
        return False
    apart_s = abs((boots_s[0] or 0.0) - (boots_s[1] or 0.0))
    return distance_m(view_a.position, view_b.position) <= SAME_PLACE_M and apart_s <= SAME_BOOT_S
