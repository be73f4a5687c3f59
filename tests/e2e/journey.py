"""The journal of a flight under way: only its new lines are read, and folded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from missions.events import FrameSeen, from_json
from missions.flight.setting_of import setting_of
from missions.flight.step import step
from missions.flight.vehicle_state import VehicleState
from tests.e2e.rig import bodies, mission
from uavmap.load.mission_source import load


class Journey:
    def __init__(self, folder: Path, name: str, **changed: Any) -> None:
        """Follow a journal; `changed` are the fields of the mission that the command line has
        changed.
        """
        self._folder = folder
        self._setting = setting_of(load(mission(name)).model_copy(update=changed))
        self._state = self._setting.initial_state()
        self._read = 0
        self.frames = 0
        """Number of judged frames."""

    def vehicle(self) -> VehicleState:
        found = bodies(self._folder, self._read)
        for event in map(from_json, found):
            self._state, _ = step(self._state, event)
            self.frames += isinstance(event, FrameSeen)
        self._read += len(found)
        return self._state.vehicles[1]
