"""The fence by hand, and its routes against a plain search over all corners."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, Polygon

from missions.geo.fence import Fence, route_length_m
from missions.units import GridPoint

FAST = settings(max_examples=150, deadline=None)


def ring(west: float, south: float, east: float, north: float) -> list[GridPoint]:
    return [GridPoint(*xy) for xy in ((west, south), (east, south), (east, north), (west, north))]


SQUARE = ring(0, 0, 100, 100)


# --- what is allowed -------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("east_m", "north_m", "inside", "allowed"),
    [
        (50, 50, True, True),
        (2, 50, True, True),  # on the rim of the margin
        (1.9, 50, True, False),
        (0, 50, True, False),  # on the fence itself
        (-0.1, 50, False, False),
        (100, 100, True, False),
        (98, 98, True, True),
        (98.1, 98, True, False),
    ],
)
def test_fence_contains_places_and_allows_those_inside_its_margin(east_m, north_m, inside, allowed):
    fence = Fence.from_rings(SQUARE, [], 2.0)
    assert fence.contains(GridPoint(east_m, north_m)) is inside
    assert fence.allows(GridPoint(east_m, north_m)) is allowed


def test_a_hole_is_outside_and_keeps_a_margin_of_its_own():
    fence = Fence.from_rings(SQUARE, [ring(40, 40, 60, 60)], 2.0)
    assert not fence.contains(GridPoint(50, 50))
    assert fence.contains(GridPoint(39, 50))
    assert not fence.allows(GridPoint(39, 50))
    assert fence.allows(GridPoint(38, 50))
    assert not fence.allows(GridPoint(38.5, 38.5))  # corners of the margin are square


def test_a_margin_that_fills_the_fence_allows_nothing():
    fence = Fence.from_rings(SQUARE, [], 60.0)
    assert not fence.allows(GridPoint(50, 50))
    assert fence.contains(GridPoint(50, 50))
    assert fence.route(GridPoint(50, 50), GridPoint(51, 50)) is None


def test_a_leg_along_the_rim_of_the_margin_is_allowed():
    fence = Fence.from_rings(SQUARE, [ring(40, 40, 60, 60)], 2.0)
    assert fence.allows_leg(GridPoint(38, 20), GridPoint(38, 80))
    assert not fence.allows_leg(GridPoint(39, 20), GridPoint(39, 80))
    assert not fence.allows_leg(GridPoint(20, 50), GridPoint(80, 50))


def test_a_leg_of_no_length_is_allowed_only_where_one_may_be():
    fence = Fence.from_rings(SQUARE, [ring(40, 40, 60, 60)], 2.0)
    for place, allowed in (((20, 20), True), ((50, 50), False), ((1, 50), False)):
        assert fence.allows_leg(GridPoint(*place), GridPoint(*place)) is allowed


def test_a_leg_between_two_allowed_places_may_leave_a_hollow_fence():
    hollow = [GridPoint(*xy) for xy in ((0, 0), (100, 0), (100, 100), (50, 20), (0, 100))]
    fence = Fence.from_rings(hollow, [], 1.0)
    left, right = GridPoint(5, 80), GridPoint(95, 80)
    assert fence.allows(left)
    assert fence.allows(right)
    assert not fence.allows_leg(left, right)
    route = fence.route(left, right)
    assert route is not None
    assert len(route) == 2
    assert route[0].east_m == pytest.approx(50.0)
    assert route[0].north_m < 20.0


# --- routes by hand --------------------------------------------------------------------------
HOLE, WALL = ring(40, 20, 60, 90), ring(40, -1, 60, 101)
ROUTES = {
    # the hole, the margin, the start, and the places of the route
    "a straight way is one leg": (None, 2.0, (10, 10), [(90, 40)]),
    "where it is already is a leg of no length": (None, 2.0, (10, 10), [(10, 10)]),
    "round a hole the shorter side is taken": (HOLE, 2.0, (20, 50), [(38, 18), (62, 18), (80, 50)]),
    "or the other": (HOLE, 2.0, (20, 88), [(38, 92), (62, 92), (80, 88)]),
    "on one side of a wall": (WALL, 2.0, (20, 50), [(20, 90)]),
    # a vehicle that was blown there comes in by the shortest route
    "from the margin": (None, 5.0, (1, 50), [(5, 50), (50, 50)]),
    "from beyond the fence": (None, 5.0, (-30, 120), [(5, 95), (50, 50)]),
}


@pytest.mark.parametrize("name", ROUTES)
def test_a_route_leads_the_shortest_way_inside_of_the_margin(name):
    hole, margin_m, start, way = ROUTES[name]
    fence = Fence.from_rings(SQUARE, [] if hole is None else [hole], margin_m)
    places = tuple(GridPoint(*place) for place in way)
    assert fence.route(GridPoint(*start), places[-1]) == places


def test_route_into_the_margin_or_through_a_wall_is_refused():
    assert Fence.from_rings(SQUARE, [], 5.0).route(GridPoint(50, 50), GridPoint(1, 50)) is None
    assert Fence.from_rings(SQUARE, [WALL], 2.0).route(GridPoint(20, 50), GridPoint(80, 50)) is None


def test_route_between_two_holes_needs_two_margins():
    def through(gap_m: float) -> float | None:
        south, north = ring(40, 1, 60, 50), ring(40, 50 + gap_m, 60, 99)
        fence = Fence.from_rings(SQUARE, [south, north], 2.0)
        route = fence.route(GridPoint(20, 52), GridPoint(80, 52))
        return None if route is None else route_length_m(GridPoint(20, 52), route)

    assert through(5.0) == pytest.approx(60.0, abs=0.2)
    assert through(3.0) is None  # narrower than two margins


# --- fences drawn at random ------------------------------------------------------------------
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
    """Return a star-shaped fence with one to three holes, and the exact polygon."""
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
    return Fence.from_rings(outer, holes, MARGIN_M), Polygon(outer, holes)


def somewhere(fence: Fence, rng: np.random.Generator) -> GridPoint:
    while True:
        point = GridPoint(*map(float, rng.uniform(-100, 100, 2)))
        if fence.allows(point):
            return point


@pytest.mark.parametrize("seed", range(40))
def test_routes_stay_inside_keep_the_margin_and_arrive(seed):
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


def test_a_point_on_the_rim_of_the_margin_is_allowed_in_spite_of_rounding():
    """Lanes are cut at this rim, so their ends lie on it to the last bit or not quite."""
    for seed in range(20):
        fence, _ = random_fence(seed)
        for share in np.linspace(0, 1, 40):
            at = fence.inner.boundary.interpolate(float(share), normalized=True)
            assert fence.allows(GridPoint(float(at.x), float(at.y)))


# --- routes beside a plain search ------------------------------------------------------------
def shortest_m(fence: Fence, start: GridPoint, end: GridPoint) -> float:
    """Return the least length by Floyd and Warshall, over all allowed legs between corners."""
    places = [start, end, *fence.corners]
    count = len(places)
    far = np.full((count, count), np.inf)
    for i, k in itertools.combinations(range(count), 2):
        if fence.allows_leg(places[i], places[k]):
            far[i, k] = far[k, i] = places[i].distance_to(places[k])
    np.fill_diagonal(far, 0.0)
    for via in range(count):
        far = np.minimum(far, far[:, via, None] + far[None, via, :])
    return float(far[0, 1])


@pytest.mark.parametrize("seed", range(12))
def test_route_is_the_shortest_over_the_corners(seed):
    fence, _ = random_fence(500 + seed)
    rng = np.random.default_rng([seed, 9])
    for _ in range(3):
        start, end = somewhere(fence, rng), somewhere(fence, rng)
        route = fence.route(start, end)
        expected = shortest_m(fence, start, end)
        if route is None:
            assert math.isinf(expected)
        else:
            assert route_length_m(start, route) == pytest.approx(expected, abs=1e-6)


@FAST
@given(st.floats(-20, 120), st.floats(-20, 120), st.floats(0, 20))
@example(50.0, 50.0, 1e-54)
def test_allowed_place_keeps_the_margin(east_m, north_m, margin_m):
    hole = ring(45, 30, 55, 70)
    fence = Fence.from_rings(SQUARE, [hole], margin_m)
    exact = Polygon(SQUARE, [hole])
    point = GridPoint(east_m, north_m)
    if fence.allows(point):
        assert exact.buffer(0.011).covers(Point(point))
        assert exact.boundary.distance(Point(point)) >= margin_m - 0.011
    elif exact.covers(Point(point)):
        # round a hole the margin has square corners, which forbids a little more than its width
        assert exact.boundary.distance(Point(point)) <= margin_m * math.sqrt(2) + 1e-6


@FAST
@given(st.floats(3, 97), st.floats(3, 97), st.floats(3, 97), st.floats(3, 97))
def test_an_allowed_leg_stays_in_the_margin_all_the_way(e1, n1, e2, n2):
    fence = Fence.from_rings(SQUARE, [ring(45, 30, 55, 70)], 2.0)
    a, b = GridPoint(e1, n1), GridPoint(e2, n2)
    leg = LineString([a, b])
    assert fence.allows_leg(a, b) == fence.allows_leg(b, a)
    if fence.allows_leg(a, b):
        for share in np.linspace(0, 1, 9):
            at = leg.interpolate(float(share), normalized=True)
            assert fence.allows(GridPoint(float(at.x), float(at.y)))


def test_leg_along_an_edge_is_allowed_with_any_last_bits_of_its_corners():
    """From the end of a lane at a hole the route leads around the hole, not around the fence."""
    square = [GridPoint(-20, -20), GridPoint(100, -20), GridPoint(100, 70), GridPoint(-20, 70)]
    hole = [
        GridPoint(30.000001, 9.999998),
        GridPoint(42.000002, 10.000001),
        GridPoint(41.999999, 30.000003),
        GridPoint(29.999997, 29.999999),
    ]
    fence = Fence.from_rings(square, [hole], 2.0)
    start, end = GridPoint(44.0, 16.0), GridPoint(28.0, 16.0)
    way = fence.route(start, end)
    assert way is not None
    assert route_length_m(start, way) < 33.0
    assert not fence.allows_leg(start, end)
    assert not fence.allows_leg(start, GridPoint(43.98, 12.0))  # 2 cm inside of the margin


@pytest.mark.parametrize("seed", range(15))
def test_a_vehicle_blown_out_comes_back_by_the_nearest_way(seed):
    fence, _ = random_fence(seed)
    rng = np.random.default_rng([seed, 2])
    end = somewhere(fence, rng)
    edge = fence.inner.boundary.interpolate(float(rng.uniform()), normalized=True)
    out = GridPoint(float(edge.x) + 0.7, float(edge.y) + 0.7)
    route = fence.route(out, end)
    if route is not None and not fence.allows(out):
        assert fence.allows(route[0])
        assert out.distance_to(route[0]) <= math.hypot(0.7, 0.7) + 1e-6
