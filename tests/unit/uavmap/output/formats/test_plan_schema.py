"""Every plan follows QGroundControl's documentation, and `new` reads it back."""

import copy
import json

import pytest
import shapely
from jsonschema import Draft202012Validator
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.support.areas import area_files
from tests.support.plan_schema import SCHEMA, faults_of
from tests.unit.uavmap.ui.cli.commands.test_export import exported, mission_file
from uavmap.load.areas.reading import read_area_file
from uavmap.mavlink.mission_transfer import Item
from uavmap.output.formats.ground_station_plan import Firmware, plan_text

FENCE = [
    *(
        Item(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, LatLon(48.0 + a, 11.0 + b), 3.0)
        for a, b in ((0.0, 0.0), (0.001, 0.0), (0.0, 0.001))
    ),
    Item(mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, LatLon(48.0002, 11.0002), 5.0),
]
RALLY = [Item(mav.MAV_CMD_NAV_RALLY_POINT, LatLon(48.0001, 11.0001), height_m=30.0)]


def test_schema_of_a_plan_is_valid():
    Draft202012Validator.check_schema(SCHEMA)


def test_fence_read_from_an_autopilot_is_as_documented(tmp_path):
    path = tmp_path / "fence-before-1.plan"
    path.write_text(plan_text(Firmware.ARDUPILOT, LatLon(48.0, 11.0), FENCE, RALLY), "utf-8")
    assert faults_of(json.loads(path.read_text("utf-8"))) == []
    drawing = read_area_file(str(path))
    assert (len(drawing.fences), len(drawing.keep_out)) == (1, 1)


BREAKS = {
    "another type": lambda plan: plan.update(fileType="Mission"),
    "no items": lambda plan: plan["mission"].pop("items"),
    "a key that nobody documents": lambda plan: plan["mission"].update(box=[]),
    "six parameters": lambda plan: plan["mission"]["items"][0]["params"].pop(),
    "text for a number": lambda plan: plan["mission"].update(hoverSpeed="5"),
    "longitude first": lambda plan: plan["mission"]["plannedHomePosition"].__setitem__(0, 151.0),
    "no height": lambda plan: plan["mission"]["plannedHomePosition"].pop(),
    "the first fence format": lambda plan: plan["geoFence"].update(version=1),
    "a fence of two corners": lambda plan: plan["geoFence"]["polygons"][0]["polygon"].__delitem__(
        slice(2, None)
    ),
}


def test_schema_finds_each_undocumented_change(tmp_path):
    file, _ = mission_file(tmp_path)
    plan = exported(tmp_path, file)
    for name, spoil in BREAKS.items():
        spoilt = copy.deepcopy(plan)
        spoil(spoilt)
        assert faults_of(spoilt), name


def test_plan_of_a_mission_read_by_new_gives_its_fence(tmp_path):
    file, setting = mission_file(tmp_path)
    exported(tmp_path, file)
    drawing = read_area_file(str(tmp_path / "field.plan"))
    fence = shapely.Polygon([setting.grid.fixed(place) for place in drawing.fences[0].ring])
    drawn = shapely.Polygon(setting.fence.outer.exterior)
    assert fence.symmetric_difference(drawn).area < 0.5  # degrees are rounded to a millimetre
    assert len(drawing.keep_out) == 1


OLDER = ("qgc_of_2017", "qgc_of_3_2")
"""Older forms than documented ones."""
PLANS = [name for name in area_files.KINDS if name.startswith("qgc_") and name not in OLDER]


@pytest.mark.parametrize("kind", PLANS)
def test_plans_read_in_tests_are_as_documented(kind, tmp_path):
    path = area_files.KINDS[kind](tmp_path)
    assert faults_of(json.loads(path.read_text("utf-8"))) == []
