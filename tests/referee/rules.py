"""The rules: each holds one promise of `docs/explanation/safety.md` against the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from .memory import Memory
from .motion import unseen
from .track import ProductReport, Sample

FAR_M: Final = 150.0
ALONE_S: Final = 8.0
"""Maximum time without a responsible part, s: reports take one, a lost link five."""
BESIDE_M: Final = 20.0
"""Distance within which a vehicle may land beside a blocked pad, m."""
NO_VERDICT: Final = 5
"""Exit code with which the product states no map."""
MAX_SHOWN: Final = 5
"""Maximum number of cells in the text of a fault."""
WITHOUT_ORDERS: Final = ("others", "over", "silent", "down", "lost")
"""Charges in which no order is given."""

Fault = tuple[str, str]
"""Kind and text."""


@dataclass(frozen=True, slots=True)
class Rule:
    kind: str
    promise: str
    look: Callable[[Memory, Sample], str]
    """The fault of the present sample, after the sample before; empty for none."""


def _alone(memory: Memory, before: Sample) -> str:
    now = memory.now
    reason = _unattended(now) if now.flying and now.charge and "unserved" not in now.ails else ""
    if not reason:
        memory.alone_s = None
        return ""
    if memory.alone_s is None:
        memory.alone_s = now.t_s
    return f"flies, {reason}" if now.t_s - memory.alone_s > ALONE_S else ""


def _unattended(now: Sample) -> str:
    """Return why no part is responsible for a vehicle in the air; empty if one is."""
    others = now.holder != "service" or "falling" in now.ails
    reports = "unheard" not in now.ails
    match now.charge:
        case "mission":
            return "" if others or now.order not in ("", "StandDown") else "without an order"
        case "ground":
            return "" if now.order == "TakeOff" else "and counts as on the ground"
        case "guardian":
            return "guarded, but it hovers" if "idle" in now.ails and not others else ""
        case "others":
            return "" if others or now.returns else "yielded, but no pilot or failsafe has it"
        case "silent":
            return ""
        case _:
            return f"and counts as {now.charge}" if reports else ""


def _changed_mode(memory: Memory, before: Sample) -> str:
    now, found, chosen = memory.now, "", memory.pilot_chose
    memory.pilots_s = memory.turned_s
    for author, mode in now.changes:
        if chosen and author == "service" and before.flying and mode != memory.pilots_mode:
            late_s = now.t_s - memory.pilots_s
            found = f"is taken out of {memory.pilots_mode} into {mode} after {late_s:.2f} s"
        chosen = author == "pilot" and mode != ""
        if chosen:
            memory.pilots_mode, memory.turned_s = mode, now.t_s
    memory.pilot_chose = chosen and now.holder == "pilot" and now.flying
    return found


def _breach(memory: Memory, before: Sample) -> str:
    now = memory.now
    out_m = memory.inside.outside_m((before, now))  # also on the ground: it may be carried
    memory.out_m = out_m if now.flying else 0.0
    if memory.out_m == 0.0:
        memory.left_s = None
        return ""
    if now.holder != "service" or "falling" in now.ails:
        memory.left_s = None
    elif memory.left_s is None:
        memory.left_s = now.t_s
    if memory.out_m <= memory.bounds.waver_m:
        return ""
    return f"is {memory.out_m:.1f} m outside the fence"


def _far(memory: Memory, before: Sample) -> str:
    return f"is {memory.out_m:.0f} m outside the fence" if memory.out_m > FAR_M else ""


def _fell(memory: Memory, before: Sample) -> str:
    return "fell out of the sky" if memory.now.flying and memory.now.wh <= 0.0 else ""


def _reserve(memory: Memory, before: Sample) -> str:
    now, reserve_wh = memory.now, memory.bounds.reserve_wh
    if now.wh >= reserve_wh - 0.01 or now.crashed:
        return ""
    if before.flying and not now.flying:
        return f"landed with {now.wh:.2f} Wh, reserve {reserve_wh:g}"
    if now.flying and now.holder == "service":  # a failsafe of the battery would come too late
        return f"flies with {now.wh:.2f} Wh, reserve {reserve_wh:g}"
    return ""


RULES: Final = (
    Rule("alone", "one part is responsible for each vehicle in the air", _alone),
    Rule("taken", "a mode that a pilot chose is never changed", _changed_mode),
    Rule("breach", "no order leads out of the fence or into a hole", _breach),
    Rule("far", "a vehicle is never carried more than 150 m out", _far),
    Rule("fell", "a vehicle turns back while it has energy", _fell),
    Rule("reserve", "a vehicle lands with its reserve", _reserve),
)
AT_THE_END: Final = {
    "near": "vehicles keep their separation in 3D",
    "hands off": "nothing is sent to a vehicle of a pilot, a failsafe or a crew",
    "air": "no vehicle is in the air at the end",
    "unreported": "a crash, and a landing away from the pad, is reported",
    "away": "a vehicle that counts as at home is there",
    "lie": "a flight is complete only with a whole map and every vehicle at home",
    "false": "no sure cell is wrong",
    "lost votes": "nothing that was confirmed is lost",
    "owner": "settings of the owner are given back",
    "fold": "the text of the journal gives the same state",
    "no end": "a flight ends",
    "traceback": "the program has no defect",
}
"""Promises of the other kinds, which are judged between vehicles or at the end."""


def vehicle_faults(memory: Memory, number: int, report: ProductReport) -> Iterator[Fault]:
    """Yield the faults of one vehicle at the end."""
    now, pad = memory.now, memory.bounds.pads.get(number)
    away_m = 0.0 if pad is None else now.place.distance_to(pad)
    down = memory.is_down(away_m)
    memory.fell_silent = memory.fell_silent and away_m < memory.bounds.home_m
    if down and number not in report.reported:
        yield "unreported", f"has crashed from {memory.fell_m:.1f} m, as {now.charge}"
    if report.completed and (down or (now.crashed and memory.bounds.crash_is_known)):
        yield "lie", "is down, and the flight is complete"
    if now.flying:
        yield "air", f"is in the air at the end in {now.mode}, {now.charge}, {now.wh:.1f} Wh left"
    elif now.charge in ("ground", "home") and away_m > BESIDE_M:
        yield "away", f"stands {away_m:.0f} m from its pad"
    elif report.code in (0, 3, 5) and away_m > memory.bounds.home_m:
        yield "away", f"is {away_m:.1f} m from its pad, and the exit code is {report.code}"


def flight_faults(report: ProductReport, *, home: bool) -> Iterator[Fault]:
    """Yield the faults of a flight and its map at the end."""
    yield from report.faults
    for text in report.lost:
        yield "lost votes", text
    if report.owners:
        yield "owner", f"not put back: {report.owners}"
    if report.code == 0 and not report.completed:
        yield "lie", "exit 0, and it is not complete"
    if report.code == 3 and report.completed:
        yield "lie", "exit 3, and it is complete"
    if report.code == 4 and home and not report.reported:
        yield "lie", "exit 4, and all are at home"
    if report.misjudged or report.code == NO_VERDICT:
        return
    wrong = report.mapped - report.region
    if wrong:
        yield "false", f"{len(wrong)} cells are not region: {sorted(wrong)[:MAX_SHOWN]}"
    if not report.completed:
        return
    missing = report.owed - report.mapped
    if len(missing) > report.missed_cells:
        yield "lie", f"completed without {len(missing)} cells: {sorted(missing)[:MAX_SHOWN]}"
    if report.forbidden:
        yield "lie", "completed, although the fence forbids a part of the region"
    for lane in report.lanes:
        at = unseen(lane, list(report.frames), report.step_m)
        if at is not None:
            yield "lie", f"no frame shows {at}, on a lane"
