"""Whole flights under forged frames, and a wrong charge."""

from __future__ import annotations

import pytest

from missions.geo.fence import Fence
from missions.guardian import SPENT_S, Guard, Limits, Seen, Task, watch
from missions.mission.energy import EnergyModel
from missions.units import GridPoint
from tests.benchmarks.photos import poison


@pytest.mark.parametrize("kind", poison.KINDS)
def test_two_thousand_forged_frames_in_a_flight(kind: str) -> None:
    flight, _, reached = poison.fly((kind, 1, 2000, "speck"))
    assert not flight.columns & poison.FORBIDDEN, flight.line()
    assert reached == ()
    if kind == "strangers":  # they change nothing at all
        assert flight.code == 0


def test_a_forger_feeds_what_he_is_asked_to() -> None:
    """The flights above would show nothing if nothing were fed."""
    one, other = poison.Forger("poisoned", 1), poison.Forger("poisoned", 1)
    frames = [one.frame() for _ in range(200)]
    assert frames == [other.frame() for _ in range(200)]
    assert len(set(frames)) > 150
    assert {frame[5] for frame in frames if frame[0] == 0xFD} == {1}  # the vehicle's own system


def test_one_wrong_charge_does_not_land_it_in_the_field() -> None:
    corners = ((-50, -50), (50, -50), (50, 50), (-50, 50))
    fence = Fence.of([GridPoint(*corner) for corner in corners], [], 2.0)
    limits = Limits(fence, EnergyModel(300.0, 60.0, 0.15, 5.0, 2.0))
    here = GridPoint(20.0, 20.0)
    guard = Guard(task=Task("hold", 0.0, (here,), height_m=12.0))

    def seen(t_s: float, wh: float) -> Seen:
        return Seen(t_s, here, 12.0, 0.0, GridPoint(0.0, 0.0), True, True, "follow", wh)

    for second in range(40):
        guard, verdict = watch(limits, guard, seen(float(second), 0.5 if second % 3 == 0 else 50.0))
        assert verdict is None
    verdicts = []
    for second in range(40, 45):
        guard, verdict = watch(limits, guard, seen(float(second), 0.5))
        verdicts.append(verdict)
    (first,) = [v for v in verdicts if v is not None]
    assert first.rung == "land"
    assert verdicts.index(first) in (int(SPENT_S), int(SPENT_S) + 1)
