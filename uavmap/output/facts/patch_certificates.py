"""The certificate of each patch of the region, and of all: proven completeness and speed.

A patch is complete when each of its cells and each cell beside these is judged. It *took* the time
from its first judged cell to the last one in it or beside it; other flights in between count.

Later frames showed every cell judged after the first one. `missions.planning.lower_bounds` limits
the ground that R vehicles show at that moment, and sweep from then on. This gives the least time
of any team of this size and speed.

The certificate follows from the ballots, so it does not depend on the order of the facts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely

from missions.flight.state import Setting, State
from missions.mapping.belief import FrameId, judging_frames
from missions.mapping.tree import patches
from missions.mission.views import DRAG_1_S, G_M_S2, path_speed_m_s, seen_whole_m
from missions.planning.lower_bounds import passing_bound_s
from missions.units import Cell, GridPoint
from uavmap.output.facts.map_model import drift_m
from vision.projection import SEEN_SHARE

FACT_S: Final = 1.0
"""Resolution of the times of verdicts that members of a fleet share, s."""


@dataclass(frozen=True, slots=True)
class Team:
    """The figures of a team for `passing_bound_s`."""

    robots: int
    footprint_m: tuple[float, float]
    lean_m: float
    speed_m_s: float
    turned: bool
    late_s: float
    """Maximum delay of a verdict after its shared time, s."""

    @classmethod
    def from_state(cls, state: State, *, overview: bool) -> Team:
        """Create the team of a mission at its maximum speed, with frames from its maximum height.

        `overview`: frames from the height of a search, not from that of the map.
        """
        setting = state.setting
        mission = setting.mission
        vehicles, above_m = state.vehicles, mission.overview_above_m
        low_m = [mission.altitude_m(number - 1) for number in vehicles]
        heights_m = [mission.top_altitude_m(number - 1) for number in vehicles]
        if not overview and above_m is not None:
            heights_m = [*low_m, above_m]
        height_m = max(heights_m) + max(0.0, *(-v.home_level_m for v in vehicles.values()))
        height_m += mission.ground_span_m  # an upper bound: downhill a picture shows more
        speed_m_s = mission.flight.speed_m_s + mission.drift.speed_m_s
        if not setting.strategy.stops:
            layers_m = (*low_m, *(mission.top_altitude_m(number - 1) for number in vehicles))
            speed_m_s = max(speed_m_s, *(path_speed_m_s(mission, m) for m in layers_m))
        wind_m_s = max(mission.wind.speed_m_s, *(v.wind_m_s for v in vehicles.values()))
        tilt_m_s2 = height_m / G_M_S2 if mission.camera.mounting == "fixed" else 0.0
        return cls(
            len(vehicles),
            mission.camera.optics.footprint(height_m),
            tilt_m_s2 * (setting.energy.accel_m_s2 + DRAG_1_S * (speed_m_s + wind_m_s)),
            speed_m_s,
            setting.strategy.in_force(state).stops,
            FACT_S if setting.team.shares_facts else 0.0,
        )

    def least_s(self, ground_m2: float) -> float:
        """Return the least time to show an area of ground, from any place, s."""
        share = SEEN_SHARE if self.turned else 1.0  # frames of a stop judge nearly whole cells
        bound_s = passing_bound_s(
            share * ground_m2, self.robots, 0, self.footprint_m, self.lean_m,
            self.speed_m_s, turned=self.turned,
        )  # fmt: skip
        return max(0.0, bound_s - self.late_s)


@dataclass(frozen=True, slots=True)
class _Verdicts:
    """The frames that judged cells, and the teams at both heights."""

    frames: Mapping[Cell, FrameId]
    above: Collection[FrameId]
    """The frames from the height of a search: they show more ground."""
    low: Team
    high: Team
    cell_m2: float
    lift_off_s: float

    @classmethod
    def from_state(cls, state: State, lift_off_s: float) -> _Verdicts:
        return cls(
            judging_frames(state.belief),
            state.overview.looks.get(None, {}),
            Team.from_state(state, overview=False),
            Team.from_state(state, overview=True),
            state.setting.grid.cell_m**2,
            lift_off_s,
        )

    def times(self, region: Collection[Cell], beside: Collection[Cell]) -> dict[str, float | None]:
        """Return the times of verdicts, and the least time for those after the first one."""
        if not region:
            return dict.fromkeys(("found_s", "decided_s", "took_s", "lower_bound_s", "ratio"))
        begin_s = min(self.frames[cell].t_s for cell in region)
        judged = [self.frames[cell] for cell in (*region, *beside) if cell in self.frames]
        end_s = max(frame.t_s for frame in judged)
        later = [frame in self.above for frame in judged if frame.t_s > begin_s]
        # a vehicle flies at both heights, so the two bounds do not add up
        bound_s = max(
            self.low.least_s(later.count(False) * self.cell_m2),
            self.high.least_s(later.count(True) * self.cell_m2),
        )
        took_s, bound_s = round(end_s - begin_s, 1), round(bound_s, 1)
        return {
            "found_s": round(begin_s - self.lift_off_s, 1),
            "decided_s": round(end_s - self.lift_off_s, 1),
            "took_s": took_s,
            "lower_bound_s": bound_s,
            "ratio": round(took_s / bound_s, 3) if bound_s else None,
        }


def certificates(state: State, lift_off_s: float) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the certificate of each patch, the largest first, and that of all.

    Places are those at `state.t_s`. Seconds count from `lift_off_s`, a mission time.
    """
    judged = _Verdicts.from_state(state, lift_off_s)
    frames, found = judged.frames, patches(state.belief.roi)
    beside = [{near for cell in patch for near in cell.neighbours()} - patch for patch in found]
    open_cells = {cell for cells in beside for cell in cells if cell not in frames}
    seen_s = _first_seen_s(state)
    reasons = _reasons(state, open_cells, seen_s)
    found_each = []
    for patch, others in zip(found, beside, strict=True):
        middle = [sum(axis) / len(patch) for axis in zip(*patch, strict=True)]
        root = min(patch, key=lambda cell: (frames[cell].t_s, cell))
        left = sorted(cell for cell in others if cell not in frames)
        found_each.append({
            **_size(state.setting, len(patch)),
            **_place(state, middle[0], middle[1]),
            "root": {
                "column": root.east,
                "row": root.north,
                **_place(state, root.east, root.north),
                "seen_s": round(seen_s[root] - lift_off_s, 1),
            },
            "complete": not left,
            "open": _by_reason(left, reasons),
            **judged.times(patch, others),
        })  # fmt: skip
    counts = {name: len(cells) for name, cells in _by_reason(sorted(open_cells), reasons).items()}
    in_all = {
        "patches": len(found),
        **_size(state.setting, len(state.belief.roi)),
        "complete": bool(found) and not open_cells,
        "open": counts,
        **judged.times(state.belief.roi, set[Cell]().union(*beside)),
        "box": _box(state, frames, seen_s),
    }
    return found_each, in_all


