"""Whole flights with one fault that begins in the search: what it costs, and what is said of it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.events import Connected
from missions.flight.state import Phase
from tests.benchmarks import faults
from tests.benchmarks.watched import flown, mission_text
from tests.support.flights import Flight, fly
from tests.support.running import by
from tests.support.small_missions import EXACT_ATTITUDE
from tests.unit.uavmap.runner.test_single_troubles import serve
from uavmap.mavlink.session import Session
from uavmap.runner.service import Service
from uavmap.runner.vehicles import each_its_own


@pytest.mark.parametrize(
    ("fault", "code", "home", "said"),
    [
        ({"kind": "gps_glitch", "metres": 50.0}, 3, False, ""),
        ({"kind": "motor", "share": 0.0}, 4, False, ""),
        ({"kind": "link", "silent": True, "for_s": 100.0}, 0, True, ""),
        ({"kind": "camera_stall"}, 3, True, ""),
        ({"kind": "camera_black"}, 3, True, "the picture is dark all over"),
        ({"kind": "battery_cell"}, 0, True, ""),
        ({"kind": "companion_reboot", "for_s": 20.0}, 0, True, "answers, in the air and ours"),
        ({"kind": "motor", "share": 0.7}, 0, True, ""),
        ({"kind": "reject", "command": 2000}, 3, True, "MAV_CMD_IMAGE_START_CAPTURE was refused"),
    ],
    ids=lambda value: value["kind"] if isinstance(value, dict) else "",
)
def test_it_ends_honestly(fault: dict[str, Any], code: int, home: bool, said: str) -> None:
    flight = flown(fault["kind"], mission_text("speck", [{**fault, "at_s": 18.0}]), 1)
    assert not faults.forbidden(flight), flight.line()
    assert flight.code == code, flight.line()
    assert ("home" in flight.columns) is home
    assert said in flight.said


def test_what_a_leaning_camera_shows_beside_its_lane_is_no_search_of_it() -> None:
    """A gust blows it 2 m off its lane, and a fixed camera leans: a row of cells is not seen.

    The region that lies there was missed, the lane called searched, and the mission complete.
    """
    gust = {"kind": "wind_gust", "m_s": 12.0, "at_s": 18.0}
    flight = flown("wind_gust", mission_text("speck", [gust]) + EXACT_ATTITUDE, 1)
    assert not faults.forbidden(flight), flight.line()
    assert flight.code == 3, flight.line()
    assert "16 m of search lanes are not judged" in flight.summary["finding"]
    assert "frames do not show the rows of its lanes" in flight.summary["notes"]["1"]


def test_answers_of_the_camera_that_are_lost_for_6_seconds_cost_no_vehicle(tmp_path: Path) -> None:
    async def body(flight: Flight, service: Service) -> None:
        def heard(message: Any) -> bool:
            camera = getattr(message, "command", None) == mav.MAV_CMD_IMAGE_START_CAPTURE
            return not (message.get_type() == "COMMAND_ACK" and camera)

        await flight.until(lambda: service.state.vehicles[1].phase is Phase.AIRBORNE)
        flight.to_driver = heard
        await flight.until(lambda: service.state.vehicles[1].on_lane)
        await asyncio.sleep(6.0)
        flight.to_driver = lambda message: True
        await asyncio.sleep(10.0)
        vehicle = service.state.vehicles[1]
        assert vehicle.phase is Phase.AIRBORNE
        assert vehicle.return_reason is None
        assert vehicle.note == ""

    serve(body, tmp_path)


@by(fly)
async def test_two_links_that_hear_one_aircraft_are_refused(flight: Flight, /) -> None:
    """As behind a router that forwards everything."""
    second = Session(lambda frame: None, lambda frame: None)

    def forwarded(message: Any) -> bool:
        second.feed(bytes(message.get_msgbuf()))
        return True

    flight.to_driver = forwarded
    await asyncio.sleep(3.0)
    views = {"udpin::14551": flight.session.view, "udpin::14552": second.view}
    links: Any = {
        number: SimpleNamespace(name=name, view=view)
        for number, (name, view) in enumerate(views.items(), start=1)
    }
    with pytest.raises(LinkError, match="14551 and udpin::14552 lead to the same aircraft"):
        each_its_own(links)


@by(fly)
async def test_a_vehicle_tells_how_high_its_home_is(flight: Flight, /) -> None:
    """Layers are level by it where homes are not."""
    await flight.sees(Connected)
    (connected,) = flight.seen(Connected)
    assert connected.home_amsl_m == pytest.approx(flight.session.view.home_amsl_m, abs=0.1)
