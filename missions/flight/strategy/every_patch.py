"""`swath` with `find = "all"`, and `survey`: fly all lanes, then sweep over the rest.

Lanes decide nearly all cells that their pictures show. Vehicles then fly to the rest. With `survey`
the rest is all undecided cells of the box. With `find = "all"` it is cells without a frame, cells
that some frame shows as region, and cells beside a patch, also beyond the box.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Final

from missions.flight.airspace.airspace import Airspace
from missions.flight.state import Setting, State
from missions.flight.strategy.sweep import Paths
from missions.flight.strategy.sweep_paths import give_up_rest, path_memory
from missions.flight.strategy.work import Area, Lanes
from missions.flight.vehicle_state import Phase, VehicleState
from missions.mapping.tree import beside
from missions.mission.views import rows_across
from missions.planning.search.lanes import Blocks, Lane, along_east, longest_m, share_by_time
from missions.planning.sweep.strategies import SURVEY, SWATH
from missions.units import Cell, GridPoint

READY_S: Final = 30.0
"""Time before the first lanes are flown at which a vehicle without lanes takes off to map, s."""


class Covering(Paths):
    """The common part of strategies whose vehicles fly all lanes, whatever frames show."""

    flies_all_lanes = True
    lanes_drift = True
    least_lane_cells = 10.0  # shorter parts are flown to, in the best order that is found

    def first_target(self, state: State, vehicle: VehicleState) -> GridPoint | None:
        """Return the start of its lanes, or the nearest open cell once no vehicle has lanes."""
        target = super().first_target(state, vehicle)
        if target is None:
            target = self.beside_lanes(state, vehicle)
        if target is None and not any(v.lanes for v in state.vehicles.values()):
            return nearest(state, vehicle, self.open_cells(state))
        return target

    def beside_lanes(self, state: State, vehicle: VehicleState) -> GridPoint | None:
        """Return where a vehicle without lanes maps meanwhile; None if it does not."""
        return None

    def without_target(self, state: State, vehicle: VehicleState) -> State:
        """Give up the rest once no vehicle has lanes."""
        if any(v.lanes for v in state.vehicles.values()):
            return super().without_target(state, vehicle)
        return give_up_rest(state)

    def concluded(self, state: State, left: tuple[Lane, ...]) -> State:
        """Return the state at the end: open cells stay undecided; without them no lane matters."""
        open_ = self.open_cells(state)
        state = replace(state, exhausted=True, surveyed=not open_, undecided=open_)
        return replace(state, unreachable_lanes=left if open_ else ())


class EveryPatch(Covering):
    """Fly all lanes, and sweep over every patch."""

    about = SWATH
    patches = True
    replan_frames = 2.0  # more frames are taken before their votes are known
    shares_work = True

    def lay(self, area: Area) -> Lanes:
        """Lay lanes along the side of the box along which the team is done sooner. With a prior, or
        for one vehicle, that is the longer side. A row or two that no frame has shown are flown to:
        they are not worth a lane."""
        mission, grid, pads = area.mission, area.grid, area.pads
        longer = along_east(area.box)
        both = len(pads) > 1 and not mission.search.prior
        laid = []
        for ahead in (longer, not longer) if both else (longer,):
            rows = rows_across(mission, grid, east_ahead=ahead)
            spare = rows_across(mission, grid, len(pads) - 1, east_ahead=ahead) - rows
            laid.append(area.lanes(rows, ahead, spare))
        if not both:
            return laid[0]
        return min(laid, key=lambda one: longest_m(share_by_time(one.lanes, pads), pads))

    def shares(self, setting: Setting) -> Blocks:
        """Return the lanes by pad; by the prior if there is one."""
        if setting.likely or len(setting.pads) == 1:
            return super().shares(setting)
        return share_by_time(setting.lanes, setting.pads)

    def required_cells(self, state: State) -> list[Cell]:
        """Return cells of the box that no frame shows, and cells that a frame shows as region. Also
        cells beside region seen from search height. Some frame may have shown one of those as no
        region before it is known from below that a patch reaches it."""
        shown, belief = state.shown, state.belief
        tallies, verdicts = belief.open_tallies.as_dict(), belief.verdicts
        unseen = [
            cell for cell in state.setting.box_cells if cell not in tallies and cell not in shown
        ]
        asked = {cell for cell, (positive, _) in tallies.items() if positive}
        region = state.overview.roi.as_dict()
        around = beside([cell for cell in region if verdicts.get(cell) is not False])
        return unseen + belief.undecided(asked | (around & tallies.keys()))

    def open_cells(self, state: State) -> frozenset[Cell]:
        """Return the cells of `required_cells`, and the cells beside a patch."""
        belief = state.belief
        around = beside([cell for cell in belief.open_tallies if belief.provisional(cell)])
        return frozenset(belief.undecided(around.union(self.required_cells(state))))

    def beside_lanes(self, state: State, vehicle: VehicleState) -> GridPoint | None:
        """Return where to map the finds of lanes that others fly at search height."""
        if not state.setting.heights.maps_meanwhile(state, vehicle):
            return None
        belief = state.belief
        found = nearest(state, vehicle, belief.undecided(beside(belief.roi)))
        ends = (v.path for v in state.vehicles.values() if v.lanes and v.path is not None)
        first = min(ends, key=lambda path: path.end_s, default=None)
        if found is not None or first is None or first.end_s > state.t_s + READY_S:
            return found
        return first.place_at(first.end_s)

    def without_lanes(self, state: State, vehicle: VehicleState) -> State:
        """Have a vehicle wait for members out of contact over its pad, in range of all."""
        away = (v for v in state.vehicles.values() if v.phase is Phase.APART)
        waits = vehicle.vehicle in path_memory(state).waiting
        waits = waits and any(state.t_s < v.held_until_s for v in away)
        if waits and not vehicle.is_over_pad:
            return Airspace(state).over_own_pad(vehicle)
        return state.holding(vehicle)


def nearest(state: State, vehicle: VehicleState, cells: Collection[Cell]) -> GridPoint | None:
    """Return the place of the nearest cell, of equal ones the lowest; None without cells."""
    places = (state.setting.where(cell, state.t_s) for cell in sorted(cells))
    return min(places, key=vehicle.position.distance_to, default=None)


ALL: Final = EveryPatch()


class Survey(Covering):
    """Decide every cell of the box, wherever the region is."""

    about = SURVEY
    whole_box = True

    def required_cells(self, state: State) -> list[Cell]:
        """Return the undecided cells of the box; cells beside a patch beyond it do not count."""
        return state.belief.undecided(state.setting.box_cells)

    def lane_done(self, state: State) -> Callable[[Cell], bool]:
        """Return the predicate that a cell is decided."""
        verdicts = state.belief.verdicts
        return lambda cell: verdicts.get(cell) is not None


WHOLE_BOX: Final = Survey()
