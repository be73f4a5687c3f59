"""The recorded flight: its mission, its events, and what must come out of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from missions.events import Event
from missions.mission_file.checks import parse_mission
from missions.state import Setting
from uavmap.results.figures import figures, summary

HERE: Final = Path(__file__).parent
MISSION: Final = HERE / "mission.toml"
EVENTS: Final = HERE / "events.jsonl"
OUTCOME: Final = HERE / "outcome.json"
SEED: Final = 11


def setting() -> Setting:
    return Setting.of(parse_mission(MISSION.read_text("utf-8"), str(MISSION)))


def outcome(events: Sequence[Event]) -> dict[str, Any]:
    """The figures and the ROI cells of a journal, as JSON keeps them."""
    state, found = figures(setting(), events)
    tree = state.tree
    values = {
        "summary": summary(setting(), state, found, SEED),
        "roi": sorted([cell.east, cell.north] for cell in state.belief.roi),
        "tree": sorted([cell.east, cell.north, tree.state(cell).value] for cell in tree.vertices)
        if tree is not None
        else [],
        "t_s": state.t_s,
    }
    plain: dict[str, Any] = json.loads(json.dumps(values))
    return plain
