"""uavmap and PX4s: in one process, and over real sockets with a pilot who takes over."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.e2e.rig import (
    LOOPBACK,
    Relay,
    arguments_of,
    bodies,
    ended,
    events,
    mission,
    roi_cells,
    simulator,
    started,
    uavmap,
    wait_until,
)

SPEEDUP = 10.0
SLOWER = 5.0
HOLD, RTL = 4 << 16 | 3 << 24, 4 << 16 | 5 << 24


@pytest.fixture
def tiny_px4(tmp_path):
    """The mission `tiny` on a PX4, well above the sea."""
    text = Path(mission("tiny")).read_text("utf-8")
    path = tmp_path / "tiny_px4.toml"
    text = text.replace("[sim]\n", '[sim]\nautopilot = "px4"\n')
    path.write_text(text.replace("[start]\n", "[start]\namsl_m = 1234.5\n"), "utf-8")
    return path


def test_a_mission_in_one_process(tiny, tiny_px4, tmp_path):
    arguments = ("fly", tiny_px4, "--sim", "--seed", 1, "--json", "--out")
    done = [uavmap(*arguments, tmp_path / name) for name in ("one", "two")]
    assert [one.code for one in done] == [0, 0]
    summary = done[0].summary
    assert summary["completed"] is True
    assert (summary["cells_missed"], summary["fence_breaches"]) == (0, 0)
    assert summary["bound_held"] is True
    assert len(roi_cells(tmp_path / "one") ^ roi_cells(tiny.folder)) <= 2
    assert bodies(tmp_path / "one") == bodies(tmp_path / "two")
    log = mavutil.mavlink_connection(str(tmp_path / "one" / "flight.tlog"))
    with contextlib.closing(log.f):
        beat = log.recv_match(type="HEARTBEAT", condition="HEARTBEAT.autopilot!=8")
    assert beat.autopilot == mav.MAV_AUTOPILOT_PX4


def test_two_over_sockets(speck, tmp_path):
    # (slower than the others: on a busy machine one of two once landed away from home)
    with simulator("speck", speedup=SLOWER, vehicles=2, autopilot="px4") as urls:
        arguments = ["--speedup", SLOWER, "--json", "--out", tmp_path / "out", "--vehicles", 2]
        done = uavmap("fly", mission("speck"), *arguments_of(urls), *arguments)
    assert done.code == 0
    assert done.summary["completed"] is True
    assert len(roi_cells(tmp_path / "out") ^ roi_cells(speck.folder)) <= 2


def test_a_pilot_takes_over_and_gives_back(speck, tmp_path):
    """A second client changes the mode: not a command more until the vehicle is put into Hold."""
    folder = tmp_path / "out"
    kinds = [event["kind"] for event in events(speck.folder)]
    with (
        simulator("speck", speedup=SPEEDUP, autopilot="px4") as (url,),
        Relay(int(url.rpartition(":")[2])) as relay,
    ):
        wait_until(lambda: relay.vehicle is not None, "the vehicle's address")
        pilot = mavutil.mavlink_connection(
            f"udpout:{LOOPBACK}:{relay.vehicle[1]}", source_system=250, dialect="ardupilotmega"
        )
        arguments = ["--connect", relay.url, "--speedup", SPEEDUP, "--json", "--out", folder]
        try:
            with started("fly", mission("speck"), *arguments) as process:
                begun = kinds.index("look_ended") if "look_ended" in kinds else len(kinds) // 2
                wait_until(lambda: len(bodies(folder)) >= begun, "the exploration")
                set_mode(pilot, RTL)
                wait_until(lambda: bool(events(folder, "overridden")), "the service to notice")
                said = len(relay.commands)
                for _ in range(4):
                    assert heartbeat(pilot).custom_mode == RTL
                # what ends a series of pictures goes to the camera, and may come late
                late = [str(c) for c in relay.commands[said:]]
                assert [c for c in late if "command : 2001," not in c] == []
                set_mode(pilot, HOLD)
                done = ended(process)
        finally:
            pilot.close()
    assert done.code == 0
    assert done.summary["completed"] is True
    assert [event["mode"] for event in events(folder, "overridden")] == ["RTL"]
    assert len(events(folder, "released")) == 1
    assert len(roi_cells(folder) ^ roi_cells(speck.folder)) <= 2


def set_mode(pilot, mode):
    """Change the mode as a ground station does, until the heartbeat shows it."""
    for _ in range(20):
        pilot.set_mode_px4(1, mode >> 16 & 0xFF, mode >> 24)
        beat = heartbeat(pilot)
        if beat is not None and beat.custom_mode == mode:
            return
    raise AssertionError(f"the vehicle does not change to mode {mode}")


def heartbeat(pilot):
    """The next one of the autopilot."""
    while True:
        beat = pilot.recv_match(type="HEARTBEAT", blocking=True, timeout=2.0)
        if beat is None or beat.autopilot == mav.MAV_AUTOPILOT_PX4:
            return beat
