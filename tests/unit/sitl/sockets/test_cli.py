from __future__ import annotations

import json
import signal
import subprocess

import pytest
from pymavlink import mavutil

from sitl.sockets.server import free_ports
from tests.e2e.rig import command, environment
from uavmap.ui.cli import main

HOME = "47.4,8.5,488,90"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--autopilot inav", "there is ardupilot, px4"),
        (f"--home {HOME} --autopilot inav", "there is ardupilot, px4"),
        ("--home here", "LAT,LON,AMSL,YAW"),
        ("--home 95,8", "latitude"),
        ("--home 47,8,nan", "LAT,LON,AMSL,YAW"),
        ("--home 47,8,99999", "above sea level"),
        (f"--home {HOME} --mission runway", "--home: excludes --mission"),
        ("--mission runway --wind 3,90", "--wind: excludes --mission"),
        ("--world a.geojson", "--world: needs --home"),
        ("--optical-flow", "--optical-flow: needs --home"),
        ("--world-crs 32632", "--world-crs: needs --home"),
        (f"--home {HOME} --wind 3", "SPEED,FROM"),
        (f"--home {HOME} --wind 300,0", "0 to 40 m/s"),
        (f"--home {HOME} --world nowhere.geojson", "nowhere.geojson: No such file"),
        (f"--home {HOME} --world nowhere.png", "nowhere.png: no such file"),
        ("--mission nowhere", "nowhere"),
    ],
)
def test_errors_are_one_line(arguments, message, capsys):
    assert main(["sitl", *arguments.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("uavmap: ")
    assert message in line


@pytest.mark.parametrize("tcp", [False, True])
def test_vehicles_without_a_mission_are_served(tmp_path, tcp):
    d = 2e-4
    ring = [[8.5, 47.4], [8.5 + d, 47.4], [8.5 + d, 47.4 + d], [8.5, 47.4]]
    world = tmp_path / "a.geojson"
    world.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    port, http_port = free_ports(3, tcp=tcp)
    arguments = ["sitl", "--home", HOME, "--vehicles", 3, "--speedup", 20, "--wind", "2,90"]
    arguments += ["--world", world, "--port", port, "--http-port", http_port]
    process = subprocess.Popen(
        command(*arguments, *(["--tcp"] if tcp else [])),
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        urls = [process.stdout.readline().strip() for _ in range(3)]
        kind = "tcpout" if tcp else "udpin"
        assert urls == [f"{kind}://127.0.0.1:{port + 10 * i}" for i in range(3)]
        for number, url in enumerate(urls, start=1):
            address = url.replace("tcpout://", "tcp:").replace("udpin://", "udpin:")
            link = mavutil.mavlink_connection(address)
            assert link.wait_heartbeat(timeout=120).get_srcSystem() == number
            link.close()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, out) == (0, "")
    first, fly, station, proxy, _, ends, last = err.splitlines()
    assert first.startswith("3 simulated aircraft, ")
    connect = [f"--connect {url}" for url in urls]
    assert fly.endswith(" ".join(["uavmap fly FILE", *connect, "--speedup 20"]))
    assert str(port) in station
    assert f"--master={address.removesuffix(str(port + 20))}{port}" in proxy
    assert (ends, last) == ("Ctrl-C ends the simulation", "uavmap: simulation ended")
