"""One map from several journals: of the members of a fleet, or of several flights, in any order.

If the journal of a member is missing or damaged, the frames count that other members received.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2s
from itertools import accumulate
from pathlib import Path
from typing import Any, Final

from missions.errors import JournalError, OutputError
from missions.events import (
    Continued,
    Event,
    FrameSeen,
    Paused,
    Recalled,
    Resumed,
    Tracked,
    TrafficSeen,
    to_json,
)
from missions.fleet_events import (
    AirLeased,
    AirRequested,
    FactsShared,
    MemberApart,
    MemberReport,
    PartsAllotted,
)
from missions.flight.team.members import facts_of
from missions.mission.fleet_checks import with_vehicles
from uavmap.fleet.knowledge import Knowledge
from uavmap.fleet.sealing import meaning_of
from uavmap.journal.event_log import Journal, JournalReader
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.journal.recovery import good_events
from uavmap.output.facts.figures import figures
from uavmap.output.results import flown_flight, write_results

MERGED: Final = "merged"
"""Key of the journal's meta: the folders of its sources."""
NOT_OWN: Final = (
    MemberReport,
    FactsShared,
    PartsAllotted,
    MemberApart,
    AirRequested,
    AirLeased,
    TrafficSeen,
)


@dataclass(frozen=True, slots=True)
class Source:
    """A journal that is merged."""

    folder: Path
    plan: FlightPlan
    events: tuple[Event, ...]

    @classmethod
    def read(cls, folder: Path, report: Callable[[str], None] = lambda text: None) -> Source:
        """Read a folder of results, and do not change it. Raises `JournalError`.

        The part before the damage of a journal counts, and the present part of a flight under way.
        """
        reader = JournalReader(folder / JOURNAL)
        events, trouble = good_events(reader)
        if "replay" in reader.meta:
            raise JournalError(f"{folder}: is a replay of pictures; only flights can be merged")
        if trouble is not None:
            last_s = events[-1].t_s if events else 0.0
            report(
                f"{folder}: {trouble}; {len(events)} events are merged, the last of {last_s:.0f} s"
            )
        return cls(folder, FlightPlan.read(reader), tuple(events))

    @property
    def digest(self) -> bytes:
        """Return a digest of plan and events, which differs for each flight."""
        digest = blake2s(repr(self.plan).encode())
        for event in self.events:
            digest.update(to_json(event).encode())
        return digest.digest()


