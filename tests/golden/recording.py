"""The recorded flights: their missions, events and outcomes."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from missions.events import Event
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mission.checks import parse_mission
from tests.support.plans import named_text
from uavmap.output.facts.figures import figures, summary

HERE: Final = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Recording:
    name: str
    mission: str
    """A shipped mission, or the path of one."""
    strategy: str
    seed: int

    @property
    def events(self) -> Path:
        """Its journal, an event a line; of a long flight compressed."""
        plain = HERE / f"{self.name}.jsonl"
        return plain if plain.exists() else HERE / f"{self.name}.jsonl.gz"

    @property
    def outcome(self) -> Path:
        return HERE / f"{self.name}.outcome.json"

    def lines(self) -> list[str]:
        path = self.events
        data = path.read_bytes()
        return (gzip.decompress(data) if path.suffix == ".gz" else data).decode().splitlines()

    def write(self, bodies: Sequence[str], values: dict[str, Any]) -> None:
        data = ("\n".join(bodies) + "\n").encode()
        # without a time in it: the same events are the same file
        self.events.write_bytes(
            gzip.compress(data, mtime=0) if self.events.suffix == ".gz" else data
        )
        text = json.dumps(values, indent=1)
        text = re.sub(r"\[[^][{}]*\]", lambda found: " ".join(found[0].split()), text)
        self.outcome.write_text(text + "\n", "utf-8")

    def setting(self) -> Setting:
        source = named_text(self.mission)
        mission = parse_mission(source.text, source.source)
        return setting_of(mission.model_copy(update={"strategy": self.strategy}))

    def recorded(self) -> dict[str, Any]:
        values: dict[str, Any] = json.loads(self.outcome.read_text("utf-8"))
        return values


STOPS: Final = Recording("stops", str(HERE / "mission.toml"), "rdfs", 11)
"""A flight that observes from every cell, with a battery that has to be changed."""
PASSES: Final = Recording("passes", str(HERE / "mission.toml"), "swath", 11)
RUNWAY: Final = Recording("runway", "runway", "swath", 1)
SPILL: Final = Recording("spill", "spill", "swath", 1)
"""A flight of three vehicles over a region that drifts."""
RECORDINGS: Final = (STOPS, PASSES, RUNWAY, SPILL)


def outcome(recording: Recording, events: Sequence[Event]) -> dict[str, Any]:
    """Return the figures and the ROI cells of a journal, as JSON keeps them."""
    setting = recording.setting()
    state, found = figures(setting, events)
    tree = state.tree
    values = {
        "summary": summary(state, found, recording.seed),
        "roi": sorted([cell.east, cell.north] for cell in state.belief.roi),
        "tree": sorted([cell.east, cell.north, tree.state(cell).value] for cell in tree.vertices)
        if tree is not None
        else [],
        "t_s": state.t_s,
    }
    plain: dict[str, Any] = json.loads(json.dumps(values))
    return plain
