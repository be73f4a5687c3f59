"""The streams that a mission asks for: how often mode and state are heard."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from tests.support.field import BOTH, Field, mission_of, on_field
from tests.support.running import by
from uavmap.aircraft.telemetry_streams import Streams


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_streams_vehicle_that_refuses_one_needs_no_new_request(
    field: Field, /, autopilot: str
) -> None:
    """An older PX4 has no CURRENT_MODE: its link returns without all streams asked for anew."""
    session = field.links[0].session
    rates = {**session.view.kind.streams, 12_900: 5.0}  # an identifier that nobody sends
    streams = Streams("sim", session, rates)
    await streams.ask(lambda: True)
    await asyncio.sleep(6.0)
    assert streams.go_on


@by(on_field, lambda: mission_of("ardupilot"))
async def test_heartbeat_of_ardupilot_is_heard_at_5_hz(field: Field, /) -> None:
    session, beats = field.links[0].session, []

    def hear(message: Any) -> None:
        if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1:
            beats.append(message)

    await Streams("sim", session).ask(lambda: True)
    session.listen(hear)
    await asyncio.sleep(4.0)
    assert len(beats) >= 18
