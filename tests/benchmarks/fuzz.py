"""Ten million hostile bytes: `python -m tests.benchmarks.fuzz [--bytes N]` prints a table.

Half of them for an ArduCopter, half for a PX4. A vehicle in the air gets noise, broken frames,
unknown messages and messages for others; one on the ground gets besides these messages of every
type with the worst values. The exit status is 1 when anything raised or changed, or memory grew by
more than a megabyte.
"""

from __future__ import annotations

import itertools
import math
import sys

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.vehicle import SimVehicle, VehicleSpec
from sitl.world.world import World, WorldSpec
from tests.benchmarks.frame import asked, head, row
from tests.support.hostile import bombard

_HOME = LatLon(48.0, 11.0)
_ALLOWED_GROWTH = 1_000_000


_TAKE_OFF = {
    "ardupilot": (
        (mav.MAV_CMD_DO_SET_MODE, 1, 4, 0, 0, 0, 0, 0),
        (mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0, 0, 0, 0, 0, 0),
        (mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 12),
    ),
    "px4": (
        (mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0, 0, 0, 0, 0, 0),
        (mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, 512),
    ),
}


def _vehicle(autopilot: str, *, airborne: bool) -> SimVehicle:
    spec = VehicleSpec(1, _HOME, gps_sigma_m=0.0, battery_wh=1e6, autopilot=autopilot)
    vehicle = SimVehicle(spec, World(WorldSpec(_HOME, 500.0, ())))
    vehicle.step(6.0)
    link = mav.MAVLink(None, 255, 190)
    if airborne:
        for command, *p in _TAKE_OFF[autopilot]:
            vehicle.receive(mav.MAVLink_command_long_message(1, 1, command, 0, *p).pack(link))
        vehicle.step(20.0)
        assert vehicle.truth.height_m > 5.0
    return vehicle


def main() -> int:
    """Run and print; the exit status."""
    size = asked(__doc__, bytes=10_000_000).bytes
    bad = False
    print(head("", "bytes", "seconds", "MB/s", "crashes", "changes", "grown kB"))
    for autopilot, airborne in itertools.product(_TAKE_OFF, (True, False)):
        vehicle = _vehicle(autopilot, airborne=airborne)
        outcome = bombard(vehicle, size // 4, seed=11, well_addressed=not airborne)
        sent, grown = sum(outcome.sent.values()), outcome.grown_bytes
        print(
            row(
                f"{autopilot}, {'flying' if airborne else 'on the ground'}", f"{sent:,d}",
                f"{outcome.seconds:.1f}", f"{sent / outcome.seconds / 1e6:.2f}",
                len(outcome.crashes), len(outcome.changes), f"{grown / 1e3:.1f}",
            )
        )  # fmt: skip
        kinds = (f"{kind}: {count:,d}" for kind, count in sorted(outcome.sent.items()))
        print(*outcome.crashes, *outcome.changes, *kinds, sep="\n  ")
        bad |= bool(outcome.crashes or outcome.changes) or grown > _ALLOWED_GROWTH
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
