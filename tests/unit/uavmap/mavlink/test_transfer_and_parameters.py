"""Parameters, fences and rally points over the wire, in both flavours."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError
from missions.units import LatLon
from tests.support.field import BOTH, Field, mission_of, on_field
from tests.support.running import by
from uavmap.mavlink.mission_transfer import Item, Kind, MissionTransfer, same_items
from uavmap.mavlink.parameters import Parameter, Parameters
from uavmap.mavlink.session import Session

INCLUSION = mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION


def ring(count: int) -> tuple[Item, ...]:
    return tuple(
        Item(INCLUSION, LatLon(48.0 + 0.0001 * (i % 2), 11.0 + 0.0001 * i), float(count))
        for i in range(count)
    )


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_a_fence_comes_back_as_it_was_sent(field: Field, /, autopilot: str) -> None:
    transfer = MissionTransfer(field.links[0].session)
    assert await transfer.download(Kind.FENCE) == ()
    await transfer.upload(Kind.FENCE, ring(7))
    assert same_items(ring(7), await transfer.download(Kind.FENCE))
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 7
    await transfer.upload(Kind.FENCE, ())
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 0


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_a_link_that_loses_a_fifth_of_its_frames_carries_it_too(
    field: Field, /, autopilot: str
) -> None:
    chance = random.Random(1)
    field.lose = lambda: chance.random() < 0.2
    transfer = MissionTransfer(field.links[0].session)
    await transfer.upload(Kind.FENCE, ring(12))
    assert same_items(ring(12), await transfer.download(Kind.FENCE))


@by(on_field, lambda: mission_of("ardupilot"))
async def test_a_fence_that_the_vehicle_refuses_says_why(field: Field, /) -> None:
    transfer = MissionTransfer(field.links[0].session)
    (first, *rest) = ring(4)
    nowhere = Item(INCLUSION, LatLon(95.0, 11.0), 4.0)
    with pytest.raises(CommandRefusedError, match="the fence were not taken: invalid param5"):
        await transfer.upload(Kind.FENCE, (first, nowhere, *rest[1:]))


@pytest.mark.parametrize(
    ("autopilot", "whole", "real"),
    [("ardupilot", "FENCE_ACTION", "FENCE_ALT_MAX"), ("px4", "GF_ACTION", "GF_MAX_VER_DIST")],
)
@by(on_field, mission_of)
async def test_parameters_are_read_in_bunches_and_written(
    field: Field, /, autopilot: str, whole: str, real: str
) -> None:
    parameters = Parameters(field.links[0].session)
    names = [whole, real, "NO_SUCH_NAME"]
    found = await parameters.read_many(names)
    assert set(found) == {whole, real}
    assert found[whole].value == field.parameter(0, whole)
    for value in (4.0, 0.0):
        assert await parameters.write(whole, Parameter(value, found[whole].type))
        assert field.parameter(0, whole) == value
    assert await parameters.write(real, Parameter(31.5, found[real].type))
    assert field.parameter(0, real) == 31.5
    assert not await parameters.write("NO_SUCH_NAME", Parameter(1.0, 9))


@by(on_field, lambda: mission_of("px4"))
async def test_a_negative_integer_of_a_px4_is_no_number_on_the_wire_and_is_read(
    field: Field, /
) -> None:
    parameters = Parameters(field.links[0].session)
    assert await parameters.write("COM_TAKEOFF_ACT", Parameter(-1.0, 6))
    found = await parameters.read("COM_TAKEOFF_ACT")
    assert found == Parameter(-1.0, 6)


@by(on_field, lambda: mission_of("ardupilot"))
async def test_a_ground_station_that_reads_the_fence_meanwhile_does_not_disturb(
    field: Field, /, tmp_path: Path
) -> None:
    session: Session = field.links[0].session
    transfer = MissionTransfer(session)
    await transfer.upload(Kind.FENCE, ring(5))
    stranger = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    count = mav.MAVLink_mission_count_message(255, 190, 99, mav.MAV_MISSION_TYPE_FENCE)
    frame = count.pack(stranger)
    session.listen(lambda m: m.get_type() == "MISSION_COUNT" and session.feed(b""))
    session.feed(frame)
    assert same_items(ring(5), await transfer.download(Kind.FENCE))
