"""Whether two links lead to one aircraft: a router that forwards several vehicles may do that."""

from __future__ import annotations

from typing import Final

from uavmap.mavlink.continuity import distance_m
from uavmap.mavlink.vehicle_view import VehicleView

SAME_PLACE_M: Final = 0.5
SAME_BOOT_S: Final = 0.2


def same_aircraft(view_a: VehicleView, view_b: VehicleView) -> bool:
    """Whether two views, on one loop's clock, are of the same aircraft.

    It answers to the same system and component id over both. Beyond that its hardware's number
    decides, where both told one; else that it stands in the same place and started at the same
    time.
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
