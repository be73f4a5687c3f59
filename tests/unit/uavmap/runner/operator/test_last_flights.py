"""By the journal: an aircraft that was down, or stands where it did not take off."""

from __future__ import annotations

import pytest

from missions.events import Airborne, BatterySwapped, Connected, Crashed, Event
from missions.units import GridPoint
from uavmap.runner.operator.ground_crew import last_flights

PAD, FIELD = GridPoint(0.0, 0.0), GridPoint(39.0, 0.0)


def connected(place: GridPoint, *, airborne: bool) -> Connected:
    """Its autopilot takes the place where it lies for its home, as a real PX4 does."""
    home = PAD if airborne else place
    return Connected(1, 50.0, home, place, 12.0 * airborne, airborne, True, 60.0)


@pytest.mark.parametrize(
    ("events", "doubt"),
    [
        ([Airborne(1, 10.0, home=PAD)], "stands 39 m from its pad"),
        ([connected(PAD, airborne=True)], "stands 39 m from its pad"),
        (
            [Airborne(1, 10.0, home=PAD), Crashed(1, 20.0, FIELD, "it fell"),
             connected(FIELD, airborne=False)],
            "was down",
        ),
        ([Airborne(1, 10.0, home=PAD), BatterySwapped(1, 30.0, 60.0)], None),
        ([connected(FIELD, airborne=False)], None),
    ],
)  # fmt: skip
def test_last_flight_of_a_vehicle_tells_whether_to_ask_about_it(
    events: list[Event], doubt: str | None
) -> None:
    flights = last_flights(events)
    assert doubt == (flights[1].doubt(FIELD) if 1 in flights else None)


def test_vehicle_on_its_pad_is_not_asked_about() -> None:
    assert not last_flights([Airborne(1, 10.0, home=PAD)])[1].doubt(GridPoint(3.0, 0.0))
