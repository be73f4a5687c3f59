from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Packer
from tests.support.hostile import Hostile, bombard, condition

SIZE = 400_000


def answers(client):
    client.vehicle.receive(bytes(300))  # ends a frame that garbage may have begun
    client.run(1.0)
    messages = client.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return "AUTOPILOT_VERSION" in [m.get_type() for m in messages]


# in the air garbage with the right address would fly it
@pytest.mark.parametrize(("at", "addressed"), [("flying", False), ("ready", True)])
def test_garbage_does_no_harm(request, at, addressed):
    client = request.getfixturevalue(at)
    outcome = bombard(client.vehicle, SIZE, seed=1 + addressed, well_addressed=addressed)
    assert outcome.crashes == []
    assert outcome.changes == []
    assert outcome.grown_bytes < 100_000
    assert sum(outcome.sent.values()) >= SIZE
    assert answers(client)


@pytest.mark.parametrize("wrong_target", [True, False])
def test_every_message_type_does_no_harm(ready, wrong_target):
    before = condition(ready.vehicle)
    for seed in range(8):
        for frame in Hostile(seed).every_type(wrong_target):
            ready.vehicle.receive(frame)
        ready.vehicle.step(0.1)
    assert condition(ready.vehicle) == before
    assert answers(ready)


def test_bytes_one_at_a_time_give_the_same_answers(make_client):
    whole, bits = make_client(), make_client()
    packer = Packer(255, 190)
    data = b"".join(
        [b"\xfd\x00", packer.pack(mav.MAVLink_timesync_message(0, 5)), b"noise\xfe\x09"] * 5
    )
    together = whole.vehicle.receive(data)
    assert b"".join(bits.vehicle.receive(data[i : i + 1]) for i in range(len(data))) == together


def test_garbage_on_a_bad_and_signed_link_does_no_harm(ready):
    ready.send(mav.MAVLink_setup_signing_message(1, 1, [7] * 32, 10))
    ready.vehicle.fail.link(0.1, 0.1, 0.1, 0.05, 0.1, 0.1)
    outcome = bombard(ready.vehicle, SIZE // 4, seed=3, well_addressed=True)
    assert (outcome.crashes, outcome.changes) == ([], [])
