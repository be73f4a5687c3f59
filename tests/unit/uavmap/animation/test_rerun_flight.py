"""`fly --rerun` with a stand-in for rerun-sdk, which notes what is logged; whatever it does, the
flight goes on. With the SDK itself `tests/e2e/test_animate.py` writes a recording."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from missions.events import from_json
from missions.state import State
from missions.units import LatLon, Pose, Quaternion
from tests.golden.recording import STOPS
from tests.plans import named_text, plan_of
from uavmap.animation import rerun_flight
from uavmap.animation.rerun_flight import FlightRecorder, recorded
from uavmap.cli import main
from uavmap.fly.progress import Silent
from uavmap.record.flight_plan import SIM_EPOCH_UTC_S, FlightPlan
from uavmap.record.frames import KeptFrame

MISSION = str(Path(__file__).parents[3] / "data" / "speck.toml")
SDK = '''
"""Notes a line for what is logged: the mission time, or -, and the path."""
import os

class RecordingStream:
    def __init__(self, name, recording_id):
        self.time = "-"
    def save(self, path):
        self.file = open(path, "w")
    def set_time(self, timeline, duration):
        self.time = f"{duration:.1f}"
    def reset_time(self):
        self.time = "-"
    def log(self, path, what, static=False):
        if "DIES" in os.environ and path.endswith(os.environ["DIES"]):
            os._exit(3)
        self.file.write(f"{self.time} {path}\\n")
    def flush(self):
        self.file.flush()
    def disconnect(self):
        self.file.close()

class ViewCoordinates:
    RIGHT_HAND_Z_UP = FRD = None

def __getattr__(name):
    if name.startswith("_"):
        raise AttributeError(name)
    return lambda *some, **more: None
'''


class Told(Silent):
    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)


@pytest.fixture
def sdk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    folder = tmp_path / "sdk"
    folder.mkdir()
    (folder / "rerun.py").write_text(SDK)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.delitem(sys.modules, "rerun", raising=False)
    yield
    sys.modules.pop("rerun", None)


def plan(*urls: str) -> FlightPlan:
    source = named_text(STOPS.mission)
    return plan_of(source.source, source.text, STOPS.strategy, 1, 1, urls, None, SIM_EPOCH_UTC_S)


def tell_all(recorder: FlightRecorder) -> int:
    """A whole flight of a vehicle with a camera that looks down; how many pictures it took."""
    pictures, state = 0, State.initial(STOPS.setting())
    down = Pose(LatLon(47.3, 8.5), 12.0, Quaternion.from_euler(0.0, -np.pi / 2, 0.0))
    for line in STOPS.lines():
        event = from_json(line)
        recorder.update(event, state, 0)
        if event.kind == "frame_seen":
            frame = KeptFrame("", event.vehicle, event.t_s, down, 80.0)
            recorder.keep(frame, np.zeros((24, 32, 3), np.uint8))
            pictures += 1
    return pictures


def test_a_flight_is_on_one_timeline(
    sdk: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "flight.rrd"
    assert main(["fly", MISSION, "--sim", "--rerun", str(path), "--out", str(tmp_path / "a")]) == 0
    assert f"recording in {path}" in capsys.readouterr().err
    lines = [line.split(" ", 1) for line in path.read_text().splitlines()]
    kinds = {entity for _, entity in lines}
    assert kinds >= {
        "/vehicles/1", "/vehicles/1/battery_wh", "/vehicles/1/frame", "/vehicles/1/frame/picture",
        "/vehicles/1/footprint", "/vehicles/1/track", "/region/cells", "/region/tree",
    }  # fmt: skip
    pictures = [float(t) for t, entity in lines if entity == "/vehicles/1/frame"]
    assert len(pictures) > 20
    assert pictures == sorted(pictures)
    cells = [float(t) for t, entity in lines if entity == "/region/cells"]
    assert min(cells) >= min(pictures)


def test_a_process_that_dies_or_lags_ends_nothing_and_it_is_told_once(
    sdk: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DIES", "/track")
    monkeypatch.setattr(rerun_flight, "WAITING_BYTES", 10)  # real aircraft wait for nobody
    told = Told()
    path = tmp_path / "flight.rrd"
    with recorded(path, plan("udpin://127.0.0.1:1"), told, None) as recorder:
        pictures = tell_all(recorder)
    late, failed = told.lines
    assert late == f"{pictures} events or pictures are not in {path}: it could not keep up"
    assert "the Rerun recording has failed" in failed
    assert "the flight goes on without it" in failed


def test_what_cannot_be_recorded_is_said_before_anything_flies(
    sdk: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    fly = ["fly", MISSION, "--sim", "--out", str(out), "--rerun"]
    assert main([*fly, str(tmp_path / "flight.gif")]) == 2
    assert main([*fly, str(tmp_path / "none" / "flight.rrd")]) == 2
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main([*fly, str(tmp_path / "flight.rrd")]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("uavmap: ")]
    assert len(lines) == 3
    assert "must end in .rrd" in lines[0]
    assert "there is no folder" in lines[1]
    assert "pip install 'uavmap[rerun]'" in lines[2]
    assert not (out / "journal.db").exists()
