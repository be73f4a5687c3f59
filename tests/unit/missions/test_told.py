"""What a member of a fleet leaves to others, who have told where they fly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from missions.flight.told import mapping_others, seen_by_others
from missions.mission_file.fleet_checks import with_own_air
from missions.motion.trajectory import rounded_path
from missions.orders import FlyPath
from missions.state import Phase, Setting, State, VehicleState
from missions.swath.chart import Chart
from missions.units import Cell, GridPoint
from uavmap.mission_source import load_source


def test_what_lies_along_a_path_that_another_has_told_is_its_own() -> None:
    setting = Setting.of(with_own_air(load_source("bay").parse()), member=1)
    state = State.initial(setting)
    path = rounded_path([GridPoint(0.0, 300.0), GridPoint(300.0, 300.0)], 0.0, speed_m_s=10.0)
    other = replace(
        state.vehicles[5], phase=Phase.AIRBORNE, landed=False, lanes=(), height_m=40.0,
        cruise_altitude_m=40.0, position=GridPoint(0.0, 300.0),
        order=FlyPath(path, 40.0, None, 0.6),
    )  # fmt: skip
    state = state.with_vehicle(other)
    assert list(mapping_others(setting, state)) == [5]
    chart = Chart.around([Cell(0, 20), Cell(40, 40)], 10.0)

    def seen(vehicle: VehicleState) -> set[Cell]:
        flags = seen_by_others(setting, state.with_vehicle(vehicle), chart, 0.0)
        return {chart.cell(int(index)) for index in np.flatnonzero(flags)}

    cells = seen(other)
    assert {Cell(east, north) for east in range(2, 29) for north in (29, 30, 31)} <= cells
    assert all(abs(cell.north - 30) <= 3 and -4 <= cell.east <= 34 for cell in cells)
    # who flies lanes, comes home or has no path maps nothing
    assert not seen(replace(other, order=None))
    assert not seen(replace(other, lanes=setting.lanes[:1]))
    assert not seen(replace(other, phase=Phase.APART))
    assert not mapping_others(replace(setting, member=None), state)
