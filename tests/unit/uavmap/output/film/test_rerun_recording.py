"""A flight as a Rerun recording, with a stand-in for rerun-sdk that records each call.

With the SDK itself `tests/e2e/commands/test_animate.py` writes a recording.
"""

import io
import sys
from unittest.mock import MagicMock

import numpy as np
import pytest
from PIL import Image

from missions.errors import OutputError
from missions.events import Crashed, from_json
from missions.units import GridPoint, LatLon, Pose, Quaternion
from tests.golden.recording import STOPS
from uavmap.journal.kept_frames import FrameKeeper, KeptFrame
from uavmap.output.film.film import film_of_flight
from uavmap.output.film.rerun_recording import write_recording

DOWN = Quaternion.from_euler(0.0, -np.pi / 2, 0.0)
UP = Quaternion.from_euler(0.0, np.pi / 2, 0.0)


@pytest.fixture
def stream(monkeypatch):
    sdk = MagicMock()
    monkeypatch.setitem(sys.modules, "rerun", sdk)
    return sdk.RecordingStream.return_value


def logged(stream):
    """Mission time, or None, and path of each entry."""
    found, time_s = [], None
    for name, args, options in stream.method_calls:
        if name in ("set_time", "reset_time"):
            time_s = options.get("duration")
        elif name == "log":
            found.append((time_s, args[0]))
    return found


def flight():
    events = [from_json(line) for line in STOPS.lines()]
    film, _ = film_of_flight(STOPS.setting(), events, "a flight")
    return events, film


def test_recording_of_a_flight_logs_each_frame_on_the_timeline(stream, tmp_path):
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
    stream.disconnect.assert_called_once()
    paths = {path for _, path in logged(stream)}
    assert paths == {
        "/", "/log", "/vehicles/1", "/vehicles/1/battery_wh", "/vehicles/1/frame",
        "/vehicles/1/frame/picture", "/vehicles/1/footprint", "/vehicles/1/track",
        "/region/cells", "/region/tree",
    }  # fmt: skip
    frames = [t_s for t_s, path in logged(stream) if path == "/vehicles/1/frame"]
    assert frames == [5.0, 6.0]
    assert (None, "/vehicles/1/track") in logged(stream)
    cells = [t_s or 0.0 for t_s, path in logged(stream) if path == "/region/cells"]
    assert cells == sorted(cells)


def test_recording_without_a_folder_is_an_output_error(stream, tmp_path):
    events, film = flight()
    stream.save.side_effect = RuntimeError("no such folder")
    with pytest.raises(OutputError, match="no such folder"):
        write_recording(tmp_path / "no" / "f.rrd", film, events, STOPS.setting().grid, tmp_path)
