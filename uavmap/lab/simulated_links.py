"""The radio between robots on the grid, from the text of `uavmap simulate --comms`."""

from __future__ import annotations

import math
import re
from typing import Final

from missions.lab.arena.arena_run import Comms
from missions.lab.arena.radio import Links
from missions.partition import Partition
from uavmap.fleet.simulated_radio import RANGE, link_words

KINDS: Final = ("shared", "free", "meeting")
_KEYS: Final = ("loss", "delay", "rate")
_TIME: Final = r"([0-9]+(?:\.[0-9]+)?)"
_GROUPS: Final = r"[0-9]+(?:[+/][0-9]+)*"
_APART: Final = re.compile(f"{_TIME}-{_TIME}(?::({_GROUPS}))?", re.ASCII)
_APART_MEANT: Final = "apart:BEGIN-END, or with groups of robots apart:BEGIN-END:1+2/3+4"


def simulated_links(text: str, robots: int, seed: int) -> Comms | Links:
    """Read links; lengths in cells, times in steps. `free` is another word for `shared`.

    The seed is of the losses. Raises `ValueError` with the text and the remedy.

    >>> simulated_links("meeting", 3, 1)
    <Comms.MEETING: 'meeting'>
    >>> simulated_links("range:8,loss:0.2,apart:10-30:1+2", 3, 1).apart
    (Partition(begin=10.0, end=30.0, groups=(frozenset({0, 1}),)),)
    """
    words = link_words(text, KINDS, "CELLS", _KEYS, ("apart",))
    if words.kind == Comms.MEETING and (words.numbers or words.others):
        raise ValueError("who talks only at a vertex needs no radio; write meeting alone, or range")
    if words.kind == Comms.MEETING:
        return Comms.MEETING
    if words.kind != RANGE and not words.numbers and not words.others:
        return Comms.SHARED
    return Links(
        range_cells=words.numbers.get(RANGE, math.inf),
        loss=words.numbers.get("loss", 0.0),
        delay=words.numbers.get("delay", 0.0),
        rate=words.numbers.get("rate", math.inf),
        apart=tuple(_apart(text, robots) for _, text in words.others),
        seed=seed,
    )


def draws(comms: Comms | Links) -> bool:
    """Return whether a seed makes a difference.

    >>> draws(Links(loss=0.1)), draws(Links(loss=1.0)), draws(Comms.SHARED)
    (True, False, False)
    """
    return isinstance(comms, Links) and 0.0 < comms.loss < 1.0


def _apart(text: str, robots: int) -> Partition:
    """Read a partition; robots are numbered from 1."""
    found = _APART.fullmatch(text)
    if found is None:
        raise ValueError(f"apart:{text} is no time; write {_APART_MEANT}")
    begin, end = float(found[1]), float(found[2])
    if not begin < end:
        raise ValueError(f"apart:{text} ends before it begins; write {_APART_MEANT}")
    numbers = [[int(n) for n in group.split("+")] for group in (found[3] or "").split("/") if group]
    flat = [n for group in numbers for n in group]
    for number in flat:
        if not 1 <= number <= robots:
            raise ValueError(f"apart:{text}: robot {number} is none of 1 to {robots}")
        if flat.count(number) > 1:
            raise ValueError(f"apart:{text}: robot {number} stands there twice; leave one out")
    return Partition(begin, end, tuple(frozenset(n - 1 for n in group) for group in numbers))
