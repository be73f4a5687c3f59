"""The rules of forgiveness: each has a name and a reason, and its uses are counted.

`docs/reference/referee.md` shows this table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from .memory import Memory

REACTION_S: Final = 12.0
"""Time for the others to leave the air of a vehicle that left its own, s."""


@dataclass(frozen=True, slots=True)
class Forgiveness:
    name: str
    kinds: tuple[str, ...]
    """Kinds of faults that the rule forgives."""
    why: str
    holds: Callable[[Memory], bool]


def _hands(memory: Memory) -> bool:
    return memory.now.holder != "service"


def _leaves_air(memory: Memory) -> bool:
    now = memory.now
    if now.holder != "service":
        known_s = now.t_s - memory.unknown_s
        return known_s < REACTION_S and "unheard" not in now.ails
    return memory.within("hands", REACTION_S)


FORGIVENESSES: Final = (
    Forgiveness(
        "pilot or failsafe", ("breach", "far", "fell"),
        "the program does not control the vehicle", _hands,
    ),
    Forgiveness(
        "unasked", ("breach", "far"),
        "the autopilot returns straight home without a report",
        lambda m: "unasked" in m.now.ails,
    ),
    Forgiveness(
        "lands by itself", ("air",),
        "the simulation ends with the program: a pilot has the vehicle, or it returns or lands",
        lambda m: m.bounds.ends_with_program and (m.now.returns or m.now.holder == "pilot"),
    ),
    Forgiveness(
        "falling", ("breach", "far", "near"),
        "a crash has rules of its own", lambda m: "falling" in m.now.ails,
    ),
    Forgiveness(
        "pads outside", ("breach", "far"),
        "a pad lies outside of the fence", lambda m: "pads outside" in m.now.ails,
    ),
    Forgiveness(
        "misled", ("breach", "far"),
        "positions and velocities that agree and are wrong cannot be noticed",
        lambda m: m.within("misled"),
    ),
    Forgiveness(
        "uncontrolled", ("breach",),
        "60 s after it was flown by others or blind; longer while no command arrives",
        lambda m: m.is_uncontrolled,
    ),
    Forgiveness(
        "straight return", ("breach",),
        "60 s after it obeyed no target: only RTL is left, which is straight",
        lambda m: m.now.mode.upper() == "RTL" and (m.within("straight") or m.within("deaf")),
    ),
    Forgiveness(
        "no command arrives", ("far", "fell", "reserve"),
        "60 s after that: nothing can be done about it", lambda m: m.within("deaf"),
    ),
    Forgiveness(
        "not reckoned with", ("reserve",),
        "in its sortie there was a pilot, a failsafe, wrong positions, a storm, or no program",
        lambda m: bool(m.sortie & {"hands", "blind", "stormy", "unserved"}),
    ),
    Forgiveness(
        "battery failed", ("reserve",),
        "the charge was gone before it was reported", lambda m: "drained" in m.sortie,
    ),
    Forgiveness(
        "battery empty at once", ("fell",),
        "more than 30 % of the charge was gone", lambda m: "emptied" in m.sortie,
    ),
    Forgiveness(
        "obeys nothing", ("fell",),
        "it refuses targets, landing and return", lambda m: "helpless" in m.now.ails,
    ),
    Forgiveness(
        "flown by hand", ("near",),
        "its path cannot be foreseen", lambda m: "by hand" in m.now.ails,
    ),
    Forgiveness(
        "wrong positions", ("near",),
        "60 s after it was blind", lambda m: m.within("blind"),
    ),
    Forgiveness(
        "leaves its air", ("near",),
        "12 s after a failsafe, a pilot's RTL or LAND, or a release is known", _leaves_air,
    ),
    Forgiveness(
        "guardian acts", ("near",),
        "12 s after its guardian's return or landing began",
        lambda m: m.now.charge == "guardian" and m.now.t_s - m.unguarded_s < REACTION_S,
    ),
    Forgiveness(
        "no program", ("near", "air", "unreported", "lie"),
        "no program runs", lambda m: "unserved" in m.now.ails,
    ),
    Forgiveness(
        "on its way", ("taken",),
        "a command sent before the pilot's mode could be known",
        lambda m: m.now.t_s - m.pilots_s <= m.bounds.race_s + 1e-9,
    ),
    Forgiveness(
        "landed blind", ("away",),
        "positions were wrong when it landed", lambda m: m.landed_blind,
    ),
    Forgiveness(
        "fell unseen at its pad", ("unreported", "lie"),
        "no telemetry shows a fall over the pad",
        lambda m: m.fell_silent,
    ),
)  # fmt: skip
BY_KIND: Final = {
    kind: [f for f in FORGIVENESSES if kind in f.kinds]
    for kind in {kind for f in FORGIVENESSES for kind in f.kinds}
}
