"""The moves of the planners stay what they are, however their computation changes."""

from __future__ import annotations

import hashlib

import pytest

from missions.lab.arena.arena_run import run
from missions.lab.arena.roi import grown
from missions.planning.stepwise import EXPLORERS


@pytest.mark.parametrize(
    ("name", "kind", "cells", "robots", "moves", "digest"),
    [
        ("horizon", "eden", 120, 1, 142, "c2aa6f753568f028"),
        ("horizon", "eden", 120, 8, 256, "d147c209fa2397f0"),
        ("horizon", "ragged", 120, 3, 352, "a5f006d6e8e6fa2f"),
        ("horizon", "thin", 80, 4, 258, "5d1264660a387811"),
        ("horizon", "rectangle", 150, 2, 152, "9e63855d4dacef6e"),
        ("horizon", "eden", 300, 3, 358, "3e99fba0d5033aac"),
        ("horizon", "eden", 600, 2, 698, "45daf06a56c4dc52"),
        ("greedy", "eden", 120, 1, 164, "48f6732924433311"),
        ("greedy", "eden", 120, 8, 372, "41a83a2aca850f1d"),
        ("greedy", "ragged", 120, 3, 404, "1b617239c681925d"),
        ("greedy", "thin", 80, 4, 244, "85760a614feb47b8"),
        ("greedy", "rectangle", 150, 2, 164, "ff2a23bd80a14324"),
        ("greedy", "eden", 300, 3, 502, "f7c8790e1cbc2249"),
    ],
)
def test_every_move_is_the_one_that_was_recorded(
    name: str, kind: str, cells: int, robots: int, moves: int, digest: str
) -> None:
    """Costs here are whole and half numbers, so no machine rounds them otherwise. Who changes a
    strategy on purpose records anew, and says so in the changelog."""
    roi = grown(kind, cells, 5)
    legs = run(EXPLORERS[name], roi.cells, roi.start, robots).legs
    assert len(legs) == moves
    text = ";".join(f"{m.robot} {m.start_t:g} {m.end.east} {m.end.north}" for m in legs)
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == digest
