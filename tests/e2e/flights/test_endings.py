"""At any end of a flight over sockets, the aircraft is brought home and the mission continues."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from tests.e2e import rig

SPEEDUP = 20.0
ROOM_BYTES = 8192
"""Room for a file, bytes: a journal with some 20 events of a flight that has over 100."""


def goes_on(folder: Path, urls: list[str]) -> None:
    done = rig.uavmap("resume", folder, "--json", *rig.arguments_of(urls))
    done.completed()


def lines(done: rig.Finished) -> list[str]:
    return [line for line in done.err.splitlines() if line.startswith(("uavmap: ", "vehicle "))]


def test_full_disk_brings_the_vehicle_home_before_the_process_ends(folder):
    with rig.simulator("speck", speedup=SPEEDUP) as urls:
        words = rig.flying(rig.mission("speck"), urls, folder, SPEEDUP)
        with rig.started(*words, room_bytes=ROOM_BYTES) as process:
            done = rig.ended(process)
        assert done.code == 2
        assert done.out == ""
        failed, *left, last = lines(done)
        assert failed.endswith("return (RTL)")
        # on a slow machine its guardian may have to repeat its command
        assert all("it is commanded to" in line for line in left), done.err
        assert "journal.jsonl cannot be written" in last
        assert f"to continue: uavmap resume {folder}" in done.err
        goes_on(folder, urls)
    (first, *_) = rig.events(folder, "connected")[1:]
    assert first["airborne"] is False  # it stood at home when it was resumed


def test_second_interrupt_names_the_place_of_each_aircraft(folder):
    with rig.simulator("speck", speedup=SPEEDUP) as urls:
        with rig.in_flight(urls, folder, SPEEDUP) as process:
            process.send_signal(signal.SIGINT)
            rig.wait_for(folder, "recalled")
            process.send_signal(signal.SIGINT)
            done = rig.ended(process)
        assert done.code == 4
        assert any("left to its autopilot in RTL" in line for line in lines(done)), done.err
        assert f"to continue: uavmap resume {folder}" in done.err
        assert f"the map so far is in {folder}" in done.err
        written = json.loads((folder / "summary.json").read_text("utf-8"))
        assert written["completed"] is False
        assert (folder / "map.geojson").exists()
        assert (folder / "map.png").exists()
        goes_on(folder, urls)


@pytest.mark.parametrize("number", [None, signal.SIGHUP])
def test_terminal_that_is_gone_ends_no_flight_badly(number, folder):
    """Without a signal the flight continues to its end; with one it returns."""
    with rig.simulator("speck", speedup=SPEEDUP) as urls:
        with rig.in_flight(urls, folder, SPEEDUP) as process:
            process.stdout.close()
            process.stderr.close()
            if number is not None:
                process.send_signal(number)
            code = process.wait(rig.PATIENCE_S)
        assert code == (0 if number is None else 3)
        assert rig.events(folder, "landed")
