"""A folder of results, read back from its journal: also of a flight that was interrupted."""

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
from uavmap.output.facts.extent import extent
from uavmap.output.facts.figures import figures
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import Flown, dated, flown_from
from uavmap.output.facts.score import true_roi
from uavmap.output.facts.vote_tally import Votes, weighed
from uavmap.output.replay_results import Replayed, replay_map, replay_summary
from uavmap.output.write_results import flight_values, map_data

_MOST_BYTES: Final = 10_000_000


def flown_of(folder: Path) -> Flown:
    """What a folder tells. Raises `JournalError`, `MissionFileError`."""
    journal = JournalReader(folder / JOURNAL)
    plan = FlightPlan.read(journal)
    events, meta = list(journal.events()), journal.meta
    setting = plan.known_setting()
    if "replay" in meta:
        return _replayed(folder, plan, setting, events, Calendar.of_replay(meta.get(TAKEN)))
    state, found = figures(setting, events)
    roi = None
    if plan.simulated and setting.mission.sim.roi:
        roi = true_roi(setting.mission, setting.grid)
    data = map_data(setting, state, found, roi)
    seed = plan.seed if plan.simulated else None
    values = flight_values(setting, state, found, seed, meta.get("truth"), roi)
    return flown_from(folder, plan, setting, data, values, FlightLog.of(events))


def _replayed(
    folder: Path, plan: FlightPlan, setting: Setting, events: Sequence[Event], calendar: Calendar
) -> Flown:
    """A replay: its pictures are elsewhere, and what they said is in the journal."""
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
    share = mission.detector.share
    decided = votes.counted() if evidence is None else weighed(evidence, share)
    log = FlightLog.of(events)
    replayed = Replayed(*decided, taken, len(log.troubles), 0)
    data = replay_map(setting, replayed)
    values = replay_summary(setting, replayed) | (_kept_summary(folder) or {})
    values = dated(values, data, extent(data, share), calendar)
    return Flown(folder, plan, setting, data, values, log, calendar, recorded=True)


def _kept_summary(folder: Path) -> dict[str, Any] | None:
    """The summary that the replay has written: it counts what the journal does not know."""
    try:
        values = json.loads(read_text(folder / "summary.json", _MOST_BYTES))
    except (OSError, ValueError, RecursionError):
        return None
    return values if isinstance(values, dict) and "completed" in values else None