def merged_results(
    folders: Sequence[Path],
    out: Path,
    report: Callable[[str], None],
    truth: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Write one map of the journals of some folders into another; return the summary.

    `truth` is the simulator's record. Raises `OutputError`; `JournalError` for journals that do not
    fit each other, and if `out` holds a journal already.
    """
    if (out / JOURNAL).exists():
        raise JournalError(f"--out {out}: holds a journal already; choose a new folder")
    sources = [Source.read(folder, report) for folder in folders]
    plan, events = merged(sources)
    names = sorted(folder.name for folder in folders)
    with Journal.create(out / JOURNAL, {"plan": plan.as_json(), MERGED: names}) as journal:
        journal.append_all(events)
        if truth is not None:
            journal.put_meta("truth", dict(truth))
    flown, _ = flown_flight(out, plan, figures(plan.known_setting(), events), truth)
    try:
        return write_results(flown, report)
    except OSError as error:
        raise OutputError(f"{out}: the results cannot be written ({error.strerror})") from None


def merged(sources: Sequence[Source]) -> tuple[FlightPlan, list[Event]]:
    """Merge plans and events into those of one flight. Raises `JournalError`."""
    # the order must not depend on the names of folders
    sources = sorted(sources, key=lambda s: (s.plan.member or 0, s.plan.epoch_utc_s, s.digest))
    first = sources[0]
    _check_compatible(sources)
    fleet = first.plan.member is not None
    if fleet:
        plan, before = replace(first.plan, member=0, comms=None), [0] * len(sources)
    else:  # numbers of vehicles continue from flight to flight
        *before, count = accumulate((len(s.plan.mission.vehicles) for s in sources), initial=0)
        mission = with_vehicles(first.plan.mission, count)
        plan = replace(first.plan, vehicles=count, mission=mission).as_member(0)
    zero_s = min(source.plan.epoch_utc_s for source in sources)
    dated: list[tuple[float, int, int, Event]] = []
    for place, source in enumerate(sources):
        later_s = 0.0 if fleet else source.plan.epoch_utc_s - zero_s
        own = [event for event in source.events if not isinstance(event, NOT_OWN)]
        last_s = -math.inf
        for k, event in enumerate(own):  # events of a source keep their order: decisions used it
            moved = replace(event, t_s=round(event.t_s + later_s, 3)) if later_s else event
            if before[place] and not isinstance(moved, Recalled | Paused | Continued | Resumed):
                moved = replace(moved, vehicle=moved.vehicle + before[place])
            last_s = max(last_s, moved.t_s)
            dated.append((last_s, place, k, moved))
    if fleet:
        received_only = _received_only(sources)
        dated.extend((event.t_s, len(sources), k, event) for k, event in enumerate(received_only))
    dated.sort(key=lambda item: item[:3])
    return replace(plan, epoch_utc_s=zero_s), [event for *_, event in dated]


def _received_only(sources: Sequence[Source]) -> list[FactsShared]:
    known, counted = Knowledge(), dict[int, int]()
    for source in sources:
        own = facts_of(source.plan.known_setting())
        for event in source.events:
            if isinstance(event, FactsShared):
                known.add(event.vehicle, event.first, event.frames)
            elif isinstance(event, FrameSeen | Tracked) and event.vehicle == source.plan.member:
                number = event.vehicle
                counted[number] = counted.get(number, 0) + len(own.add(event))
    shared = []
    for origin in sorted(known.facts):
        for first, facts in known.runs(origin, counted.get(origin, 0)):
            shared.append(FactsShared(origin, facts[-1].t_s, first, facts))
    return shared


def _check_compatible(sources: Sequence[Source]) -> None:
    first = sources[0]
    members = [source.plan.member for source in sources]
    for source in sources[1:]:
        if (source.plan.member is None) != (first.plan.member is None):
            raise JournalError(
                f"{source.folder}: either it or {first.folder} is from a fleet; merge the members "
                "of a fleet alone"
            )
        one, other = first.plan.known_setting(), source.plan.known_setting()
        if one.grid != other.grid:
            raise JournalError(
                f"{source.folder}: its grid differs from that of {first.folder}; [start], [grid] "
                "and [drift] must be the same"
            )
        fleet = first.plan.member is not None
        if fleet and meaning_of(one.mission) != meaning_of(other.mission):
            raise JournalError(
                f"{source.folder}: its mission differs from that of {first.folder}; the members of "
                "a fleet fly the same file; merge only those that did"
            )
        if source.digest == first.digest:
            raise JournalError(f"{source.folder}: holds the same flight as {first.folder}")
        apart_s = abs(source.plan.epoch_utc_s - first.plan.epoch_utc_s)
        if first.plan.member is None and one.grid.drift_speed_m_s > 0.0 and apart_s > 0.0:
            raise JournalError(
                f"{source.folder}: it began {apart_s:.0f} s from {first.folder}, and the region "
                "drifts: their cells are not on the same ground"
            )
    for place, source in enumerate(sources):
        number, folder = source.plan.member, source.folder
        if number == 0:
            raise JournalError(f"{folder}: is merged already; give the journals of its sources")
        if number is not None and number in members[:place]:
            other_folder = sources[members.index(number)].folder
            raise JournalError(
                f"{folder}: is of vehicle {number}, like {other_folder}; give one of them "
                "(a resumed flight has one folder)"
            )
