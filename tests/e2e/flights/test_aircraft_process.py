"""If the mission process or the process of the aircraft dies or stalls, no aircraft is left alone.

After a kill -9 of a single-process program, a real ArduCopter and a real PX4 were still armed, 12 m
up, 300 s later.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e import rig
from tests.e2e.preloaded import Process

SPEEDUP = 10.0
STREAMED = 3.0
"""Highest speed at which setpoints are streamed, times real time."""
FRAMES = 12
SPECK = rig.mission("speck")


@pytest.fixture
def patient(tmp_path: Path) -> Path:
    """Return a mission whose aircraft wait for two seconds for another mission process."""
    path = tmp_path / "patient.toml"
    text = Path(SPECK).read_text("utf-8")
    path.write_text(text + "\n[guardian]\norphan_hold_s = 2.0\n", "utf-8")
    return path


@contextlib.contextmanager
def searching(
    folder: Path, source: Path | str = "speck", autopilot: str = "ardupilot"
) -> Iterator[tuple[Process, list[str]]]:
    with (
        rig.simulator("speck", speedup=SPEEDUP, autopilot=autopilot) as urls,
        rig.in_flight(
            urls, folder, SPEEDUP, "--auto-swap", source=source, frames=FRAMES
        ) as process,
    ):
        yield process, urls


def killed(process: Process) -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate()


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_mission_process_that_dies_leaves_no_vehicle_in_the_air(autopilot, patient, folder):
    with searching(folder, patient, autopilot) as (process, _):
        killed(process)
        rig.wait_until(lambda: not (folder / "aircraft.json").exists(), "the aircraft to be home")
        before = len(rig.events(folder))
        done = rig.uavmap("resume", folder, "--json")
    done.completed()
    alone = rig.events(folder)[before:]
    guarded = next(event for event in alone if event["kind"] == "guarded")
    assert guarded["reason"] == "the mission process has ended"
    landed = next(event for event in alone if event["kind"] == "landed")
    east_m, north_m = landed["position"]
    assert max(abs(east_m), abs(north_m)) < 5.0
    assert "meanwhile: " in done.err
    assert not (folder / "aircraft.log").exists()


def test_control_c_while_the_aircraft_are_brought_home_names_them(patient, folder):
    with searching(folder, patient) as (process, _):
        killed(process)
        record = folder / "aircraft.log"
        rig.wait_until(
            lambda: record.exists() and b'"guarded"' in record.read_bytes(), "the return"
        )
        with rig.started("resume", folder, "--json") as waiting:
            assert "the flight goes on when that is done" in waiting.stderr.readline()
            waiting.send_signal(signal.SIGINT)
            done = rig.ended(waiting)
        assert done.code == 4, done.err
        assert "interrupted; the mission process has ended: the vehicles return" in done.err
        assert "vehicle 1: left to its autopilot in " in done.err
        rig.wait_until(lambda: not (folder / "aircraft.json").exists(), "the aircraft to be home")


def test_next_process_takes_over_the_aircraft_in_the_air(folder):
    with searching(folder) as (process, _):
        aircraft = rig.aircraft_process(folder)
        killed(process)
        with rig.started("resume", folder, "--json") as process:
            rig.wait_for(folder, "resumed")
            assert rig.aircraft_process(folder) == aircraft
            done = rig.ended(process)
    done.completed()
    assert not rig.events(folder, "guarded")
    assert len(rig.events(folder, "landed")) == 1  # it never landed in between


def test_process_of_the_aircraft_that_dies_is_started_again(folder):
    with searching(folder) as (process, _):
        os.kill(rig.aircraft_process(folder), signal.SIGKILL)
        done = rig.ended(process)
    done.completed()
    assert "the process of the aircraft has died; it is started again" in done.err
    assert [event["airborne"] for event in rig.events(folder, "connected")] == [False, True]
    assert len(rig.events(folder, "landed")) == 1


def test_aircraft_that_cannot_be_started_again_are_named(folder):
    with (
        searching(folder) as (process, urls),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        process.send_signal(signal.SIGSTOP)
        os.kill(rig.aircraft_process(folder), signal.SIGKILL)
        address = (rig.LOOPBACK, int(urls[0].rsplit(":", 1)[1]))
        rig.wait_until(lambda: _binds(other, address), "the vehicle's port")
        process.send_signal(signal.SIGCONT)
        done = rig.ended(process)
    assert done.code == 4, done.err
    assert "vehicle 1: left to its autopilot in GUIDED at 47.3" in done.err
    assert "take it by radio control" in done.err
    (down,) = json.loads((folder / "summary.json").read_text("utf-8"))["aircraft_down"]
    assert down.startswith("vehicle 1 near 47.3")


def _binds(port: socket.socket, address: tuple[str, int]) -> bool:
    with contextlib.suppress(OSError):
        port.bind(address)
    return port.getsockname()[1] == address[1]


def test_sigterm_to_the_process_of_the_aircraft_calls_all_home(folder):
    with searching(folder) as (process, _):
        os.kill(rig.aircraft_process(folder), signal.SIGTERM)
        done = rig.ended(process)
    assert done.code == 3, done.err
    assert "the process of the aircraft is asked to end: coming home, landing" in done.err
    assert len(rig.events(folder, "recalled")) == len(rig.events(folder, "landed")) == 1
    assert not rig.events(folder, "guarded")
    assert not (folder / "aircraft.log").exists()


def test_control_c_while_the_process_of_the_aircraft_starts_leaves_none_behind(folder):
    port, _ = rig.free_ports(1)
    url = f"udpin://{rig.LOOPBACK}:{port}"
    with rig.started(*rig.flying(SPECK, [url], folder, SPEEDUP, "--auto-swap")) as process:
        rig.wait_until((folder / "aircraft.json").exists, "the process of the aircraft")
        aircraft = rig.aircraft_process(folder)
        process.send_signal(signal.SIGINT)
        done = rig.ended(process)
    assert done.code == 130, done.err
    with pytest.raises(ProcessLookupError):
        os.kill(aircraft, 0)


def test_setpoints_continue_while_the_mission_process_stands_still(tmp_path):
    folder, passing = tmp_path / "out", ("--auto-swap", "--strategy", "swath")
    with (
        rig.simulator("speck", speedup=STREAMED) as urls,
        rig.Relay(int(urls[0].rsplit(":", 1)[1])) as relay,
        rig.in_flight([relay.url], folder, STREAMED, *passing, frames=FRAMES) as process,
    ):
        process.send_signal(signal.SIGSTOP)
        try:
            sent = _setpoints(relay)
            # two seconds of setpoints, ten a second, without a plan
            rig.wait_until(lambda: _setpoints(relay) >= sent + 20, "setpoints")
        finally:
            process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGINT)
        done = rig.ended(process)
    assert done.code == 3, done.err
    assert not rig.events(folder, "guarded", "link_lost")
    assert len(rig.events(folder, "landed")) == 1


def _setpoints(relay: rig.Relay) -> int:
    return sum("SET_POSITION_TARGET_GLOBAL_INT" in text for text in list(relay.commands))
