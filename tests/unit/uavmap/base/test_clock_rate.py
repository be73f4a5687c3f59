"""A vehicle's time that passes at another pace than the flight reckons."""

from __future__ import annotations

import asyncio

import pytest

from tests.support.flights import Flight, fly
from tests.support.running import by
from uavmap.base.clock import ClockRate


def said(rate: float, speedup: float = 1.0, seconds: int = 60) -> list[str]:
    clock = ClockRate(10.0 * speedup, speedup)
    steps = range(int(seconds * speedup))
    return [text for t in steps if (text := clock.take(float(t), 1000.0 + rate * t))]


@pytest.mark.parametrize("rate", [0.7, 0.8, 1.0, 1.3])
def test_a_busy_machine_is_not_a_wrong_speedup(rate: float) -> None:
    assert said(rate) == []


@pytest.mark.parametrize(
    ("speedup", "rate", "meant"), [(1.0, 10.0, "10"), (10.0, 0.3, "3"), (10.0, 0.1, "1")]
)
def test_a_wrong_speedup_is_said_once_with_the_right_one(
    speedup: float, rate: float, meant: str
) -> None:
    (text,) = said(rate, speedup)
    assert f"--speedup {meant} meant" in text


def test_a_restart_is_no_pace() -> None:
    clock = ClockRate(10.0, 1.0)
    times = [*range(20), *range(3), *range(3, 40)]
    assert not any(clock.take(float(t), float(boot)) for t, boot in enumerate(times))


@by(fly)
async def test_a_flight_says_it(flight: Flight, /) -> None:
    flight.driver._clock_rate = ClockRate(10.0, 0.2)
    await asyncio.sleep(30.0)
    assert not [line for line in flight.told if "speedup" in line]
    vehicle, step = flight.vehicle, flight.vehicle.step
    flight.vehicle = _Faster(vehicle, step)  # type: ignore[assignment]
    await asyncio.sleep(30.0)
    assert [line for line in flight.told if "vehicle 1: its clock runs 3.0 times" in line]


class _Faster:
    """The same vehicle, whose time passes three times as fast."""

    def __init__(self, vehicle: object, step: object) -> None:
        self._vehicle, self._step = vehicle, step

    def step(self, dt_s: float) -> bytes:
        return b"".join(self._step(dt_s) for _ in range(3))  # type: ignore[operator]

    def __getattr__(self, name: str) -> object:
        return getattr(self._vehicle, name)
