"""The outcome of a flight, and the table of many flights."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from tests.referee import Referee

from .plan import Plan

COLUMNS: Final = (
    "n", "ok", "inc", "home", "away", "air", "alone", "taken", "crash", "breach", "far", "near",
    "fell", "reserve", "lie", "unrep", "owner", "end", "tb",
)  # fmt: skip
FORBIDDEN: Final = {
    "air": "air", "alone": "alone", "hands off": "alone", "taken": "taken", "breach": "breach",
    "far": "far", "near": "near", "fell": "fell", "reserve": "reserve", "lie": "lie",
    "false": "lie", "lost votes": "lie", "fold": "lie", "unreported": "unrep", "away": "unrep",
    "owner": "owner", "no end": "end", "traceback": "tb",
}  # fmt: skip
"""The column of each forbidden outcome."""
AWAY_M: Final = 8.0
"""Distance from its pad from which a vehicle counts as away."""
EXPLAINED: Final = """\
n flights; ok complete; inc honestly incomplete; home all vehicles landed at home; away one landed
elsewhere; air one left in the air at the end; alone one in the air without a responsible part;
taken a mode that a pilot chose was changed by the service;
crash a crash (reported); breach out of the fence; far more than 150 m out; near two too near;
fell out of energy in the air; reserve flies or lands with less than the reserve; lie a false
"complete", lost votes, or a journal with another state; unrep a crash or a landing away from home
without a report; owner a setting of the owner not given back; end no end; tb a traceback. From
air on, all
but crash are forbidden."""


@dataclass(frozen=True, slots=True)
class Outcome:
    seed: int
    label: str
    plan: str
    counts: frozenset[str]
    """The columns that it counts in."""
    found: tuple[tuple[str, str], ...]
    """Broken rules: kind and text."""
    forgiven: Counter[str] = field(default_factory=Counter)
    """Number of uses of each rule of forgiveness."""


def outcome(flight: Plan, referee: Referee, *, completed: bool) -> Outcome:
    """Return the outcome of a flight by its referee."""
    columns = {FORBIDDEN[kind] for kind, _ in referee.found}
    columns.add("ok" if completed else "inc")
    far = any(referee.from_pad_m(number) > AWAY_M for number in referee.memories)
    columns.add("away" if far else "home")
    if referee.crashed:
        columns.add("crash")
    found, forgiven = tuple(referee.found), referee.forgiven
    return Outcome(flight.seed, flight.label, str(flight), frozenset(columns), found, forgiven)


def forgiven_line(outcomes: Iterable[Outcome]) -> str:
    """Return the number of uses of each rule of forgiveness in all flights."""
    total = sum((outcome.forgiven for outcome in outcomes), Counter[str]())
    return "forgiven: " + (", ".join(f"{n} {name}" for name, n in total.most_common()) or "nothing")


def table(outcomes: Iterable[Outcome]) -> str:
    rows: dict[str, dict[str, int]] = {}
    for outcome in outcomes:
        for label in (outcome.label, "all"):
            row = rows.setdefault(label, dict.fromkeys(COLUMNS, 0))
            row["n"] += 1
            for column in outcome.counts:
                row[column] += 1
    last = {"pairs": 1, "all": 2}
    lines = [f"{'':16s}" + "".join(f"{column:>8s}" for column in COLUMNS)]
    for label in sorted(rows, key=lambda name: (last.get(name, 0), name)):
        numbers = "".join(f"{rows[label][column]:8d}" for column in COLUMNS)
        lines.append(f"{label:16s}{numbers}")
    return "\n".join(lines)
