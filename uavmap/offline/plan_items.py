"""Mission items of an autopilot: a flight along lines, as ground stations write it into files.

A flight climbs over its pad, flies its lines one after the other, takes pictures along them, comes
back over its pad by a way inside the fence, and is told to return there (RTL): RTL itself flies
straight home, over what the fence forbids. Nobody looks at the pictures while it is flown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from pymavlink.dialects.v20 import common as mav

from missions.errors import GeodesyError
from missions.ground.fence import Fence
from missions.ground.grid import Grid
from missions.ground.lanes import Lane
from missions.mission_file.launch_pads import homes
from missions.mission_file.schema import Mission
from missions.mission_file.views import path_speed_m_s
from missions.state import Setting
from missions.units import GridPoint, LatLon

DECIMALS: Final = 8
"""Of degrees: a millimetre, and finer than the 1e-7 degrees that go over the link."""
_SAME_M: Final = 0.01
_GROUND_SPEED: Final = 1
"""Of MAV_CMD_DO_CHANGE_SPEED: which speed is meant."""


class Above(IntEnum):
    """What heights are counted from; the value is the MAV_FRAME."""

    SEA = mav.MAV_FRAME_GLOBAL
    HOME = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT


@dataclass(frozen=True, slots=True)
class Item:
    """One mission item.

    Attributes:
        command: MAV_CMD.
        frame: MAV_FRAME; MAV_FRAME_MISSION for what has no place.
        params: param1 to param4; NaN where the autopilot chooses.
        x, y, z: latitude and longitude in degrees, height in m; or param5 to param7.
    """

    command: int
    frame: int
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    @property
    def has_place(self) -> bool:
        """Whether x, y and z are a place."""
        return self.frame in tuple(Above)


@dataclass(frozen=True, slots=True)
class Profile:
    """How lines are flown.

    Attributes:
        height_m: above `above`.
        speed_m_s: over ground.
        every_m: metres between two pictures along a line.
    """

    height_m: float
    speed_m_s: float
    every_m: float
    above: Above = Above.HOME

    def at(self, place: LatLon, command: int = mav.MAV_CMD_NAV_WAYPOINT) -> Item:
        """An item at a place, at the height of the flight."""
        lat, lon = round(place.lat_deg, DECIMALS), round(place.lon_deg, DECIMALS)
        return Item(
            command, int(self.above), (0.0, 0.0, 0.0, math.nan), lat, lon, round(self.height_m, 3)
        )

    @property
    def beginning(self) -> Item:
        """Pictures from here on."""
        return _trigger(self.every_m)

    @property
    def end(self) -> Item:
        """No more pictures."""
        return _trigger(0.0)


def _trigger(every_m: float) -> Item:
    first = 1.0 if every_m else 0.0  # take one at once
    params = (round(every_m, 3), 0.0, first, 0.0)
    return Item(mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST, mav.MAV_FRAME_MISSION, params)


def climb(home: LatLon, profile: Profile) -> list[Item]:
    """Take off and set the speed."""
    speed = (_GROUND_SPEED, round(profile.speed_m_s, 2), -1.0, 0.0)
    return [
        profile.at(home, mav.MAV_CMD_NAV_TAKEOFF),
        Item(mav.MAV_CMD_DO_CHANGE_SPEED, mav.MAV_FRAME_MISSION, speed),
    ]


@dataclass(frozen=True, slots=True)
class Flown:
    """The items along some lines.

    Attributes:
        items: to the first line, along all that can be reached, with pictures along them.
        ends: the beginning and the end of each line that is flown, in degrees.
        last: where the last line ends; where it began if none can be flown.
        left_out: lines that no way inside the fence leads to.
    """

    items: tuple[Item, ...]
    ends: tuple[LatLon, ...]
    last: GridPoint
    left_out: tuple[Lane, ...]


def along(
    lines: Sequence[Lane], start: GridPoint, fence: Fence, grid: Grid, profile: Profile
) -> Flown:
    """The items that fly lines in their order, from `start`, around what the fence forbids."""
    items: list[Item] = []
    ends: list[LatLon] = []
    left_out: list[Lane] = []
    at = start
    for line in lines:
        way = fence.route(at, line[0])
        if way is None:
            left_out.append(line)
            continue
        items += [profile.at(grid.position(point)) for point in _new(at, way)]
        items.append(profile.beginning)
        items.append(profile.at(grid.position(line[1])))
        items.append(profile.end)
        ends += [grid.position(point) for point in line]
        at = line[1]
    return Flown(tuple(items), tuple(ends), at, tuple(left_out))


def _new(at: GridPoint, way: Sequence[GridPoint]) -> Iterator[GridPoint]:
    """The points of a way, without those where the vehicle is already."""
    for point in way:
        if at.distance_to(point) > _SAME_M:
            yield point
        at = point


def way_back(at: GridPoint, home: LatLon, fence: Fence, grid: Grid, profile: Profile) -> list[Item]:
    """Over the pad by a way inside the fence, and down by the autopilot's RTL.

    Raises `GeodesyError` when there is no such way; from where a way from the pad led there is one.
    """
    route = fence.route(at, grid.fixed(home))
    if route is None:
        raise GeodesyError("no way inside the fence leads back to the home")
    way = list(_new(at, route))
    items = [profile.at(grid.position(point)) for point in way[:-1]]
    if way:
        items.append(profile.at(home))
    return [*items, Item(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_FRAME_MISSION)]


def search_profile(mission: Mission, vehicle: int, *, nonstop: bool, above: Above) -> Profile:
    """How a vehicle (from 0) flies its search lanes: height, speed and pictures of the mission."""
    layer_m = mission.search_altitude_m(vehicle) or mission.altitude_m(vehicle)
    height_m = layer_m + (mission.start.amsl_m if above is Above.SEA else 0.0)
    if not nonstop:
        return Profile(height_m, mission.flight.speed_m_s, mission.grid.cell_m, above)
    speed_m_s = path_speed_m_s(mission, layer_m)
    return Profile(height_m, speed_m_s, speed_m_s * mission.camera.interval_s, above)


@dataclass(frozen=True, slots=True)
class SearchFlight:
    """The search of one vehicle as mission items, and the lanes that it leaves out."""

    home: LatLon
    profile: Profile
    items: tuple[Item, ...]
    left_out: tuple[Lane, ...]


def search_flight(setting: Setting, vehicle: int, above: Above = Above.HOME) -> SearchFlight:
    """The share of a vehicle (from 0) of the search lanes of a mission, in the order of flight."""
    mission, grid, fence = setting.mission, setting.grid, setting.fence
    profile = search_profile(mission, vehicle, nonstop=setting.nonstop, above=above)
    home = homes(mission)[vehicle]
    flown = along(setting.shares[vehicle], grid.fixed(home), fence, grid, profile)
    items = (
        *climb(home, profile),
        *flown.items,
        *way_back(flown.last, home, fence, grid, profile),
    )
    return SearchFlight(home, profile, items, flown.left_out)
