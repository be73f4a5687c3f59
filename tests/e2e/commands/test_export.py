"""MAVSDK reads the mission that `uavmap export` writes, and the simulator accepts it."""

import json
from pathlib import Path

from tests.e2e.rig import mission, python, simulator
from uavmap.ui.cli import main

CLIENT = Path(__file__).with_name("mavsdk_plan_client.py")
WAYPOINT, RTL, TAKEOFF, SPEED, TRIGGER = 16, 20, 22, 178, 206


def test_mavsdk_uploads_an_exported_mission_and_reads_the_same_back(tmp_path):
    plan, rows = tmp_path / "again.plan", tmp_path / "again.waypoints"
    arguments = ["--plan", str(plan), "--waypoints", str(rows)]
    assert main(["export", mission("speck"), *arguments]) == 0
    with simulator("speck", speedup=12.0) as (url,):
        done = python(CLIENT, url, plan, rows)
    assert done.code == 0, done.out + done.err
    seen = json.loads(done.out.splitlines()[-1])
    commands = [item[0] for item in seen["mission"]]
    assert commands[:3] == [WAYPOINT, TAKEOFF, SPEED]  # MAVSDK puts the home in front
    assert commands[-1] == RTL
    assert set(commands[3:-1]) == {WAYPOINT, TRIGGER}
    ring = json.loads(plan.read_text("utf-8"))["geoFence"]["polygons"][0]["polygon"]
    assert [item[1:3] for item in seen["fence"]] == [
        [round(degrees * 1e7) for degrees in corner] for corner in ring
    ]
    assert seen["mission_back"][1:] == seen["mission"][1:]
    assert seen["fence_back"] == seen["fence"]
    assert seen["rally_back"] == seen["rally"]
    assert len(seen["rally"]) == 1
    assert seen["waypoints"][2:] == seen["mission"][1:]
