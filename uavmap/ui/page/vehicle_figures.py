"""The figures of each vehicle on a page, and the alarms of a flight. Pure.

Return paths and fences need time: they are computed once in `HOME_S` for each vehicle.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from missions import events as ev
from missions.flight.return_home import return_route
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase, VehicleState
from missions.geo.fence import route_length_m
from missions.units import GridPoint
from uavmap.aircraft.process.messages import Telemetry
from uavmap.base.printable import printable
from uavmap.output.drawing.palette import CONTROLS
from uavmap.output.facts.flight_log import Count
from uavmap.runner.operator.progress import doing

HOME_S: Final = 1.0
"""Minimum mission time between two computations of a return path, s."""
SPEED_S: Final = 2.0
"""Time over which a ground speed is measured, s."""
RATE_S: Final = 10.0
"""Time over which the rate of judged frames is measured, s."""


class Home(NamedTuple):
    """The return path from a place."""

    at_s: float
    distance_m: float
    time_s: float
    needed_wh: float
    """Energy to fly it, to land and to keep the reserve, with the model's margin, Wh."""
    outside: bool
    """True if the place is outside of the fence."""


@dataclass(slots=True)
class _Reports:
    """The reports of one vehicle."""

    amsl_m: float | None = None
    fixes: deque[tuple[float, GridPoint]] = field(default_factory=deque)
    frames_s: deque[float] = field(default_factory=deque)
    lost: int = 0
    home: Home | None = None
    telemetry: Telemetry | None = None

    def lacks_charge(self, vehicle: VehicleState) -> bool:
        """Return whether the vehicle needs more for its return path than it has."""
        return self.home is not None and vehicle.remaining_wh < self.home.needed_wh


class Alarm(NamedTuple):
    """A condition that needs the operator. It ends when `rings` is no longer true."""

    text: str
    """Text of the banner; the number of the vehicle replaces the braces."""
    rings: Callable[[VehicleState, _Reports], bool]
    """Return whether the vehicle needs the operator now."""


class TeamAlarm(NamedTuple):
    """A condition of the whole mission that needs the operator."""

    text: str
    """Text of the banner."""
    rings: Callable[[State, bool], bool]
    """Return whether it is so now, from the state and from whether the map has unsure ground."""


def _flies(vehicle: VehicleState, *phases: Phase) -> bool:
    """Return whether it is in the air, and in one of the phases if there are any."""
    away = vehicle.landed or vehicle.phase in (Phase.DOWN, Phase.LOST)
    return not away and (not phases or vehicle.phase in phases)


ALARMS: Final[Mapping[str, Alarm]] = {
    "link": Alarm("vehicle {}: link lost", lambda vehicle, _: _flies(vehicle, Phase.OFFLINE)),
    "yielded": Alarm(
        "vehicle {}: a pilot or a failsafe flies it",
        lambda vehicle, _: _flies(vehicle, Phase.YIELDED),
    ),
    "guarded": Alarm(
        "vehicle {}: its guardian has commanded return or landing",
        lambda vehicle, _: _flies(vehicle, Phase.GUARDED),
    ),
    "down": Alarm(
        "vehicle {}: down away from its pad", lambda vehicle, _: vehicle.phase is Phase.DOWN
    ),
    "lost": Alarm(
        "vehicle {}: silent for longer than its battery lasts",
        lambda vehicle, _: vehicle.phase is Phase.LOST,
    ),
    "battery": Alarm(
        "vehicle {}: battery below the need of the return path",
        lambda vehicle, reports: _flies(vehicle) and reports.lacks_charge(vehicle),
    ),
    "fence": Alarm(
        "vehicle {}: outside of the fence",
        lambda vehicle, reports: (
            _flies(vehicle) and reports.home is not None and reports.home.outside
        ),
    ),
}
"""Alarms of a vehicle, by a key that stays: a browser acknowledges the key."""
TEAM_ALARMS: Final[Mapping[str, TeamAlarm]] = {
    "traffic": TeamAlarm(
        "traffic is near: vehicles hold or return",
        lambda state, unsure: bool(state.traffic.answer),
    ),
    "unsure": TeamAlarm(
        "the map has ground unlike what the detector knows", lambda state, unsure: unsure
    ),
}
"""Alarms of the whole mission, by a key that stays."""


