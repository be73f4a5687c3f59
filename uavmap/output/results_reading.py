"""A folder of results, read back from its journal, also of an interrupted flight."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from missions.events import Event, FrameSeen, Tracked, Weighed
from missions.flight.setting import Setting
from missions.mapping.evidence import Evidence
from missions.units import LatLon
from uavmap.base.text_files import read_text
from uavmap.journal.event_log import JournalReader
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.output.facts.calendar import TAKEN, Calendar
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import Flown
from uavmap.output.facts.vote_tally import Votes, weighed
from uavmap.output.replay_results import Replayed, flown_replay
from uavmap.output.write_results import flown_flight

_MOST_BYTES: Final = 10_000_000


def flown_of(folder: Path) -> Flown:
    """Read a folder of results. Raises `JournalError`, `MissionFileError`."""
    journal = JournalReader(folder / JOURNAL)
    plan = FlightPlan.read(journal)
    events, meta = list(journal.events()), journal.meta
    setting = plan.known_setting()
    if "replay" in meta:
        return _replayed(folder, plan, setting, events, Calendar.of_replay(meta.get(TAKEN)))
    return flown_flight(folder, plan, setting, events, meta.get("truth"))[0]


def _replayed(
    folder: Path, plan: FlightPlan, setting: Setting, events: Sequence[Event], calendar: Calendar
) -> Flown:
    """Count the votes of the journal again: the pictures are elsewhere."""
    mission, grid = setting.mission, setting.grid
    votes = Votes(mission.votes.frames, mission.votes.positive)
    evidence = Evidence() if mission.by_evidence else None
    taken: list[tuple[float, LatLon, float]] = []
    place: Tracked | None = None
    said: FrameSeen | None = None
    for event in events:
        if isinstance(event, Tracked):
            place = event
        elif isinstance(event, FrameSeen):
            said = event
            if place is not None:
                taken.append((event.t_s, grid.position(place.position), place.height_m))
            if evidence is None and event.vantage is not None:
                votes.add(event.vantage, event.votes)
        elif isinstance(event, Weighed) and evidence is not None and said is not None:
            evidence.add(said.votes, event.weights)
    decided = votes.counted()
    if evidence is not None:
        decided = weighed(evidence, mission.detector.share)
    log = FlightLog.of(events)
    replayed = Replayed(*decided, taken, len(log.troubles), 0)
    known = _kept_summary(folder)
    return flown_replay(folder, plan, setting, replayed, log, calendar, known)


def _kept_summary(folder: Path) -> dict[str, Any]:
    """Return the summary that the replay has written: it counts files, the journal does not."""
    try:
        values = json.loads(read_text(folder / "summary.json", _MOST_BYTES))
    except (OSError, ValueError, RecursionError):
        return {}
    return values if isinstance(values, dict) and "completed" in values else {}
