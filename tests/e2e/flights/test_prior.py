"""A mission with a prior finds its region sooner, in a whole simulated flight."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from missions.geo.grid import Grid
from missions.units import GridPoint
from tests.e2e import rig
from tests.support.folding import fold
from tests.support.small_missions import CELL_M, START, mission_text, square, with_small_pictures
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan

GRID = Grid.at(START, CELL_M)
REGION = square(-40, 84, 14, 10)
"""Corners of the region, in the corner of the box that is searched last."""


def write(folder: Path, *, prior: bool) -> Path:
    text = mission_text(
        square(-44, 16, 90, 80), square(-80, -40, 160, 180), strategy="swath", capacity_wh=90.0,
        mounting="gimbal", regions=[REGION],
    )  # fmt: skip
    text = with_small_pictures(text)
    folder.mkdir()
    if prior:
        text = text.replace("[search]", '[search]\nprior = "where.geojson"')
        place = GRID.position(GridPoint(-30.0, 86.0))
        point = {"type": "Point", "coordinates": [place.lon_deg, place.lat_deg]}
        feature = {"type": "Feature", "geometry": point, "properties": {"spread_m": 15.0}}
        content = json.dumps({"type": "FeatureCollection", "features": [feature]})
        (folder / "where.geojson").write_text(content, encoding="utf-8")
    path = folder / "field.toml"
    path.write_text(text, encoding="utf-8")
    return path


def found_s(mission: Path) -> float:
    flight = rig.fly(mission, mission.parent / "out")
    flight.complete()
    with Journal.open(flight.folder / JOURNAL) as journal:
        plan = FlightPlan.read(journal)
        held = bool(plan.mission.search.prior)  # the journal holds the whole plan of the flight
        assert held == ("prior" in mission.read_text("utf-8"))
        state = fold(plan.setting(print), journal.events())
    assert state.found_s is not None
    return state.found_s


def test_region_with_a_prior_is_found_sooner(tmp_path):
    mission = write(tmp_path / "known", prior=True)
    expected = rig.uavmap("check", mission, "--json").summary
    sooner_s = expected["first_sighting_without_prior_s"] - expected["first_sighting_s"]
    known = found_s(mission)
    unknown = found_s(write(tmp_path / "unknown", prior=False))
    assert unknown - known > 0.5 * sooner_s > 15.0  # it need not lie where the prior expects it


def test_check_with_a_prior_reports_an_earlier_first_sighting(tmp_path):
    mission = write(tmp_path / "known", prior=True)
    done = rig.uavmap("check", mission)
    found = re.search(
        r"^  expected first sighting after about (\d+) s \(without the prior (\d+) s\)$",
        done.out,
        re.MULTILINE,
    )
    assert found is not None
    soon_s, late_s = map(int, found.groups())
    assert 15 < soon_s < late_s - 30
    figures = rig.uavmap("check", mission, "--json").summary
    assert figures["first_sighting_s"] == pytest.approx(soon_s, abs=0.6)
    assert figures["first_sighting_without_prior_s"] == pytest.approx(late_s, abs=0.6)


def test_check_without_a_prior_reports_no_first_sighting(tmp_path):
    done = rig.uavmap("check", write(tmp_path / "unknown", prior=False))
    assert "first sighting" not in done.out