class VehicleFigures:
    """The figures of the vehicles of a flight, from its events and from `counts`."""

    def __init__(self, setting: Setting, counts: Mapping[int, Count]) -> None:
        self._setting = setting
        self._counts = counts
        self._known: dict[int, _Reports] = defaultdict(_Reports)

    def note(self, event: ev.Event) -> None:
        """Note an event."""
        match event:
            case ev.Tracked() | ev.Connected():
                known = self._known[event.vehicle]
                known.fixes.append((event.t_s, event.position))
                _forget(known.fixes, event.t_s - SPEED_S)
                if isinstance(event, ev.Connected) and event.home_amsl_m is not None:
                    known.amsl_m = event.home_amsl_m
            case ev.FrameSeen():
                self._known[event.vehicle].frames_s.append(event.t_s)
            case ev.FrameLost():
                self._known[event.vehicle].lost += 1

    def note_telemetry(self, telemetry: Telemetry) -> None:
        """Note a report of a vehicle beside events."""
        self._known[telemetry.vehicle].telemetry = telemetry

    def record(self, vehicle: VehicleState, t_s: float) -> dict[str, Any]:
        """Return the figures of a vehicle at a mission time, for JSON."""
        known, count = self._known[vehicle.vehicle], self._counts[vehicle.vehicle]
        energy, landed = self._setting.energy, vehicle.landed
        place = self._setting.grid.to_moving(vehicle.position, t_s)
        left_wh = vehicle.remaining_wh - energy.reserve_wh
        left_s = 3600.0 * left_wh / energy.power_w(vehicle.drawn_w)
        home = None if landed else self._home(known, vehicle, t_s)
        return {
            "at_s": round(vehicle.tracked_s, 2),
            "e": round(place.east_m, 2),
            "n": round(place.north_m, 2),
            "up": round(vehicle.height_m, 1),
            "above_home_m": self._above_home_m(vehicle),
            "amsl_m": None if known.amsl_m is None else round(known.amsl_m + vehicle.height_m, 1),
            "speed_m_s": None if landed else _speed_m_s(known.fixes, t_s),
            "wind_m_s": round(vehicle.wind_m_s, 1) or None,
            "home_m": None if home is None else round(home.distance_m),
            "home_s": None if home is None else round(home.time_s),
            "battery": round(100.0 * vehicle.remaining_wh / energy.capacity_wh, 1),
            "low": home is not None and known.lacks_charge(vehicle),
            "left_s": 0 if landed else max(round(left_s), 0),
            "rate_hz": _rate_hz(known.frames_s, t_s),
            "lost": known.lost,
            "phase": vehicle.phase.value,
            "control": CONTROLS[vehicle.phase.value],
            "doing": doing(vehicle),
            "landed": landed,
            "called": vehicle.called_home,
            "sorties": count.sorties,
            "swaps": count.swaps,
            **_reported(known.telemetry),
        }

    def alarms(self, state: State, *, unsure: bool) -> list[list[str]]:
        """Return the conditions that need the operator now, each with its key and text.

        `unsure` is true if the map has ground that is unlike the examples of the detector.
        """
        if state.is_over:
            return []
        found = [
            [f"{key} {number}", alarm.text.format(number)]
            for number, vehicle in state.vehicles.items()
            for key, alarm in ALARMS.items()
            if alarm.rings(vehicle, self._known[number])
        ]
        return found + [
            [key, alarm.text] for key, alarm in TEAM_ALARMS.items() if alarm.rings(state, unsure)
        ]

    def _home(self, known: _Reports, vehicle: VehicleState, t_s: float) -> Home | None:
        """Return the return path, computed again after `HOME_S`; None without a position."""
        if not known.fixes:
            return None
        if known.home is None or not 0.0 <= t_s - known.home.at_s < HOME_S:
            setting, here = self._setting, vehicle.position
            energy = setting.energy.in_wind(vehicle.wind_m_s)
            way = return_route(setting, here, vehicle.pad)
            distance_m = route_length_m(here, way)
            needed_wh = energy.home_wh(distance_m, vehicle.height_m, vehicle.drawn_w)
            if setting.ground is not None:
                hills_m = setting.ups_and_downs_m((here, *way))
                needed_wh += energy.relief_wh(hills_m, vehicle.drawn_w)
            time_s = energy.leg_s(distance_m) + energy.descent_s(max(vehicle.height_m, 0.0))
            outside = not (setting.whole_fence or setting.fence).contains(here)
            known.home = Home(t_s, distance_m, time_s, needed_wh, outside)
        return known.home

    def _above_home_m(self, vehicle: VehicleState) -> float | None:
        """Return the height above home of a vehicle whose heights are above the ground."""
        ground = self._setting.ground
        if ground is None:
            return None
        risen_m = ground.height_m(vehicle.position) - ground.height_m(vehicle.home)
        return round(vehicle.height_m + risen_m, 1)


def _reported(telemetry: Telemetry | None) -> dict[str, Any]:
    """Return the figures of a vehicle's report, for JSON; empty without one."""
    if telemetry is None:
        return {}
    reported = dataclasses.asdict(telemetry)
    del reported["vehicle"], reported["kind"]
    return {**reported, "mode": printable(telemetry.mode)}


def _forget(times: deque[Any], before_s: float) -> None:
    """Drop first entries while the second one is early enough."""
    while len(times) > 1 and times[1][0] <= before_s:
        times.popleft()


def _speed_m_s(fixes: deque[tuple[float, GridPoint]], t_s: float) -> float | None:
    """Return the ground speed, m/s; None without a report for `SPEED_S`."""
    if len(fixes) < 2 or t_s - fixes[-1][0] > SPEED_S:
        return None
    (from_s, start), (to_s, end) = fixes[0], fixes[-1]
    return round(start.distance_to(end) / (to_s - from_s), 1) if to_s > from_s else None


def _rate_hz(frames_s: deque[float], t_s: float) -> float:
    """Return the rate of judged frames in the last `RATE_S`, Hz."""
    while frames_s and frames_s[0] <= t_s - RATE_S:
        frames_s.popleft()
    return round(len(frames_s) / RATE_S, 1)
