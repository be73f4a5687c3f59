"""Whatever the box, the prior and the team: never later than the plain order, no lane lost."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.fence import Fence
from missions.planning.search.lanes import lanes
from missions.planning.search.prior import Spot, likely_lanes
from missions.planning.search.search_order import Pace, expected_s, plain_blocks, soonest
from missions.units import GridPoint

OPEN = Fence.of([GridPoint(*xy) for xy in ((-1e3, -1e3), (1e3, -1e3), (1e3, 1e3), (-1e3, 1e3))],
                [], 0.0)  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(
    width_m=st.floats(20, 240),
    depth_m=st.floats(20, 240),
    spots=st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(2, 60)), min_size=1,
                   max_size=3),
    homes=st.lists(st.tuples(st.floats(-60, 60), st.floats(-60, 60)), min_size=1, max_size=4),
    pause_s=st.floats(0, 4),
)  # fmt: skip
def test_the_order_is_never_worse_and_the_lanes_are_the_same(
    width_m: float,
    depth_m: float,
    spots: list[tuple[float, float, float]],
    homes: list[tuple[float, float]],
    pause_s: float,
) -> None:
    corners = ((0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m))
    box = [GridPoint(*xy) for xy in corners]
    flown = lanes(box, 4.0, OPEN)
    prior = [Spot(GridPoint(e * width_m, n * depth_m), spread_m) for e, n, spread_m in spots]
    likely = likely_lanes(flown, box, prior, 4.0, 3)
    assert abs(sum(lane.probability for lane in likely) - 1.0) < 1e-9
    assert all(0.0 <= lane.middle_m <= lane.length_m + 1e-9 for lane in likely)
    pads, pace = [GridPoint(*xy) for xy in homes], Pace(6.0, pause_s)
    found = soonest(likely, pads, pace)
    assert len(found) == len(pads)
    assert expected_s(found, pads, pace) <= expected_s(plain_blocks(likely, len(pads)), pads, pace)
    ways = [frozenset(part.lane) for block in found for part in block]
    assert len(ways) == len(flown)
    assert set(ways) == {frozenset(lane) for lane in flown}
