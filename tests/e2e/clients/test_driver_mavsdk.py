"""`uavmap fly --driver mavsdk` against `uavmap sitl`: real UDP, real HTTP, and MAVSDK's process."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import pytest

from tests.e2e import rig

SPEEDUP = 10.0
BY_MAVSDK = ("--driver", "mavsdk")
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


def children_of(pid: int) -> list[int]:
    numbers = Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii").split()
    return [
        int(number)
        for number in numbers
        if b"mavsdk.driver_child" in Path(f"/proc/{number}/cmdline").read_bytes()
    ]


def has_ended(pid: int) -> bool:
    """Return whether it has ended; a dead process that has not been waited for counts as gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@linux_only
def test_killed_aircraft_process_ends_its_mavsdk_and_the_next_continues(folder):
    with (
        rig.simulator("speck", speedup=SPEEDUP, autopilot="px4") as urls,
        rig.in_flight(urls, folder, SPEEDUP, *BY_MAVSDK) as process,
    ):
        (child,) = children_of(rig.aircraft_process(folder))
        os.kill(rig.aircraft_process(folder), signal.SIGKILL)
        rig.wait_until(lambda: has_ended(child), "the end of MAVSDK")
        done = rig.ended(process)
    done.completed()
    assert "spoken with by MAVSDK v" in done.err
    assert [event["airborne"] for event in rig.events(folder, "connected")] == [False, True]
    assert sum(event["kind"] == "airborne" for event in rig.events(folder)) == 1


@linux_only
def test_control_c_brings_the_vehicle_home_and_ends_all_processes(folder):
    with rig.simulator("speck", speedup=SPEEDUP) as urls:
        with rig.in_flight(urls, folder, SPEEDUP, *BY_MAVSDK) as process:
            (child,) = children_of(rig.aircraft_process(folder))
            os.killpg(process.pid, signal.SIGINT)
            done = rig.ended(process)
        # and the other driver continues
        again = rig.uavmap("resume", folder, "--json", "--driver", "pymavlink")
    again.completed()
    assert "MAVSDK" not in again.err
    assert done.code == 3, done.err
    assert "MAVSDK has ended" not in done.err
    assert "landed" in [event["kind"] for event in rig.events(folder)]
    assert json.loads(done.out)["completed"] is False
    assert has_ended(child)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("fly", "runway", "--sim", "--driver", "mavsdk"), ("virtual time", "uavmap sitl")),
        (("resume", "OVER", "--driver", "mavsdk"), ("virtual time",)),
        (("fly", "runway", "--driver", "dronekit"), ("pymavlink", "mavsdk")),
    ],
)
def test_driver_that_cannot_fly_a_mission_is_refused_with_the_remedy(
    arguments, expected, speck, tmp_path
):
    words = [speck.folder if word == "OVER" else word for word in arguments]
    out = [] if "OVER" in arguments else ["--out", tmp_path / "out"]
    done = rig.uavmap(*words, *out)
    assert done.code == 2
    assert all(text in done.err for text in expected)
    assert not (tmp_path / "out").exists()
