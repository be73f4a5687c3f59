"""One map of several journals: of a fleet whose members each kept one, or of several flights.

Every event stays what it is, with who it is of. Of a member whose journal is not there, or lacks
its end, the frames count that others have heard of, so what was confirmed anywhere is on the map.
The journals may be given in any order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from missions.errors import JournalError, OutputError
from missions.events import (
    Apart,
    Asked,
    Continued,
    Event,
    FrameSeen,
    Heard,
    Leased,
    Paused,
    Recalled,
    Resumed,
    Shared,
    Tracked,
)
from missions.fleet.knowledge import Knowledge
from missions.flight.joined import Facts
from uavmap.record.flight_plan import JOURNAL, FlightPlan
from uavmap.record.journal import Journal
from uavmap.record.reading import JournalReader
from uavmap.results.documents import with_documents
from uavmap.results.score import true_roi
from uavmap.results.write_results import write_results

MERGED: Final = "merged"
"""In the journal's meta: the folders whose journals it was made of."""
NOT_OWN: Final = (Heard, Shared, Apart, Asked, Leased)


@dataclass(frozen=True, slots=True)
class Source:
    """A journal that is merged."""

    folder: Path
    plan: FlightPlan
    events: tuple[Event, ...]

    @classmethod
    def read(cls, folder: Path) -> Source:
        """That of a folder of results. Raises `JournalError`."""
        reader = JournalReader(folder / JOURNAL)
        if "replay" in reader.meta:
            raise JournalError(f"{folder}: is a replay of pictures; only flights are merged")
        events: list[Event] = []
        while piece := reader.new_events():
            events.extend(piece)
        return cls(folder, FlightPlan.read(reader), tuple(events))


def merged_results(
    folders: Sequence[Path],
    out: Path,
    say: Callable[[str], None],
    truth: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Write one map of the journals of some folders into another; returns the summary.

    `truth` is what the simulator watched. Raises `JournalError`, naming the folder, for journals
    that make no map together, and where `out` holds a journal already; `OutputError`.
    """
    sources = [Source.read(folder) for folder in folders]
    plan, events = merged(sources)
    names = sorted(folder.name for folder in folders)
    with Journal.create(out / JOURNAL, {"plan": asdict(plan), MERGED: names}) as journal:
        journal.append_all(events)
        if truth is not None:
            journal.put_meta("truth", dict(truth))
    setting = plan.known_setting()
    simulated = plan.simulated and bool(setting.mission.sim.roi)
    roi = true_roi(setting.mission, setting.grid) if simulated else None
    calendar, also = with_documents(out, plan, setting, events, say)
    seed = plan.seed if plan.simulated else None
    try:
        return write_results(out, setting, events, seed, truth, roi, calendar, also)
    except OSError as error:
        raise OutputError(f"{out}: the results cannot be written ({error.strerror})") from None


def merged(sources: Sequence[Source]) -> tuple[FlightPlan, list[Event]]:
    """The plan and the events of several journals as those of one. Raises `JournalError`."""
    sources = sorted(sources, key=lambda source: (source.plan.member or 0, source.folder.name))
    first = sources[0]
    _refuse_strangers(sources)
    fleet = first.plan.member is not None
    if fleet:
        numbers = {id(source): 0 for source in sources}
        plan = replace(first.plan, member=0, comms=None)
    else:
        numbers, count = _renumbered(sources)
        plan = replace(first.plan, member=0, vehicles=count)
    zero_s = min(source.plan.epoch_utc_s for source in sources)
    dated: list[tuple[float, int, int, Event]] = []
    for place, source in enumerate(sources):
        later_s = 0.0 if fleet else source.plan.epoch_utc_s - zero_s
        own = [event for event in source.events if not isinstance(event, NOT_OWN)]
        last_s = -math.inf
        for k, event in enumerate(own):  # each stays in its own order: that is what was acted on
            moved = _moved(event, numbers[id(source)], later_s)
            last_s = max(last_s, moved.t_s)
            dated.append((last_s, place, k, moved))
    if fleet:
        only_heard = _only_heard(sources)
        dated.extend((event.t_s, len(sources), k, event) for k, event in enumerate(only_heard))
    dated.sort(key=lambda item: item[:3])
    return replace(plan, epoch_utc_s=zero_s), [event for *_, event in dated]


def _only_heard(sources: Sequence[Source]) -> list[Shared]:
    """Facts of members whose journal is not there, or lacks its end, as others have heard them."""
    known, counted = Knowledge(), dict[int, int]()
    for source in sources:
        own = Facts(source.plan.known_setting())
        for event in source.events:
            if isinstance(event, Shared):
                known.take(event.vehicle, event.first, event.frames)
            elif isinstance(event, FrameSeen | Tracked) and event.vehicle == source.plan.member:
                number = event.vehicle
                counted[number] = counted.get(number, 0) + len(own.take(event))
    heard = []
    for origin, facts in sorted(known.facts.items()):
        first = counted.get(origin, 0)
        if facts[first:]:
            heard.append(Shared(origin, facts[-1].t_s, first, tuple(facts[first:])))
    return heard


def _refuse_strangers(sources: Sequence[Source]) -> None:
    """Raise `JournalError` for journals that make no map together."""
    first = sources[0]
    members = [source.plan.member for source in sources]
    for source in sources[1:]:
        if (source.plan.member is None) != (first.plan.member is None):
            raise JournalError(
                f"{source.folder}: only one of it and {first.folder} is of a fleet; merge those "
                "of a fleet first"
            )
        one, other = first.plan.known_setting(), source.plan.known_setting()
        if one.grid != other.grid:
            raise JournalError(
                f"{source.folder}: its grid is another than that of {first.folder}; [start], "
                "[grid] and [drift] have to be the same"
            )
        if first.plan.member is not None and source.plan.mission_text != first.plan.mission_text:
            raise JournalError(
                f"{source.folder}: its mission is another than that of {first.folder}; the members "
                "of a fleet fly the same file"
            )
        apart_s = abs(source.plan.epoch_utc_s - first.plan.epoch_utc_s)
        if first.plan.member is None and one.grid.drift_speed_m_s > 0.0 and apart_s > 0.0:
            raise JournalError(
                f"{source.folder}: it began {apart_s:.0f} s from {first.folder}, and the region "
                "drifts: their cells are not the same ground"
            )
    twice = [number for number in members if number is not None and members.count(number) > 1]
    if twice:
        raise JournalError(f"{sources[-1].folder}: vehicle {twice[0]} is there twice")
    if any(number == 0 for number in members):
        raise JournalError(f"{first.folder}: it is merged already; give the journals it is made of")


def _renumbered(sources: Sequence[Source]) -> tuple[dict[int, int], int]:
    """By how much the vehicles of each flight are numbered higher, and how many there are."""
    numbers, count = {}, 0
    for source in sources:
        numbers[id(source)] = count
        count += len(source.plan.mission().vehicles)
    return numbers, count


def _moved(event: Event, higher: int, later_s: float) -> Event:
    """An event of a vehicle that is numbered higher, and of a flight that began later."""
    if later_s:
        event = replace(event, t_s=round(event.t_s + later_s, 3))
    if higher and not isinstance(event, Recalled | Paused | Continued | Resumed):
        event = replace(event, vehicle=event.vehicle + higher)
    return event
