"""Routes stay inside the fence, volumes keep their distance, lanes cover the box."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import unary_union

from missions.geo.fence import Fence, route_length_m
from missions.geo.volumes import Volume
from missions.planning.search.lanes import lanes, share_out, unseen
from missions.units import GridPoint

FAST = settings(max_examples=150, deadline=None)
MARGIN_M = 2.0


def star(
    rng: np.random.Generator, centre: GridPoint, inner_m: float, outer_m: float, corners: int
) -> list[GridPoint]:
    angles = np.sort(rng.uniform(0, math.tau, corners) * 0.2 + np.arange(corners)
                     * math.tau / corners)  # fmt: skip
    return [
        GridPoint(
            centre.east_m + float(radius) * math.cos(float(angle)),
            centre.north_m + float(radius) * math.sin(float(angle)),
        )
        for angle, radius in zip(angles, rng.uniform(inner_m, outer_m, corners), strict=True)
    ]


def random_fence(seed: int) -> tuple[Fence, Polygon]:
    """A star-shaped fence with one to three holes in it, and the exact polygon."""
    rng = np.random.default_rng(seed)
    outer = star(rng, GridPoint(0, 0), 40, 120, int(rng.integers(5, 11)))
    holes: list[list[GridPoint]] = []
    for _ in range(int(rng.integers(1, 4))):
        middle = GridPoint(*map(float, rng.uniform(-25, 25, 2)))
        hole = star(rng, middle, 3, 12, int(rng.integers(3, 7)))
        body = Polygon(hole)
        apart = all(body.distance(Polygon(other)) > 1.0 for other in holes)
        if body.is_valid and apart and Polygon(outer).buffer(-1.0).contains(body):
            holes.append(hole)
    return Fence.of(outer, holes, MARGIN_M), Polygon(outer, holes)


def somewhere(fence: Fence, rng: np.random.Generator) -> GridPoint:
    while True:
        point = GridPoint(*map(float, rng.uniform(-100, 100, 2)))
        if fence.allows(point):
            return point


@pytest.mark.parametrize("seed", range(40))
def test_routes_stay_inside_keep_the_margin_and_arrive(seed: int) -> None:
    fence, exact = random_fence(seed)
    rng = np.random.default_rng([seed, 1])
    detours = 0
    for _ in range(6):
        start, end = somewhere(fence, rng), somewhere(fence, rng)
        route = fence.route(start, end)
        together = any(
            part.buffer(0.01).covers(Point(start)) and part.buffer(0.01).covers(Point(end))
            for part in getattr(fence.inner, "geoms", [fence.inner])
        )
        if not together:
            assert route is None
            continue
        assert route is not None
        assert route[-1] == end
        detours += len(route) > 1
        for a, b in itertools.pairwise((start, *route)):
            assert exact.covers(LineString([a, b]))
            assert LineString([a, b]).distance(exact.boundary) > MARGIN_M - 0.05
        back = fence.route(end, start)
        assert back is not None
        there_m = route_length_m(start, route)
        assert route_length_m(end, back) == pytest.approx(there_m, abs=0.01)
        assert there_m >= start.distance_to(end) - 1e-9


@pytest.mark.parametrize("seed", range(15))
def test_a_vehicle_blown_out_comes_back_by_the_nearest_way(seed: int) -> None:
    fence, _ = random_fence(seed)
    rng = np.random.default_rng([seed, 2])
    end = somewhere(fence, rng)
    edge = fence.inner.boundary.interpolate(float(rng.uniform()), normalized=True)
    out = GridPoint(float(edge.x) + 0.7, float(edge.y) + 0.7)
    route = fence.route(out, end)
    if route is not None and not fence.allows(out):
        assert fence.allows(route[0])
        assert out.distance_to(route[0]) <= math.hypot(0.7, 0.7) + 1e-6


def test_a_point_on_the_rim_of_the_margin_is_allowed_in_spite_of_rounding() -> None:
    """Lanes are cut at this rim, so their ends lie on it to the last bit or not quite."""
    for seed in range(20):
        fence, _ = random_fence(seed)
        for share in np.linspace(0, 1, 40):
            at = fence.inner.boundary.interpolate(float(share), normalized=True)
            assert fence.allows(GridPoint(float(at.x), float(at.y)))


# --- volumes ---------------------------------------------------------------------------------
points = st.builds(GridPoint, st.floats(-30, 30), st.floats(-30, 30))
heights = st.tuples(st.floats(0, 30), st.floats(0, 12))
volumes = st.builds(
    lambda path, low, stray: Volume(tuple(path), low[0], low[0] + low[1], stray),
    st.lists(points, min_size=1, max_size=4),
    heights,
    st.sampled_from([0.0, 0.0, 3.0]),
)


def sample(volume: Volume, rng: np.random.Generator) -> tuple[float, float, float]:
    """A place in a volume."""
    legs = list(itertools.pairwise(volume.path)) or [(volume.path[0], volume.path[0])]
    a, b = legs[int(rng.integers(len(legs)))]
    along, turn = float(rng.uniform()), float(rng.uniform(0, math.tau))
    stray_m = volume.stray_m * float(rng.uniform())
    return (
        a.east_m + along * (b.east_m - a.east_m) + stray_m * math.cos(turn),
        a.north_m + along * (b.north_m - a.north_m) + stray_m * math.sin(turn),
        float(rng.uniform(volume.low_m, volume.high_m)),
    )


@FAST
@given(volumes, volumes, st.floats(1, 8), st.integers(0, 2**16))
def test_volumes_that_do_not_meet_hold_no_two_near_places(
    one: Volume, other: Volume, distance_m: float, seed: int
) -> None:
    assert one.meets(other, distance_m) == other.meets(one, distance_m)
    if one.meets(other, distance_m):
        return
    rng = np.random.default_rng(seed)
    for _ in range(40):
        assert math.dist(sample(one, rng), sample(other, rng)) >= distance_m - 2e-6


@FAST
@given(volumes, st.floats(0.5, 8))
def test_a_volume_meets_itself(volume: Volume, distance_m: float) -> None:
    assert volume.meets(volume, distance_m)


# --- lanes -----------------------------------------------------------------------------------
def rectangle(east_m: float, north_m: float, width_m: float, depth_m: float) -> list[GridPoint]:
    return [
        GridPoint(east_m, north_m),
        GridPoint(east_m + width_m, north_m),
        GridPoint(east_m + width_m, north_m + depth_m),
        GridPoint(east_m, north_m + depth_m),
    ]


WIDE = rectangle(-500, -500, 1000, 1000)


def judged(box: list[GridPoint], cell_m: float) -> None:
    """Every cell whose centre is in the box is under a lane, or beside one, not across a corner."""
    flown = lanes(box, cell_m, Fence.of(WIDE, [], 0.0))
    seen = unary_union([LineString(lane) for lane in flown])
    rows = seen.bounds[2] - seen.bounds[0], seen.bounds[3] - seen.bounds[1]
    inside = Polygon(box).buffer(-1e-6)
    shapely.prepare(inside)
    west, south, east, north = (round(edge / cell_m) for edge in inside.bounds)
    assert max(rows) > 0
    for i, k in itertools.product(range(west, east + 1), range(south, north + 1)):
        centre = Point(i * cell_m, k * cell_m)
        if inside.covers(centre):
            assert seen.distance(centre) <= cell_m + 1e-6


edges = st.floats(6, 60)


@FAST
@given(st.floats(-40, 40), st.floats(-40, 40), edges, edges, st.floats(2, 6))
def test_every_cell_of_the_box_is_judged_from_a_lane(
    east_m: float, north_m: float, width_m: float, depth_m: float, cell_m: float
) -> None:
    judged(rectangle(east_m, north_m, width_m, depth_m), cell_m)


@FAST
@given(st.floats(0, math.tau), st.floats(20, 60), st.floats(15, 40))
def test_a_turned_box_is_judged_up_to_its_slanting_rim(
    turn_rad: float, width_m: float, depth_m: float
) -> None:
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    box = [
        GridPoint(e * cos - n * sin, e * sin + n * cos)
        for e, n in rectangle(0, 0, width_m, depth_m)
    ]
    judged(box, 4.0)


def test_a_box_that_is_a_rounding_too_short_loses_no_row() -> None:
    judged(rectangle(0, 0, 40, 39.99999999999999), 1.0)


@pytest.mark.parametrize("seed", range(20))
def test_lanes_stay_inside_the_fence(seed: int) -> None:
    fence, exact = random_fence(seed)
    rng = np.random.default_rng([seed, 3])
    box = rectangle(*map(float, rng.uniform(-40, 0, 2)), *map(float, rng.uniform(20, 60, 2)))
    flown = lanes(box, 4.0, fence)
    for start, end in flown:
        assert fence.allows(start)
        assert fence.allows(end)
        assert exact.covers(LineString([start, end]))
    blocks = share_out(flown, 3) if flown else ()
    assert tuple(itertools.chain.from_iterable(blocks)) == flown


@FAST
@given(points, points, st.lists(st.floats(0, 1), max_size=30))
def test_what_is_unseen_of_a_lane_lies_on_it_and_no_frame_near(
    start: GridPoint, end: GridPoint, shares: list[float]
) -> None:
    length_m = start.distance_to(end)
    assume(length_m > 0.01)
    seen_m = [share * length_m for share in shares]
    line = LineString([start, end])
    stretches = unseen((start, end), seen_m, 4.0)
    for a, b in stretches:
        assert line.distance(Point(a)) < 1e-6
        assert line.distance(Point(b)) < 1e-6
        middle_m = (start.distance_to(a) + start.distance_to(b)) / 2
        assert all(abs(middle_m - place_m) > 4.0 - 1e-6 for place_m in seen_m)
    # and whatever is farther than a cell and a half from every frame is in one of them
    for share in np.linspace(0, 1, 21):
        place_m = float(share) * length_m
        if all(abs(place_m - seen) > 6.0 for seen in seen_m) and length_m > 2.0:
            place = line.interpolate(place_m)
            assert any(LineString(stretch).distance(place) < 1e-6 for stretch in stretches)


def test_a_lane_with_a_frame_over_each_cell_is_seen() -> None:
    lane = (GridPoint(0, 0), GridPoint(40, 0))
    assert unseen(lane, [4.0 * i for i in range(11)], 4.0) == ()
    assert unseen(lane, [4.0 * i for i in range(11) if i != 5], 4.0) == ()  # one is lost
    two_lost = [4.0 * i for i in range(11) if i not in (5, 6)]
    assert unseen(lane, two_lost, 4.0) == ((GridPoint(20, 0), GridPoint(24, 0)),)
    assert unseen(lane, [], 4.0) == (lane,)
