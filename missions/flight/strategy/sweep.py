"""`swath` with `find = "first"`: search until the region is seen, then sweep over it.

`Paths` is the common part of all strategies that fly paths. `missions.flight.strategy.lane_paths`
and `sweep_paths` plan and give the paths.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from missions.events import FrameSeen
from missions.flight.airspace.airspace import Airspace
from missions.flight.path_orders import come_inside, keep_clear
from missions.flight.sightings import on_a_lane
from missions.flight.state import Setting, State, Strategy
from missions.flight.strategy.fallback import whole_bound_s
from missions.flight.strategy.lane_paths import end_searched, search_paths
from missions.flight.strategy.searching import find_work, search
from missions.flight.strategy.stepwise import RDFS
from missions.flight.strategy.sweep_paths import explore_paths, give_up_rest, go_straight_home
from missions.flight.strategy.work import Area, Lanes
from missions.flight.vehicle_state import VehicleState
from missions.geo.trajectory import LANE_CUTS_M, corner_pause_s, rounded_path
from missions.mapping.belief import Verdicts
from missions.mapping.tree import Tree, grown
from missions.mission.views import rows_across
from missions.planning.search.lanes import along_east
from missions.planning.search.search_order import Pace
from missions.planning.sweep.strategies import SWATH
from missions.units import GridPoint


def change_layer(state: State, vehicle: VehicleState) -> State | None:
    """Have a vehicle climb or descend to its layer; None if it is there. While the air is not clear
    it stays, and tries again."""
    setting, heights = state.setting, state.setting.heights
    if heights.in_layer(state, vehicle):
        return None
    changed = setting.team.change_layer(state, vehicle)
    if changed is not None:
        return changed
    moved = replace(vehicle, cruise_altitude_m=heights.layer_m(setting, vehicle))
    if moved != vehicle and heights.in_layer(state, moved):  # on its way
        return state.holding(moved)
    air, begins = Airspace(state), replace(moved, at_target=False)
    for spot in (vehicle.position, *air.places_around(vehicle)):
        route = setting.fence.route(vehicle.position, spot) or (vehicle.position,)
        if (given := air.reserve(begins, begins.leg(route))) is not None:
            return given
    return state.holding(vehicle)


class Paths(Strategy):
    """The common part of strategies whose vehicles do not stop."""

    stops = False

    def in_force(self, state: State) -> Strategy:
        """Return `rdfs` once the time for paths is over (`missions.flight.strategy.fallback`)."""
        return RDFS if state.falls_back else self

    def lay(self, area: Area) -> Lanes:
        """Lay lanes as far apart as pictures show whole cells, along the longer side."""
        ahead = along_east(area.box)
        return area.lanes(rows_across(area.mission, area.grid, east_ahead=ahead), ahead)

    def pace(self, setting: Setting) -> Pace:
        """Return the speed of paths, and the time of a corner."""
        speed_m_s = setting.path_speed_m_s(setting.mission.top_altitude_m(0), 0.0)
        return Pace(speed_m_s, corner_pause_s(speed_m_s, LANE_CUTS_M[0]))

    def search_s(self, setting: Setting) -> float:
        """Return the time of one path along the lanes, from home and back."""
        mission, home = setting.mission, GridPoint(0.0, 0.0)
        ends_s = []
        for index, block in enumerate(setting.shares):
            speed_m_s = setting.path_speed_m_s(mission.top_altitude_m(index), 0.0)
            points = [home, *(end for lane in block for end in lane), home]
            path = rounded_path(points, 0.0, speed_m_s=speed_m_s, cut_m=LANE_CUTS_M[0])
            ends_s.append(path.end_s)
        return max(ends_s)

    def cell_s(self, setting: Setting) -> float:
        """Return the time in which a picture passes over a cell's area."""
        footprint = setting.mission.camera.optics.footprint(setting.mission.altitude_m(0))
        return setting.grid.cell_m**2 / footprint.short_m / setting.energy.speed_m_s

    def seen_in_passing(self, state: State, event: FrameSeen, votes: Verdicts) -> State:
        """Count a frame for the lane that its vehicle flies."""
        return on_a_lane(state, event)

    def plan(self, state: State) -> State:
        """Stop vehicles that meet reserved air or have no lane left to see, and plan anew."""
        state = end_searched(keep_clear(state))
        return state if state.is_held else self.plan_paths(state)

    def plan_paths(self, state: State) -> State:
        """Plan for all vehicles with a region to explore, or without lanes, until that is done."""
        if state.exploration_finished:
            return go_straight_home(state)
        begun = self.flies_all_lanes or state.tree is not None
        return explore_paths(self, state) if begun else state

    def next_order(self, state: State, vehicle: VehicleState) -> State:
        """Give a path along the lanes; an exploration plans paths for all at once."""
        inside = come_inside(state, vehicle)
        if inside is not None:
            return inside
        if self.shares_work and state.setting.team.gathers(state, vehicle):
            if not vehicle.is_over_pad:
                return Airspace(state).over_own_pad(vehicle)
        elif self.flies_all_lanes and not vehicle.lanes:  # before it changes its layer
            state = find_work(state, vehicle)
            vehicle = state.vehicles[vehicle.vehicle]
        changed = change_layer(state, vehicle)
        if changed is not None:
            return changed
        if vehicle.asks is not None:  # it is there: the air belongs to the others again
            vehicle = replace(vehicle, asks=None)
            state = state.with_vehicle(vehicle)
        if state.tree is None and vehicle.lanes:
            return search_paths(state, vehicle)
        return self.without_lanes(state, vehicle)

    def without_lanes(self, state: State, vehicle: VehicleState) -> State:
        """Give an order to an idle vehicle that has no lanes: it is planned for with the others."""
        return state.holding(vehicle)

    def give_up_far(self, state: State, vehicle: VehicleState) -> State | None:
        """Give up the rest, unless lanes are left that a vehicle may still fly."""
        if state.tree is None and any(v.lanes for v in state.vehicles.values()):
            return None
        return give_up_rest(state)


class Sweep(Paths):
    """Search until the region is seen, then sweep over the patch that is connected with it."""

    about = SWATH

    def bound_s(self, setting: Setting, tree: Tree) -> float:
        """Return twice the bound of `rdfs`, a leg and two minutes."""
        return round(whole_bound_s(setting, len(tree), tree.depth), 1)

    def seen_in_passing(self, state: State, event: FrameSeen, votes: Verdicts) -> State:
        """Make the first cell that is region the root: all vehicles leave the search."""
        state = super().seen_in_passing(state, event, votes)
        root = next((cell for cell in votes if cell in state.belief.roi), None)
        if root is None:
            return state
        tree = grown(Tree.rooted(root), state.belief, votes)
        return replace(state, tree=tree, found_s=state.t_s).with_all(
            lambda other: replace(other, vertex=root, candidate=None, on_lane=False)
        )

    def without_lanes(self, state: State, vehicle: VehicleState) -> State:
        """Have a vehicle search while others have lanes, else wait; an exploration plans for it."""
        return search(state, vehicle) if state.tree is None else state.holding(vehicle)


FIRST: Final = Sweep()
