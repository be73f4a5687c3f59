"""The map as the planner of paths sees it: arrays of votes, and where nobody may be or look."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString

from missions.flight.setting import Setting
from missions.flight.state import State, VehicleState
from missions.flight.strategy.flyers import LONGEST_S, gate_of, kinematics, over_pad
from missions.planning.search.strip import Strip
from missions.planning.sweep.chart import Chart, Flags, Known
from missions.units import Cell

Metres = NDArray[np.float64]


def chart_of(
    setting: Setting,
    state: State,
    root: Cell | None,
    begin_s: float,
    team: Mapping[int, VehicleState],
    home_s: float | None = None,
) -> Known:
    """What is known, around the region, as it lies at a time; without a `root` all of the box.

    `home_s` is when our own vehicle of a fleet will be over its pad, between those of others. What
    lies on a lane that is still to be flown is nobody's.
    """
    belief, cell_m = state.belief, setting.mission.grid.cell_m
    tallies = belief.open_tallies.as_dict()
    box = setting.box_cells if root is None else ()
    ways = _ways(setting, begin_s, team)
    chart = Chart.around([*((root,) if root else box), *tallies, *ways], cell_m)
    if tallies:
        index = chart.indices(tallies.keys())
        counted = chain.from_iterable(tallies.values())
        positive, total = np.fromiter(counted, np.int64, 2 * len(tallies)).reshape(-1, 2).T
        chart.yes[index], chart.no[index] = positive, total - positive
    region = chart.indices(belief.roi.as_dict().keys())
    chart.yes[region], chart.no[region] = belief.positive, 0
    _fence(setting, chart, begin_s, begin_s if home_s is None else home_s, team)
    if root is not None:
        return Known(chart, chart.index(root))
    wanted = np.zeros(chart.columns * chart.rows, np.uint8)
    wanted[chart.indices(list(setting.strategy.asked_for(setting, state)))] = 1
    lanes = {lane for vehicle in state.vehicles.values() for lane in vehicle.lanes}
    time_s = setting.lane_time_s(state.t_s)
    for lane in sorted(lanes):
        _close(chart, Strip.of(setting.grid, lane, setting.lane_rows, time_s))
    return Known(chart, -1, wanted, patches=setting.strategy.patches)


def _close(chart: Chart, strip: Strip) -> None:
    """Close the cells of a strip, as far as they are in the chart."""
    columns, rows = strip.columns, strip.rows
    east, north = (columns, rows) if strip.eastward else (rows, columns)
    closed = chart.closed.reshape(chart.rows, chart.columns)
    closed[
        max(north.start - chart.south, 0) : max(north.stop - chart.south, 0),
        max(east.start - chart.west, 0) : max(east.stop - chart.west, 0),
    ] = 1


def _ways(setting: Setting, begin_s: float, team: Mapping[int, VehicleState]) -> list[Cell]:
    """Where vehicles are, and where they will end: what lies outside of a chart is closed.

    A region that drifts leaves their pads behind.
    """
    grid, cell_m = setting.grid, setting.mission.grid.cell_m
    cells = []
    for vehicle in team.values():
        end_s = begin_s if vehicle.path is None else vehicle.path.end_s
        places = [
            grid.to_moving(vehicle.position, begin_s),
            grid.to_moving(vehicle.pad, begin_s),
            grid.to_moving(vehicle.pad, min(max(end_s, begin_s), begin_s + LONGEST_S)),
        ]
        cells += [
            Cell(round(place.east_m / cell_m), round(place.north_m / cell_m)) for place in places
        ]
    return cells


def _fence(
    setting: Setting,
    chart: Chart,
    begin_s: float,
    home_s: float,
    team: Mapping[int, VehicleState],
) -> None:
    """Close what lies outside: half a cell inside the margin a vehicle may be.

    The chart drifts with the region, and the fence does not. It is taken as it lies now; the
    columns over the pads of others as they will lie when ours comes home, for there it meets them.
    """
    cell_m = chart.cell_m
    whole = setting.fence if setting.whole_fence is None else setting.whole_fence
    inner = whole.shrunk(cell_m / 2.0)
    allowed = shapely.contains_xy(inner, *_over_ground(setting, chart, begin_s)).astype(np.uint8)
    if setting.whole_fence is not None:
        x, y = _over_ground(setting, chart, home_s)
        column = shapely.contains_xy(inner, x, y)
        column &= ~shapely.contains_xy(setting.fence.inner, x, y)
        allowed[column] = 0
        ours = next((v for n, v in team.items() if setting.team.controls(n)), None)
        if ours is not None:  # the way to its own is free, wherever the middle of a cell lies
            way = LineString([over_pad(setting, ours), gate_of(setting, ours)])
            allowed[shapely.dwithin(shapely.points(x, y), way, cell_m)] = 1
    chart.allowed = allowed.ravel()
    chart.fenced = not bool(allowed.all())
    if not chart.fenced:
        return
    seen = np.zeros_like(allowed)
    for vehicle in team.values():
        flown = kinematics(setting, setting.heights.as_mapping(setting, vehicle))
        reach_e = math.floor(flown.half_east_m / cell_m)
        reach_n = math.floor(flown.half_north_m / cell_m)
        seen |= _dilated(np.asarray(allowed), reach_e, reach_n)
    chart.closed = (1 - seen).astype(np.uint8).ravel()


def _over_ground(setting: Setting, chart: Chart, t_s: float) -> tuple[Metres, Metres]:
    """Where the middle of each cell of a chart lies at a time, east and north."""
    grid = setting.grid
    east = (np.arange(chart.columns) + chart.west) * chart.cell_m + grid.drift_east_m_s * t_s
    north = (np.arange(chart.rows) + chart.south) * chart.cell_m + grid.drift_north_m_s * t_s
    x, y = np.meshgrid(east, north)
    return x, y


def _dilated(flags: Flags, columns: int, rows: int) -> Flags:
    """Each flag spread over so many columns and rows to either side."""
    out = flags.copy()
    for k in range(1, columns + 1):
        out[:, k:] |= flags[:, :-k]
        out[:, :-k] |= flags[:, k:]
    flags = out.copy()
    for k in range(1, rows + 1):
        out[k:, :] |= flags[:-k, :]
        out[:-k, :] |= flags[k:, :]
    return out
