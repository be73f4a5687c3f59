"""Ten million hostile bytes: `python -m tests.benchmarks.fuzz [BYTES]` prints a table.

Half of them for an ArduCopter, half for a PX4. A vehicle in the air gets noise, broken frames,
unknown messages and messages for others; one on the ground gets besides these messages of every
type with the worst values. The exit status is 1 when anything raised or changed, or memory grew by
more than a megabyte.

`python -m tests.benchmarks.fuzz --picture FILE [COUNT]`: copies of a photograph with damage, for
the reader of recorded pictures; the exit status is 1 when one raised anything but its own refusal.
"""

from __future__ import annotations

import itertools
import math
import sys
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.vehicle import SimVehicle, VehicleSpec
from sitl.world.world import World, WorldSpec
from tests.benchmarks.photos.replay import fuzz_pictures
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


def main(size: int) -> int:
    """Run and print; the exit status."""
    bad = False
    print(
        f"{'':24}{'bytes':>12}{'seconds':>9}{'MB/s':>7}{'crashes':>9}{'changes':>9}{'grown kB':>10}"
    )
    for autopilot, airborne in itertools.product(_TAKE_OFF, (True, False)):
        name = f"{autopilot}, {'flying' if airborne else 'on the ground'}"
        vehicle = _vehicle(autopilot, airborne=airborne)
        outcome = bombard(vehicle, size // 4, seed=11, well_addressed=not airborne)
        sent = sum(outcome.sent.values())
        print(
            f"{name:24}{sent:12,d}{outcome.seconds:9.1f}{sent / outcome.seconds / 1e6:7.2f}"
            f"{len(outcome.crashes):9d}{len(outcome.changes):9d}{outcome.grown_bytes / 1e3:10.1f}"
        )
        for line in (*outcome.crashes, *outcome.changes):
            print(f"  {line}")
        for kind, count in sorted(outcome.sent.items()):
            print(f"  {kind:22}{count:12,d}")
        grown = outcome.grown_bytes > _ALLOWED_GROWTH
        bad |= bool(outcome.crashes or outcome.changes) or grown
    return int(bad)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--picture"]:
        fuzz_pictures(Path(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 1000)
        sys.exit(0)
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000))
