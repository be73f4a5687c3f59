"""How hard a vehicle met the ground: landings, falls, bounces, and messages that are wrong."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from missions.guardian import HARD_M_S
from uavmap.aircraft.guardian.estimates import IMPACT_KEPT_S, Impact

G_M_S2 = 9.81


def told(speeds: Iterable[float], *, every_s: float = 0.1, impact: Impact | None = None) -> Impact:
    impact = Impact() if impact is None else impact
    begin_s = impact._descent[-1][0] if impact._descent else 0.0
    for count, sink_m_s in enumerate(speeds, start=1):
        impact.take(begin_s + count * every_s, sink_m_s)
    return impact


def fall(height_m: float, every_s: float) -> list[float]:
    """The speeds of a fall from rest, and the rest after it."""
    lasts_s = (2 * height_m / G_M_S2) ** 0.5
    count = int(lasts_s / every_s)
    return [*(G_M_S2 * n * every_s for n in range(count + 1)), 0.0, 0.0]


def test_motors_that_stop_in_the_last_metre_are_an_impact() -> None:
    """As told of a fall of 0.8 m: only its last message is faster than a hard landing."""
    end = [0.78, 1.25, 1.79, 2.33, 2.87]
    assert told([*[0.48] * 20, *end, 0.0, 0.0]).speed_m_s > HARD_M_S
    # the same last message, from nowhere
    assert told([*[0.48] * 24, 2.87, 0.0, 0.0]).speed_m_s == 0.48


@pytest.mark.parametrize("fast_m_s", [0.7, 1.5, 2.4])
def test_a_landing_is_no_impact(fast_m_s: float) -> None:
    impact = told([*[fast_m_s] * 50, *[0.5] * 60, 0.1, 0.0])
    assert impact.speed_m_s == 0.5
    assert told([*[fast_m_s] * 50, 0.0]).speed_m_s <= HARD_M_S


@pytest.mark.parametrize(
    ("height_m", "every_s"), [(1.5, 0.1), (3.0, 0.1), (10.0, 0.1), (3.0, 0.2), (10.0, 0.2)]
)
def test_a_fall_is_one(height_m: float, every_s: float) -> None:
    assert told(fall(height_m, every_s), every_s=every_s).speed_m_s > HARD_M_S


def test_a_bounce_does_not_hide_it() -> None:
    impact = told(fall(3.0, 0.1))
    told([-1.0, -0.5, 0.5, 1.0, 0.0, 0.0], impact=impact)
    assert impact.speed_m_s > HARD_M_S


def test_a_stop_in_the_air_is_forgotten_before_the_landing() -> None:
    impact = told([4.0, 4.0, 4.0, 0.0])
    told([0.0] * round(IMPACT_KEPT_S / 0.1 + 1), impact=impact)
    assert impact.speed_m_s == 0.0


def test_braking_as_an_autopilot_brakes_is_no_impact() -> None:
    """From 4 m/s with 2.5 m/s2: the end of that is slow."""
    assert told([4.0 - 0.25 * n for n in range(17)]).speed_m_s < HARD_M_S


def test_a_clock_that_begins_anew_begins_it_anew() -> None:
    impact = told(fall(3.0, 0.1))
    impact.take(0.0, 0.0)
    assert impact.speed_m_s == 0.0
