"""Folders of results for the tests of reports and files: a small recorded flight, or part of it."""

import json
from dataclasses import replace

import cv2
import numpy as np

from missions.classes import ClassShare
from missions.events import AutopilotText, FrameLost, FrameSeen, OrderFailed, from_json
from missions.units import LatLon, Pose, Quaternion
from tests.golden.recording import STOPS
from tests.support.journals import begun
from tests.support.plans import named_text, plan_of
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.journal.kept_frames import FrameKeeper, KeptFrame
from uavmap.load.mission_source import mission_of_text

SOURCE = named_text(STOPS.mission)
PLAN = plan_of(
    "golden.toml", SOURCE.text, STOPS.strategy, None, STOPS.seed, (), None, SIM_EPOCH_UTC_S
)
EVENTS = [from_json(line) for line in STOPS.lines()]
"""Events of two sorties with a fresh battery between them, in a simulator."""
EVIL = '<script>alert("1")</script><img src=x onerror=alert(2)> & \'"'
SWAPPED_S = 91.0


CLASSES = """
[detector]
name = "color"

[detector.color.samples]
"wet & <dry>" = [[9, 9, 9]]
rest = [[99, 9, 9]]

[detector.classes]
"wet & <dry>" = {number = 4, thickness_um = [1.0, 2.0]}
rest = {number = 2}
"""
CLASS_NAMES = ("rest", "wet & <dry>")


def seen_by_class(event):
    """Return an event whose frame sees even columns as one class, and odd columns as two."""
    if not isinstance(event, FrameSeen):
        return event
    found = []
    for vote in event.votes:
        parts = ((4, 1.0),) if vote.cell.east % 2 == 0 else ((2, 0.7), (4, 0.3))
        found += [
            ClassShare(vote.cell, number, round(part * vote.share, 3))
            for number, part in parts
            if vote.share
        ]
    return replace(event, classes=tuple(found) or None)


CLASS_PLAN = replace(PLAN, mission=mission_of_text(f"{SOURCE.text}\n{CLASSES}", "classes.toml"))
CLASS_EVENTS = [seen_by_class(event) for event in EVENTS]


def folder_of(tmp, events=EVENTS, plan=PLAN, **meta):
    return begun(tmp / "flown", plan, events, **meta)


def named(name):
    text = SOURCE.text.replace('name = "golden"', f"name = {json.dumps(name)}")
    return replace(PLAN, mission=mission_of_text(text, "golden.toml"))


def with_troubles(events=EVENTS):
    found = list(events)
    t_s = found[-1].t_s
    return [
        *found,
        *(FrameLost(1, t_s, EVIL) for _ in range(3)),
        OrderFailed(1, t_s, "Sweep", f"refused: {EVIL}"),
        AutopilotText(1, t_s, 2, EVIL),
        AutopilotText(1, t_s, 6, "for debugging"),
    ]


def keep_frames(folder, events=EVENTS):
    """Keep small pictures for the judged frames of a folder, at places all over the start."""
    picture = np.full((48, 64, 3), (60, 120, 200), dtype=np.uint8)
    data = cv2.imencode(".jpg", picture)[1].tobytes()
    pose = Pose(LatLon(47.30011, 8.50013), 12.0, Quaternion.from_euler(0.0, -1.5707963, 0.0))
    with FrameKeeper(folder, print) as keeper:
        for event in events:
            if event.kind == "frame_seen":
                keeper.keep(KeptFrame("", event.vehicle, event.t_s, pose, 80.0), data)
