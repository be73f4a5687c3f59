"""A flight as a Rerun recording, with a stand-in for rerun-sdk that notes what is logged. With the
SDK itself `tests/e2e/commands/test_animate.py` writes a recording."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

from missions.errors import OutputError
from missions.events import Crashed, Event, from_json
from missions.units import GridPoint, LatLon, Pose, Quaternion
from tests.golden.recording import STOPS
from uavmap.journal.kept_frames import FrameKeeper, KeptFrame
from uavmap.output.film.flight_film import film_of_flight
from uavmap.output.film.rerun_recording import write_recording

DOWN = Quaternion.from_euler(0.0, -np.pi / 2, 0.0)
UP = Quaternion.from_euler(0.0, np.pi / 2, 0.0)


class Stream:
    """Notes a pair for what is logged: the mission time, or None, and the path."""

    def __init__(self, name: str, recording_id: str) -> None:
        self.time_s: float | None = None
        self.logged: list[tuple[float | None, str]] = []
        self.closed = False

    def save(self, path: str) -> None:
        if not Path(path).parent.is_dir():
            raise RuntimeError("no such folder")

    def set_time(self, timeline: str, duration: float) -> None:
        self.time_s = duration

    def reset_time(self) -> None:
        self.time_s = None

    def log(self, path: str, what: object, static: bool = False) -> None:
        self.logged.append((self.time_s, path))

    def flush(self) -> None: ...

    def disconnect(self) -> None:
        self.closed = True


@pytest.fixture
def streams(monkeypatch: pytest.MonkeyPatch) -> list[Stream]:
    """The streams that the SDK's stand-in has opened."""
    opened: list[Stream] = []

    class Sdk(ModuleType):
        ViewCoordinates = type("ViewCoordinates", (), {"RIGHT_HAND_Z_UP": None, "FRD": None})

        def RecordingStream(self, *some: Any, **more: Any) -> Stream:  # noqa: N802 - the SDK's
            opened.append(Stream(*some, **more))
            return opened[-1]

        def __getattr__(self, name: str) -> Any:
            return lambda *some, **more: None

    monkeypatch.setitem(sys.modules, "rerun", Sdk("rerun"))
    return opened


def flight() -> tuple[list[Event], Any]:
    events = [from_json(line) for line in STOPS.lines()]
    film, _ = film_of_flight(STOPS.setting(), events, "a flight")
    return events, film


def test_write_recording_flight_with_frames_logs_each_on_the_timeline(
    streams: list[Stream], tmp_path: Path
) -> None:
    events, film = flight()
    png = io.BytesIO()
    Image.new("RGB", (32, 24)).save(png, "PNG")
    keeper = FrameKeeper(tmp_path, lambda text: None)
    for t_s, picture, attitude in (
        (5.0, png.getvalue(), DOWN), (6.0, png.getvalue(), UP), (7.0, b"damaged", DOWN),
    ):  # fmt: skip
        keeper.keep(KeptFrame("", 1, t_s, Pose(LatLon(47.3, 8.5), 12.0, attitude), 80.0), picture)
    crash = Crashed(1, events[-1].t_s, GridPoint(0.0, 0.0), "tilted")
    write_recording(tmp_path / "f.rrd", film, [*events, crash], STOPS.setting().grid, tmp_path)
    (stream,) = streams
    assert stream.closed
    paths = {path for _, path in stream.logged}
    assert paths == {
        "/", "/log", "/vehicles/1", "/vehicles/1/battery_wh", "/vehicles/1/frame",
        "/vehicles/1/frame/picture", "/vehicles/1/footprint", "/vehicles/1/track",
        "/region/cells", "/region/tree",
    }  # fmt: skip
    frames = [t_s for t_s, path in stream.logged if path == "/vehicles/1/frame"]
    assert frames == [5.0, 6.0]
    assert (None, "/vehicles/1/track") in stream.logged
    cells = [t_s or 0.0 for t_s, path in stream.logged if path == "/region/cells"]
    assert cells == sorted(cells)


def test_write_recording_folder_is_missing_raises_output_error(
    streams: list[Stream], tmp_path: Path
) -> None:
    events, film = flight()
    with pytest.raises(OutputError, match="no such folder"):
        write_recording(tmp_path / "no" / "f.rrd", film, events, STOPS.setting().grid, tmp_path)