def _size(setting: Setting, cells: int) -> dict[str, Any]:
    return {"cells": cells, "area_m2": round(cells * setting.grid.cell_m**2, 1)}


def _place(state: State, east: float, north: float) -> dict[str, float]:
    grid = state.setting.grid
    point = GridPoint(east * grid.cell_m, north * grid.cell_m)
    place = grid.position(grid.to_fixed(point, state.t_s))
    return {"lat_deg": round(place.lat_deg, 7), "lon_deg": round(place.lon_deg, 7)}


def _first_seen_s(state: State) -> dict[Cell, float]:
    """Return when each cell was first observed, from either height, by frames that count."""
    first = state.overview.first_seen_s()
    for cell, t_s in state.belief.first_seen_s().items():
        first[cell] = min(t_s, first.get(cell, t_s))
    return first


# --- what is not judged, and why ---------------------------------------------------------------
def _reasons(state: State, cells: Collection[Cell], seen: Collection[Cell]) -> dict[Cell, str]:
    """Return the reason why each cell beside the region is not judged: the first that holds."""
    beyond = beyond_fence(state.setting, cells, state.t_s)
    reasons = {}
    for cell in cells:
        cross = set(cell.cross())
        if cross & state.skipped:
            reasons[cell] = "skipped"
        elif cell in beyond:
            reasons[cell] = "beyond_fence"
        elif cross & state.abandoned:
            reasons[cell] = "out_of_reach"
        elif cross & state.undecided:
            reasons[cell] = "given_up"
        else:
            reasons[cell] = "few_frames" if cell in seen else "no_frames"
    return reasons


def _by_reason(cells: Iterable[Cell], reasons: Mapping[Cell, str]) -> dict[str, list[list[int]]]:
    found: dict[str, list[list[int]]] = {}
    for cell in cells:
        found.setdefault(reasons[cell], []).append([cell.east, cell.north])
    return dict(sorted(found.items()))


def beyond_fence(setting: Setting, cells: Collection[Cell], t_s: float) -> frozenset[Cell]:
    """Return the cells that no frame can show at a time: the vehicle would be beyond the fence.

    A vehicle that does not stop keeps half a cell inside the margin. A vehicle that stops is over
    the cell or one beside it.
    """
    if not cells:
        return frozenset()
    grid, mission, listed = setting.grid, setting.mission, list(cells)
    places = grid.cell_m * np.array(listed, dtype=np.float64) + drift_m(grid, t_s)
    if not setting.strategy.stops:
        vehicles = range(len(mission.vehicles))
        half_east_m, half_north_m = seen_whole_m(
            mission, max(map(mission.altitude_m, vehicles)), east_ahead=setting.east_ahead
        )
        half_m = np.array([max(half_east_m, 0.1), max(half_north_m, 0.1)])
        views = shapely.box(*(places - half_m).T, *(places + half_m).T)
        inside = shapely.intersects(setting.fence.shrunk(grid.cell_m / 2.0), views)
    else:
        around = places[:, None] + grid.cell_m * np.array(Cell(0, 0).cross(), dtype=np.float64)
        free = setting.fence.shrunk(-0.01)  # an edge counts as inside, despite rounding
        inside = shapely.intersects_xy(free, around[..., 0], around[..., 1]).any(axis=1)
    return frozenset(cell for cell, ok in zip(listed, inside.tolist(), strict=True) if not ok)


def _box(state: State, judged: Collection[Cell], seen_s: Collection[Cell]) -> dict[str, Any]:
    """Return the judged part of the search box; if it is all, no patch is missing in it."""
    cells = state.setting.box_cells
    left = [cell for cell in cells if cell not in judged]
    beyond = beyond_fence(state.setting, [cell for cell in left if cell not in seen_s], 0.0)
    return {
        "cells": len(cells),
        "decided": len(cells) - len(left),
        "few_frames": sum(cell in seen_s for cell in left),
        "no_frames": sum(cell not in seen_s for cell in left) - len(beyond),
        "beyond_fence": len(beyond),
        "whole": len(left) == len(beyond),
    }
