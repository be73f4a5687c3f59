"""Files between a silent link and the operator's line, counted in a simulated flight."""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType

import missions
from tests.benchmarks.watched import mission_text
from uavmap.base.terminal import Terminal
from uavmap.mavlink.vehicle_view import VehicleView
from uavmap.ui.cli import main

PRODUCT = Path(missions.__file__).parent.parent
MOST = 12
SILENT = {"kind": "link", "at_s": 5.0, "for_s": 10.0, "silent": True}


class Trip:
    """Count the calls of product functions by file, from a silence of 5 s to the line."""

    def __init__(self) -> None:
        self.calls: dict[str, int] = {}
        self.line = ""

    def profile(self, frame: FrameType, what: str, arg: object) -> None:
        path = Path(frame.f_code.co_filename)
        if what == "call" and path.is_relative_to(PRODUCT):
            name = path.relative_to(PRODUCT).as_posix()
            if name.startswith(("uavmap/", "missions/", "vision/")):
                self.calls[name] = self.calls.get(name, 0) + 1


def test_lost_link_is_shown_within_few_files_of_where_it_is_noticed(tmp_path, monkeypatch):
    trip, silent_s, show = Trip(), VehicleView.silent_s, Terminal.show

    def watched(view: VehicleView, now_s: float) -> float:
        if trip.line or silent_s(view, now_s) < 5.0:
            return silent_s(view, now_s)
        sys.setprofile(trip.profile)
        return silent_s(view, now_s)

    def recording_show(terminal: Terminal, text: str) -> None:
        show(terminal, text)
        if "link lost" in text:
            sys.setprofile(None)
            trip.line = text

    monkeypatch.setattr(VehicleView, "silent_s", watched)
    monkeypatch.setattr(Terminal, "show", recording_show)
    path = tmp_path / "lost.toml"
    path.write_text(mission_text("speck", [SILENT]), encoding="utf-8")
    code = main(["fly", str(path), "--sim", "--out", str(tmp_path / "out")])
    sys.setprofile(None)
    assert code == 0
    assert trip.line == "     10 s  vehicle 1: link lost"
    assert "uavmap/runner/operator/progress.py" in trip.calls
    assert len(trip.calls) <= MOST, trip.calls
