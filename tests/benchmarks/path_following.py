"""Deviation of a simulated vehicle from a path without stops, beside real ones.

    python -m tests.benchmarks.path_following                     all, about two minutes
    python -m tests.benchmarks.path_following --autopilot px4 --speed 6

The path is the one on which a real ArduCopter 4.6 was measured in its own simulator, 404 m long. It
has five lanes of 60 m, 12 m apart, with square U-turns, and a zigzag of corners of 90 and 45
degrees 4 m apart, all cut by 2.5 m. The whole driver flies it over MAVLink: `FlyPath` from a hover
to a hover. `error` is the distance between the true and the planned position at each time, from
beginning to end. `beside` is the distance to the nearest point of the plan. The flown time ends
when the vehicle stands within half a metre of the end.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import sys
from dataclasses import dataclass, field
from statistics import fmean as mean

from missions.events import Airborne, Arrived, OrderFailed
from missions.geo.trajectory import Trajectory, rounded_path
from missions.mission.schema import Mission
from missions.orders import FlyPath, TakeOff
from missions.units import GridPoint
from tests.benchmarks.frame import head, options_of, row
from tests.support.flights import Flight, fly
from tests.support.small_missions import mission, square

HEIGHT_M = 12.0
NOTICE_S = 2.0
STANDS_M, STANDS_M_S = 0.5, 0.3
MEASURED = {
    ("ardupilot", 3.0, 0.0): "tilt 6",
    ("ardupilot", 6.0, 0.0): "0.18 / 0.54, time + 0.2 %, at most 0.8; tilt 15",
    ("ardupilot", 6.0, 3.6): "- / 0.60; tilt 26",
    ("ardupilot", 8.0, 0.0): "tilt 22",
    ("ardupilot", 10.0, 0.0): "- / 0.94; tilt 29.5",
    ("px4", 6.0, 0.0): "beside 0.6 in the legs, at most 3.0 at raw corners",
}
"""By autopilot, speed and wind, m/s: error of the real one, mean / 95 %, m."""


def path(cut_m: float = 2.5, **how: float) -> Trajectory:
    """Return the path of the measurement; `how` as for `rounded_path`."""
    points = [GridPoint(0.0, 0.0)]
    for lane in range(5):
        east_m = 60.0 if lane % 2 == 0 else 0.0
        points.append(GridPoint(east_m, 12.0 * lane))
        points.append(GridPoint(east_m, 12.0 * min(lane + 1, 4)))
    (east_m, north_m), heading = points[-1], math.pi / 2
    for turn_deg in (-90.0, 90.0, -90.0, 90.0, -45.0, 45.0, -45.0, 45.0):
        heading += math.radians(turn_deg)
        east_m, north_m = east_m + 4.0 * math.cos(heading), north_m + 4.0 * math.sin(heading)
        points.append(GridPoint(east_m, north_m))
    return rounded_path(points, cut_m=cut_m, **how)  # type: ignore[arg-type]


@dataclass(slots=True)
class Followed:
    """Deviation from a path: distances, m; times, s; tilts, degrees."""

    errors_m: list[float] = field(default_factory=list)
    beside_m: list[float] = field(default_factory=list)
    tilts_deg: list[float] = field(default_factory=list)
    planned_s: float = math.nan
    flown_s: float = math.inf
    failed: bool = False

    @property
    def delay_share(self) -> float:
        """Return the share by which the flight took longer than planned."""
        return self.flown_s / self.planned_s - 1.0


def quantile_95(values: list[float]) -> float:
    """Return the value that 95 % of values do not exceed."""
    return sorted(values)[int(0.95 * len(values))]


def meadow(autopilot: str, wind_m_s: float, gps_sigma_m: float = 0.0) -> Mission:
    made = mission(
        square(-4, 0, 40, 40), square(-60, -60, 260, 260), wind_m_s=wind_m_s, speed_m_s=6.0
    )
    sim = made.sim.model_copy(update={"autopilot": autopilot, "gps_sigma_m": gps_sigma_m})
    return made.model_copy(update={"sim": sim})


def followed(autopilot: str, speed_m_s: float, wind_m_s: float = 0.0) -> Followed:
    found = Followed()

    async def body(flight: Flight) -> None:
        await flight.after(TakeOff(HEIGHT_M), Airborne)
        boot_s = await _boot_s(flight)
        plan = path(begin_s=flight.now_s() + NOTICE_S, speed_m_s=speed_m_s)
        dense = [plan.at(plan.begin_s + 0.05 * i).place for i in range(round(20 * _length_s(plan)))]
        flight.driver.give(FlyPath(plan, HEIGHT_M, 0.0, 2.0))
        end = plan.at(plan.end_s).place
        found.planned_s = _length_s(plan)
        while math.isinf(found.flown_s) and flight.now_s() < plan.end_s + 20.0:
            await asyncio.sleep(0.05)
            truth = flight.vehicle.truth
            now_s = boot_s + truth.t_s
            here = flight.setting.grid.fixed(truth.position)
            if plan.begin_s <= now_s < plan.end_s:
                found.errors_m.append(here.distance_to(plan.at(now_s).place))
                step = round(20 * (now_s - plan.begin_s))
                near = dense[max(step - 40, 0) : step + 40]
                found.beside_m.append(min(here.distance_to(place) for place in near))
                found.tilts_deg.append(math.degrees(math.hypot(truth.roll_rad, truth.pitch_rad)))
            stands = math.hypot(*truth.velocity_m_s[:2]) < STANDS_M_S
            if now_s > plan.end_s - 3.0 and stands and here.distance_to(end) < STANDS_M:
                found.flown_s = now_s - plan.begin_s
        await flight.sees(Arrived, within_s=20.0)

    found.failed = bool(fly(body, meadow(autopilot, wind_m_s)).seen(OrderFailed))
    return found


async def _boot_s(flight: Flight) -> float:
    """Return mission time minus the vehicle's: the truth is that of its last step."""
    found = math.inf
    for _ in range(20):
        await asyncio.sleep(0.005)
        found = min(found, flight.now_s() - flight.vehicle.t_s)
    return found


def _length_s(plan: Trajectory) -> float:
    return plan.end_s - plan.begin_s


def main() -> int:
    options = options_of(__doc__, autopilot=("ardupilot", "px4"), speed=(3.0, 6.0, 8.0, 10.0))
    columns = ("error m, mean / 95 %", "beside m", "tilt deg, 95 %", "planned s", "flown")
    print(head("autopilot", "speed, wind m/s", *columns, "measured"))
    failed = False
    for autopilot, speed_m_s in itertools.product(options.autopilot, options.speed):
        for wind_m_s in (0.0, 3.6) if speed_m_s == 6.0 else (0.0,):
            f = followed(autopilot, speed_m_s, wind_m_s)
            failed |= f.failed
            errors = (f"{mean(m):.2f} / {quantile_95(m):.2f}" for m in (f.errors_m, f.beside_m))
            late = f"{100.0 * f.delay_share:+.1f} %{' FAILED' * f.failed}"
            measured = MEASURED.get((autopilot, speed_m_s, wind_m_s), "-")
            tilt = f"{quantile_95(f.tilts_deg):.0f}"
            where = f"{speed_m_s:g}, {wind_m_s:g}"
            print(
                row(autopilot, where, *errors, tilt, f"{f.planned_s:.1f}", late, measured),
                flush=True,
            )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
