"""The ground in the memory of an autopilot becomes that of a mission, before it flies."""

from __future__ import annotations

import pytest

from missions.errors import LinkError, MissionFileError
from missions.geo.grid import Grid
from missions.units import GridPoint
from sitl.mavlink.telemetry import Telemetry
from tests.support.plans import plan_of
from tests.support.small_missions import START, mission_text, square
from uavmap.journal.flight_plan import FlightPlan
from uavmap.runner.flight import fly
from uavmap.runner.ground_survey import with_ground

GRID = Grid.at(START, 4.0)


def plan(autopilot: str = "ardupilot") -> FlightPlan:
    text = mission_text(square(-4, 10, 24, 16), square(-40, -40, 100, 110), altitude_m=14.0)
    text = text.replace("[flight]", '[flight]\nheight_above = "ground"')
    text += (
        '\n[terrain]\nsource = "autopilot"\n'
        f'[sim]\nautopilot = "{autopilot}"\n[sim.terrain]\nslope_percent = 10.0\n'
        "rises_toward_deg = 90.0\n"
    )
    return plan_of("field.toml", text, None, None, 1, (), None, 0.0)


def test_ground_reported_by_the_autopilot_is_kept_in_the_plan(log_lines):
    surveyed = with_ground(plan())
    assert surveyed.mission.terrain is not None
    assert surveyed.mission.terrain.source is None
    ground = surveyed.mission.ground
    assert ground is not None
    assert ground.step_m == pytest.approx(10.0)
    rise_m = ground.height_m(GridPoint(40.0, 0.0)) - ground.height_m(GridPoint(0.0, 0.0))
    assert rise_m == pytest.approx(4.0, abs=0.05)
    assert any("asks the autopilot for the ground at" in line for line in log_lines)
    assert with_ground(surveyed) is surveyed


def test_autopilot_without_terrain_is_refused(tmp_path):
    with pytest.raises(LinkError, match=r"a PX4 does not report its terrain; give terrain.dem"):
        _alone(lambda: with_ground(plan("px4")))
    with pytest.raises(MissionFileError, match=r"terrain.source"):
        fly(plan(), tmp_path)


def test_autopilot_without_an_answer_about_its_ground_is_refused(monkeypatch):
    tell = Telemetry.terrain_report
    monkeypatch.setattr(Telemetry, "terrain_report", lambda self, lat, lon, *, loaded: tell(
        self, lat, lon, loaded=False))  # fmt: skip
    with pytest.raises(LinkError, match=r"knows no ground at \d+ of \d+ places, and waits for 56"):
        _alone(lambda: with_ground(plan()))


def _alone(call) -> None:
    """Return the error that a task of a group raises, by itself."""
    alone: BaseException | None = None
    try:
        call()
    except* LinkError as group:
        alone = group.exceptions[0]
    if alone is not None:  # the first versions of Python 3.11 wrap errors raised in an except*
        raise alone


def test_fence_too_large_for_its_ground_is_refused():
    text = mission_text(square(-4, 10, 24, 16), square(-40, -40, 4000, 4000), altitude_m=14.0)
    text = text.replace("[flight]", '[flight]\nheight_above = "ground"')
    large = plan_of("large.toml", text + '\n[terrain]\nsource = "autopilot"\n')
    with pytest.raises(LinkError, match=r"lie 115 m apart, more than 100; draw it smaller"):
        _alone(lambda: with_ground(large))
