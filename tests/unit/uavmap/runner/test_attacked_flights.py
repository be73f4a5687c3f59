"""Whole flights under forged frames and with faults."""

from __future__ import annotations

import pytest

from missions.geo.fence import Fence
from missions.guardian import SPENT_S, Guard, Limits, Seen, Task, watch
from missions.mission.energy import EnergyModel
from missions.units import GridPoint
from tests.benchmarks import faults
from tests.benchmarks.photos import poison
from tests.benchmarks.watched import flown, mission_text


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


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ({"kind": "gps_glitch", "metres": 50.0}, 3),
        ({"kind": "motor", "share": 0.0}, 4),
        ({"kind": "link", "silent": True, "for_s": 100.0}, 0),
        ({"kind": "camera_stall"}, 3),
    ],
    ids=lambda value: value["kind"] if isinstance(value, dict) else "",
)
def test_a_fault_in_the_search_ends_honestly(fault: dict[str, object], code: int) -> None:
    flight = flown(str(fault["kind"]), mission_text("speck", [{**fault, "at_s": 18.0}]), 1)
    assert not faults.forbidden(flight), flight.line()
    assert flight.code == code, flight.line()


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
