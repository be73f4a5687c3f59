"""Searching high and mapping low: where and when vehicles change their layer.

With `search.altitude_m` lanes are flown in layers of their own, above those from which the map is
made. Such a frame counts where the ground is plain (`missions.mapping.overview`).

A vehicle changes its layer at its place, or a few metres beside. If the mission gives the climb and
descent rates of the autopilot, it does so on its way. At take-off it leaves a part of the climb for
the way to its first lane. With no lanes left it descends on its way to the cells to map.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from missions.flight.state import OneHeight, Setting, State
from missions.flight.vehicle_state import OFF_LAYER_M, VehicleState
from missions.geo.trajectory import LANE_CUTS_M
from missions.planning.search.lanes import Lane, point_on
from missions.units import Cell

MAX_LANE_CUT_SHARE: Final = 0.4
"""Maximum share of a lane that is left out at either end: frames show it before it is reached."""
CORNER_CUT_SHARE: Final = 0.05
"""Cut of corners between lanes at search height, share of a lane's width."""
CLIMB_ON_PATH_SHARE: Final = 0.8
"""Share of the possible climb on the way to the first lane that is left at take-off."""


class TwoHeights(OneHeight):
    """Flight of lanes in layers of their own, above all those from which the map is made."""

    def searched(self, state: State) -> Callable[[Cell], bool]:
        """Return the predicate that any frame, from search or map height, has judged a cell."""
        low, high = (b.open_tallies.as_dict() for b in (state.belief, state.overview))
        return lambda cell: cell in high or cell in low

    def in_layer(self, state: State, vehicle: VehicleState) -> bool:
        """Return whether a vehicle is in its layer, or may reach it on the way."""
        layer_m = self.layer_m(state.setting, vehicle)
        if vehicle.cruise_altitude_m != layer_m:
            return False
        if abs(vehicle.level_m - layer_m) <= OFF_LAYER_M:
            return True
        if not state.setting.team.climbs_on_path:
            return False
        flight = state.setting.mission.flight
        if not vehicle.lanes:  # its frames count as soon as they are taken from low enough
            return flight.descent_m_s is not None and vehicle.level_m > layer_m
        rise_m = layer_m - vehicle.level_m
        return 0.0 < rise_m <= climbed_on_the_way_m(state, vehicle)

    def take_off_height_m(self, state: State, vehicle: VehicleState) -> float:
        """Return the height of a take-off; the rest is climbed on the way, m. It is never lower
        than the layer in which the vehicle maps."""
        low_m = state.setting.mission.altitude_m(vehicle.vehicle - 1) - vehicle.home_level_m
        sure_m = CLIMB_ON_PATH_SHARE * climbed_on_the_way_m(state, vehicle)
        return min(vehicle.cruise_height_m, max(low_m, vehicle.cruise_height_m - sure_m))

    def maps_meanwhile(self, state: State, vehicle: VehicleState) -> bool:
        """Return whether to look for finds of lanes to map: at each report."""
        return vehicle.tracked_s == state.t_s

    def cuts_m(self, setting: Setting) -> tuple[float, ...]:
        """Return larger cuts as well: from high up, pictures show a lane's edge from inside."""
        return (CORNER_CUT_SHARE * setting.lane_rows * setting.grid.cell_m, *LANE_CUTS_M)

    def shortened(self, setting: Setting, vehicle: VehicleState, lane: Lane) -> Lane:
        """Return a lane without the ends that frames show before they are reached. At full speed
        the last column stays in the picture for a verdict, and one frame more."""
        mission, height_m = setting.mission, vehicle.cruise_height_m
        halves_m = setting.seen_whole_m(height_m)
        ahead_m = halves_m[0] if setting.east_ahead else halves_m[1]
        seen_s = (mission.votes.positive + 1) * mission.camera.interval_s
        short_m = ahead_m - seen_s * setting.path_speed_m_s(height_m, 0.0)
        length_m = lane[0].distance_to(lane[1])
        short_m = min(max(short_m, 0.0), MAX_LANE_CUT_SHARE * length_m)
        return point_on(lane, short_m), point_on(lane, length_m - short_m)


def climbed_on_the_way_m(state: State, vehicle: VehicleState) -> float:
    """Return the height that a vehicle climbs on its way to its first lane at full speed, m. 0
    without `flight.climb_m_s`, and for a member of a fleet, which has to keep to its layer."""
    setting = state.setting
    climb_m_s = setting.mission.flight.climb_m_s
    if climb_m_s is None or not vehicle.lanes or not setting.team.climbs_on_path:
        return 0.0
    start = setting.over_ground(vehicle.lanes[0][0], state.t_s)
    return climb_m_s * vehicle.position.distance_to(start) / setting.energy.speed_m_s
