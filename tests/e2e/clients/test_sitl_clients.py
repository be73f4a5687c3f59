"""Unmodified clients on real sockets: MAVSDK, pymavlink, MAVProxy.

MAVProxy is the one that `make setup` puts beside the interpreter, or that UAVMAP_MAVPROXY names.
"""

import contextlib
import json
import math
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.scenario import Setup
from sitl.testing import Fleet
from tests.e2e.rig import PATIENCE_S, python

HERE = Path(__file__).parent
SPEEDUP = 8.0
MAVPROXY = os.environ.get("UAVMAP_MAVPROXY") or shutil.which(
    "mavproxy.py", path=Path(sys.executable).parent
)
needs_mavproxy = pytest.mark.skipif(
    MAVPROXY is None,
    reason="no mavproxy.py beside the interpreter (`make setup`), and UAVMAP_MAVPROXY names none",
)


@contextlib.contextmanager
def vehicle(*, tcp=False, **setup):
    fleet = Fleet(Setup(speedup=SPEEDUP, tcp=tcp, **setup))
    fleet.run(6.0)
    try:
        yield fleet[0]
    finally:
        fleet.close()


def pymavlink_address(url):
    return url.replace("tcpout://", "tcp:").replace("udpin://", "udpin:")


SEEN = {"int": 3, "float": 8.0, "same": True, "fence": 4}
FLOWN = {
    ("ardupilot", "udp"): {**SEEN, "download": [16, 22, 16, 20]},
    ("px4", "tcp"): {
        **SEEN, "download": [22, 16, 20], "offboard_height_m": pytest.approx(10.0, abs=1.5),
    },
}  # fmt: skip
"""Observations that MAVSDK must make, by autopilot and transport."""


@pytest.mark.parametrize(("autopilot", "transport"), FLOWN)
def test_mavsdk_flies_by_all_that_it_offers(autopilot, transport):
    with vehicle(tcp=transport == "tcp", autopilot=autopilot) as sitl:
        done = python(HERE / "mavsdk_client.py", sitl.url, autopilot)
        assert done.code == 0, done.out + done.err
        assert sitl.truth.landed
        assert not sitl.truth.armed
    seen = json.loads(done.out.splitlines()[-1])
    expected = FLOWN[autopilot, transport]
    assert {name: seen.get(name) for name in expected} == expected
    assert seen["parameters"] > (50 if autopilot == "ardupilot" else 40)
    assert seen["back_m"] < 1.5


@pytest.mark.parametrize(
    ("autopilot", "tcp", "hover", "parameter", "kind"),
    [
        ("ardupilot", True, "GUIDED", "RTL_ALT", mav.MAV_PARAM_TYPE_INT32),
        ("px4", False, "LOITER", "RTL_RETURN_ALT", mav.MAV_PARAM_TYPE_REAL32),
    ],
)
def test_pymavlink_flies_by_its_own_tables(autopilot, tcp, hover, parameter, kind):
    """Modes by name, a parameter by its type, a take-off, and a return."""
    with vehicle(tcp=tcp, autopilot=autopilot) as sitl:
        link = mavutil.mavlink_connection(pymavlink_address(sitl.url), dialect="ardupilotmega")
        with contextlib.closing(link):
            link.wait_heartbeat(timeout=PATIENCE_S)
            link.param_set_send(parameter, 20.0, kind)
            told = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=PATIENCE_S)
            assert (told.param_id, told.param_value) == (parameter, 20.0)
            set_mode = link.set_mode_apm
            if autopilot == "px4":
                set_mode = partial(link.set_mode_px4, custom_mode=0, custom_sub_mode=0)
            set_mode(hover)
            link.mav.command_long_send(1, 1, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, *[0] * 6)
            sitl.until(lambda: sitl.truth.armed)
            height_m = 8.0 if autopilot == "ardupilot" else 496.0  # a PX4's are above the sea
            nan = math.nan
            link.mav.command_long_send(
                1, 1, mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, nan, nan, nan, height_m
            )
            sitl.until(lambda: sitl.truth.height_m > 4.0)  # its own height may err by metres
            set_mode("RTL")
            sitl.until(lambda: sitl.truth.landed and not sitl.truth.armed, timeout_s=200.0)


class MavProxy:
    def __init__(self, url, folder):
        self._process = subprocess.Popen(
            [MAVPROXY, f"--master={pymavlink_address(url)}", f"--aircraft={folder / 'aircraft'}"],
            cwd=folder,
            # unbuffered: its output into a pipe would else wait until there are 8 kB of it
            env={**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._lines = queue.Queue()
        self.lines = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            self._lines.put(line.rstrip())
        self._lines.put(None)

    def type_line(self, text):
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()

    def wait_for(self, text):
        end_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, end_s - time.monotonic()))
            except queue.Empty:
                line = None
            if line is None:  # it has taken too long, or has ended
                pytest.fail(f"MAVProxy did not say {text!r} but:\n" + "\n".join(self.lines))
            self.lines.append(line)
            if text in line:
                return line

    def close(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._reader.join()
        self._process.stdout.close()


MISSION = """QGC WPL 110
0\t0\t0\t16\t0\t0\t0\t0\t47.397742\t8.545594\t488\t1
1\t0\t3\t22\t0\t0\t0\t0\t47.397742\t8.545594\t8\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.397900\t8.545594\t8\t1
3\t0\t3\t20\t0\t0\t0\t0\t0\t0\t0\t1
"""


@needs_mavproxy
def test_mavproxy_flies_a_mission(tmp_path):
    (tmp_path / "mission.txt").write_text(MISSION)
    # for a client that a slow machine delays, much of the vehicle's time passes
    with (
        vehicle(tcp=False, battery_wh=5000.0) as sitl,
        contextlib.closing(MavProxy(sitl.url, tmp_path)) as proxy,
    ):
        proxy.wait_for("Detected vehicle 1:1")
        proxy.wait_for("parameters to")  # all of them, saved
        proxy.type_line("mode guided")
        proxy.wait_for("Mode GUIDED")
        proxy.type_line("arm throttle")
        proxy.wait_for("ARMED")
        proxy.type_line("takeoff 8")
        proxy.wait_for("NAV_TAKEOFF: ACCEPTED")
        sitl.until(lambda: sitl.truth.height_m > 7.0)
        proxy.type_line("param set RTL_ALT 1200")
        for _ in range(2000):  # it shows the old value until the new one is confirmed
            proxy.type_line("param show RTL_ALT")
            if "1200" in proxy.wait_for("RTL_ALT "):
                break
        else:
            pytest.fail("the parameter was not set")
        proxy.type_line("guided 47.397742 8.5457 10")
        proxy.wait_for("DO_REPOSITION: ACCEPTED")
        sitl.until(lambda: abs(sitl.truth.position.lon_deg - 8.5457) < 3e-5)
        proxy.type_line(f"wp load {tmp_path / 'mission.txt'}")
        proxy.wait_for("MISSION_ACK: TYPE_MISSION: ACCEPTED")
        proxy.type_line("wp list")
        proxy.wait_for("Requesting 4 waypoints")
        proxy.wait_for("Saved 4 waypoints")
        proxy.type_line("mode rtl")
        proxy.wait_for("Mode RTL")
        proxy.wait_for("DISARMED")
        assert sitl.truth.landed
        assert not any("breach" in line.lower() for line in proxy.lines)
