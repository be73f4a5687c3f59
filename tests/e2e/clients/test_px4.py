"""uavmap and PX4s: in one process, and two over real sockets."""

import contextlib
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.e2e import rig

SLOWER = 5.0


@pytest.fixture
def speck_px4(tmp_path):
    text = Path(rig.mission("speck")).read_text("utf-8")
    path = tmp_path / "speck_px4.toml"
    text = text.replace("[sim]\n", '[sim]\nautopilot = "px4"\n')
    path.write_text(text.replace("[start]\n", "[start]\namsl_m = 1234.5\n"), "utf-8")
    return path


def test_px4_mission_in_one_process_repeats(speck, speck_px4, tmp_path):
    one, _ = (rig.fly(speck_px4, tmp_path / name) for name in ("one", "two"))
    assert one.complete()["bound_held"] is True
    assert rig.maps_alike(tmp_path / "one", speck.folder)
    assert rig.bodies(tmp_path / "one") == rig.bodies(tmp_path / "two")
    log = mavutil.mavlink_connection(str(tmp_path / "one" / "flight.tlog"))
    with contextlib.closing(log.f):
        beat = log.recv_match(type="HEARTBEAT", condition="HEARTBEAT.autopilot!=8")
    assert beat.autopilot == mav.MAV_AUTOPILOT_PX4


def test_two_px4_over_sockets_complete(speck, tmp_path):
    # (slower than the others: on a busy machine one of two once landed away from home)
    with rig.simulator("speck", speedup=SLOWER, vehicles=2, autopilot="px4") as urls:
        words = rig.flying(rig.mission("speck"), urls, tmp_path / "out", SLOWER, "--vehicles", 2)
        done = rig.uavmap(*words)
    done.completed()
    assert rig.maps_alike(tmp_path / "out", speck.folder)
