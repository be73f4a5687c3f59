"""A chart that drifts with the region, and pads that do not: return paths stay open."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from missions.flight.setting_of import setting_of
from missions.flight.strategy.charting import chart_of, flyer_of
from missions.geo.trajectory import rounded_path
from missions.mission.checks import parse_mission
from missions.orders import FlyPath
from missions.units import Cell, GridPoint
from tests.support.fleet_rig import field_text

BEGIN_S = 200.0


def drifting() -> str:
    """Return the mission file of a fleet with regions in motion."""
    text = field_text(high=True)
    return re.sub(
        r"speed_m_s = 0.0(\s+)toward_deg = 0.0", r"speed_m_s = 0.3\1toward_deg = 90.0", text
    )


@pytest.mark.parametrize("lasting_s", [0.0, 20.0, 40.0, 53.0, 80.0, 200.0])
def test_the_end_of_a_path_is_open_however_late_it_ends(lasting_s: float) -> None:
    setting = setting_of(parse_mission(drifting(), "test"), 2)
    assert setting.grid.drift_speed_m_s > 0.0
    state = setting.initial_state()
    path = rounded_path([GridPoint(0.0, 30.0), GridPoint(4.0, 30.0)], BEGIN_S, speed_m_s=5.0)
    path = replace(path, end_s=BEGIN_S + lasting_s)
    ours = replace(
        state.vehicles[2], home=setting.pad_of(2), lanes=(), position=GridPoint(0.0, 30.0),
        order=FlyPath(path, 12.0, None, 0.25),
    )  # fmt: skip
    state = state.with_vehicle(ours)
    home_s = BEGIN_S + lasting_s
    known = chart_of(state, None, BEGIN_S, {2: ours}, home_s)
    flyer = flyer_of(setting, ours, path, None, BEGIN_S)
    end = Cell(
        round(flyer.end.east_m / known.chart.cell_m), round(flyer.end.north_m / known.chart.cell_m)
    )
    assert known.chart.allowed[known.chart.index(end)]
    for number in (1, 3):  # and those of the others are closed
        pad = setting.grid.to_moving(setting.pad_of(number), home_s)
        cell = Cell(round(pad.east_m / known.chart.cell_m), round(pad.north_m / known.chart.cell_m))
        assert not known.chart.allowed[known.chart.index(cell)]
