"""Calls between files in a decision, from a verdict to the order, of a recorded flight."""

from __future__ import annotations

import sys
from pathlib import Path
from statistics import median
from types import CodeType, FrameType

import pytest

import missions
from missions.events import from_json
from missions.flight.step import step
from missions.orders import FlyPath
from missions.planning.kernels.jit import COMPILED
from tests.golden.recording import RUNWAY

PRODUCT = str(Path(missions.__file__).parent.parent)
MOST = 200


class Calls:
    """A counter of calls of product functions from product functions of other files."""

    def __init__(self) -> None:
        self.count = 0
        self._file: dict[CodeType, str | None] = {}

    def __call__(self, frame: FrameType, what: str, arg: object) -> None:
        if what != "call" or (callee := self.file(frame.f_code)) is None:
            return
        back = frame.f_back
        while back is not None and self.file(back.f_code) is None:
            back = back.f_back
        self.count += back is not None and self.file(back.f_code) != callee

    def file(self, code: CodeType) -> str | None:
        name = code.co_filename
        ours = name.startswith(PRODUCT) and "/tests/" not in name and "/.venv/" not in name
        return self._file.setdefault(code, name if ours else None)


@pytest.mark.skipif(not COMPILED, reason="numba is not installed: plans are shorter searches")
def test_decision_of_a_flight_makes_few_calls_between_files() -> None:
    setting = RUNWAY.setting()
    state, counts = setting.initial_state(), list[int]()
    for event in map(from_json, RUNWAY.lines()):
        calls = Calls()
        sys.setprofile(calls)
        try:
            state, orders = step(state, event)
        finally:
            sys.setprofile(None)
        if event.kind == "frame_seen" and any(isinstance(order, FlyPath) for _, order in orders):
            counts.append(calls.count)
    assert len(counts) > 30
    assert median(counts) < MOST, counts
