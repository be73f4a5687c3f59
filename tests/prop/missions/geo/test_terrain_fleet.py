"""The reducer's world over random hills: nobody comes nearer to the ground than its layer."""

from __future__ import annotations

import pytest

from missions.flight.state import Phase
from missions.geo.terrain import FOLLOW_M
from tests.fake_fleet import fleet
from tests.prop.missions.test_fleet import map_is_whole
from tests.support.hills import hills, over
from tests.support.small_missions import random_scenario


@pytest.mark.parametrize(("seed", "strategy"), [(0, None), (7, "swath")])
def test_over_random_hills_the_map_is_whole_and_nobody_comes_near_the_ground(
    seed: int, strategy: str | None
) -> None:
    scenario = random_scenario(seed, strategy=strategy)
    mission = over(scenario.mission, hills(seed, 16.0))
    mission = mission.model_copy(
        update={"battery": mission.battery.model_copy(update={"capacity_wh": 60.0})}
    )
    flight = fleet(mission, scenario.roi)
    flight.start()
    flight.run()
    assert flight.faults == []
    assert {v.phase for v in flight.state.vehicles.values()} == {Phase.FINISHED}
    if strategy is None:
        map_is_whole(flight, scenario)
    assert min(d.least_off_m for d in flight.drivers.values()) >= -FOLLOW_M
