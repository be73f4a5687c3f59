"""A survey in a wind across its lanes: every cell of the box, and no lane twice."""

from __future__ import annotations

import itertools

import pytest

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.units import GridPoint
from tests.e2e import rig
from uavmap.load.mission_source import load

MORE = 1.1
"""Extra paths to single cells that a gust kept from the pictures, and the vehicle's deviation."""


def plain_m(setting: Setting) -> float:
    home = GridPoint(0.0, 0.0)
    stations = [home, *itertools.chain.from_iterable(setting.lanes), home]
    return sum(a.distance_to(b) for a, b in itertools.pairwise(stations))


@pytest.mark.parametrize(
    ("habits", "most_missed"), [({"tilt_sigma_deg": 0, "heading_sigma_deg": 0}, 0), ({}, 3)]
)
def test_survey_in_the_wind_flies_its_lanes_once(habits, most_missed, tmp_path):
    """The camera tilts with the airframe and points to leeward: lanes are flown to windward."""
    flown = rig.kinder("windy", tmp_path, **habits)
    setting = setting_of(load(rig.mission(flown)))
    assert len(setting.lanes) == 3
    # a heading that is off by degrees costs cells at the rim of the region
    summary = rig.fly(flown, tmp_path / "out").complete(most_missed)
    assert (summary["sorties"], summary["cells_undecided"]) == (1, 0)
    assert summary["distance_m"] < MORE * plain_m(setting)
