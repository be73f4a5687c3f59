"""`uavmap sitl` in one process, `uavmap fly --connect` in another: real UDP, real HTTP."""

import json
import signal

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.e2e import rig

SPEEDUP = 20.0
GUIDED, BRAKE = 4, 17


def in_mid_flight(speck):
    kinds = [event["kind"] for event in rig.events(speck.folder)]
    return kinds.index("look_ended") if "look_ended" in kinds else len(kinds) // 2


def test_recall_brings_vehicles_home_and_sends_none_out(speck, folder):
    """A computer on board may do this by itself after a restart."""
    with rig.simulator("speck", speedup=SPEEDUP) as urls:
        count, words = in_mid_flight(speck), rig.flying(rig.mission("speck"), urls, folder, SPEEDUP)
        with rig.started(*words, stops_at=count) as process:
            rig.stop_after(process, folder, count, signal.SIGKILL)
        home = rig.uavmap("resume", folder, "--recall", "--json")
        again = rig.since_resumed(folder)
        assert home.code == 3
        assert [event["kind"] for event in again[:2]] == ["resumed", "recalled"]
        assert next(e for e in again if e["kind"] == "connected")["airborne"] is True
        assert sum(event["kind"] == "landed" for event in again) == 1
        # on the ground by now: after the second recall it stays there
        before = len(rig.bodies(folder))
        assert rig.uavmap("resume", folder, "--recall", "--json").code == 3
        again = rig.events(folder)[before:]
        assert next(e for e in again if e["kind"] == "connected")["airborne"] is False
        assert not any(event["kind"] == "airborne" for event in again)
    assert (folder / "map.geojson").exists()


def test_simulated_flight_is_not_recalled(speck):
    done = rig.uavmap("resume", speck.folder, "--recall")
    assert done.code == 2
    assert "--recall is for aircraft at the end of a link" in done.err


def test_pilot_takes_over_and_gives_back(speck, folder):
    """A second client changes the mode: no command follows until the vehicle is given back."""
    with (
        rig.simulator("speck", speedup=SPEEDUP) as (url,),
        rig.Relay(int(url.rpartition(":")[2])) as relay,
    ):
        rig.wait_until(lambda: relay.vehicle is not None, "the vehicle's address")
        pilot = mavutil.mavlink_connection(
            f"udpout:{rig.LOOPBACK}:{relay.vehicle[1]}", source_system=250, dialect="ardupilotmega"
        )
        arguments = rig.flying(rig.mission("speck"), [relay.url], folder, SPEEDUP)
        try:
            with rig.started(*arguments) as process:
                rig.wait_until(
                    lambda: len(rig.bodies(folder)) >= in_mid_flight(speck), "the exploration"
                )
                _set_mode(pilot, BRAKE)  # in LOITER it would sink: there is no radio control
                rig.wait_for(folder, "overridden")
                said, seen = len(relay.commands), len(rig.events(folder, "frame_seen"))
                for _ in range(15):  # simulated seconds
                    assert _beat(pilot).custom_mode == BRAKE
                # the end of a capture concerns the camera, not the vehicle
                assert [c for c in relay.commands[said:] if not _stops_camera(c)] == []
                # a picture from before may be judged after it
                assert len(rig.events(folder, "frame_seen")) <= seen + 1
                assert rig.events(folder, "released") == []
                _set_mode(pilot, GUIDED)
                done = rig.ended(process)
        finally:
            pilot.close()
    done.completed()
    assert len(rig.events(folder, "released")) == 1
    assert [event["mode"] for event in rig.events(folder, "overridden")] == ["BRAKE"]
    after = rig.bodies(folder).index(
        json.dumps(rig.events(folder, "released")[0], separators=(",", ":"))
    )
    looks = [e for e in rig.events(folder)[after:] if e["kind"] == "frame_seen"]
    assert len(looks) > 2  # it has resumed its work
    assert rig.maps_alike(folder, speck.folder)


def _stops_camera(command):
    return (
        f"target_component : {mav.MAV_COMP_ID_CAMERA}," in command
        and f"command : {mav.MAV_CMD_IMAGE_STOP_CAPTURE}," in command
    )


def _set_mode(pilot, mode):
    for _ in range(20):
        pilot.mav.command_long_send(
            1, 1, mav.MAV_CMD_DO_SET_MODE, 0, mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode,
            0, 0, 0, 0, 0,
        )  # fmt: skip
        beat = _beat(pilot)
        if beat is not None and beat.custom_mode == mode:
            return
    raise AssertionError(f"the vehicle does not change to mode {mode}")


def _beat(pilot):
    while True:
        beat = pilot.recv_match(type="HEARTBEAT", blocking=True, timeout=2.0)
        if beat is None or beat.autopilot != mav.MAV_AUTOPILOT_INVALID:
            return beat
