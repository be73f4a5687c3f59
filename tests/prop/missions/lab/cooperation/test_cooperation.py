"""Robots that watch each other, on grounds of any shape."""

import math

import numpy as np
import pytest

from missions.errors import AreaError, StrategyError
from missions.lab.cooperation import trapezoids, triangulation
from missions.lab.cooperation.exploration import Exploration, Why, unseen
from missions.lab.cooperation.space import GRID_M, Space
from missions.lab.cooperation.stripes import stripes_of
from missions.lab.cooperation.tracking import Filter, Leg, Noise, followed, legs_of
from missions.lab.cooperation.trapezoids import Cover, Pattern, reckoned
from tests.benchmarks.planning.cooperation import faults, in_stripes, in_triangles, unwatched
from tests.support.ground.polygons import random_space

HALL = Space([(0, 0), (40, 0), (40, 20), (0, 20)])


# --- completeness, sight and knowledge ----------------------------------------------------------
@pytest.mark.parametrize("explore", [in_stripes, in_triangles])
@pytest.mark.parametrize("seed", range(14))
def test_exploration_sees_all_and_moves_no_robot_unwatched(explore, seed):
    exploration = explore(random_space(seed), seed)
    assert faults(exploration, seed, points=40, pieces=2) == []


def test_number_of_triangles_follows_from_corners_and_holes():
    for seed in range(8):
        space = random_space(seed)
        wanted = len(space.corners) + 2 * (len(space.rings) - 1) - 2
        assert in_triangles(space, seed).figures().pieces == wanted


def test_stripes_of_a_ground_cover_it_once():
    for seed in range(8):
        space = random_space(seed)
        stripes = stripes_of(space, 0.0, 7.0)
        pieces = [Space(stripe.outline()).polygon for stripe in stripes]
        assert sum(piece.area for piece in pieces) == pytest.approx(space.area_m2, rel=1e-4)
        # every door leads back
        doors = {(s.number, door.other, door.a, door.b) for s in stripes for door in s.doors}
        assert doors == {(other, number, a, b) for number, other, a, b in doors}


def test_unseen_ground_and_unwatched_robots_are_found():
    """The judge of the other tests sees that last moves are missing."""
    whole = trapezoids.explore(HALL, (0.0, 0.0), Pattern(6.0, math.radians(60.0)))
    half = Exploration(HALL, 6.0, (0.0, 0.0), 2, whole.moves[: len(whole.moves) // 2])
    corner = np.array([[40.0, 20.0], [0.0, 20.0], [1.0, 1.0]])
    assert len(unseen(whole, corner, 0.5)) == 0
    assert 1 <= len(unseen(half, corner, 0.5)) <= 2
    assert unwatched(whole, 0.5) == []
    shorter = Exploration(HALL, 5.0, (0.0, 0.0), 2, whole.moves)
    assert len(unwatched(shorter, 0.5)) > 10


# --- Table 1 ------------------------------------------------------------------------------------
@pytest.mark.parametrize("theta_deg", [30, 60, 110])
@pytest.mark.parametrize("cover", list(Cover))
def test_rectangles_take_the_moves_of_table_1(cover, theta_deg):
    """The moves agree up to the ends of stripes, which the formulas leave out."""
    stripes, moves, range_m = 4, 15, 10.0
    theta = math.radians(theta_deg)
    pattern = Pattern(range_m, theta, cover=cover)
    x = math.floor(moves * range_m * math.sin(theta / 2.0) / GRID_M) * GRID_M
    y = math.floor(stripes * pattern.height_m / GRID_M) * GRID_M
    found = trapezoids.explore(Space([(0, 0), (x, 0), (x, y), (0, y)]), (0.0, 0.0), pattern)
    ours, paper = found.figures(), reckoned(cover, x, y, range_m, theta)
    assert ours.pieces == stripes
    assert 0 <= ours.steps - paper.steps <= 3 * stripes + 0.01
    # a stripe has one tip less, and those beside the two walls are cut off
    tip_m = 2.0 * range_m * (2.0 * math.sin(theta / 4.0) - math.sin(theta / 2.0))
    tips = stripes + moves if cover is Cover.DIAMONDS else 0
    short_m = pattern.height_m + tips * tip_m
    assert -0.01 <= paper.path_m - ours.path_m <= short_m + 0.01
    ends = 2.0 if cover is Cover.TRIANGLES else 3.0 * stripes
    assert -0.01 <= paper.turns_corrected - ours.turns <= ends + 0.01
    if cover is Cover.DIAMONDS:  # as printed it counts one stripe's turns
        assert paper.turns < paper.turns_corrected / 2.0


def test_more_robots_sweep_a_broader_stripe():
    hall = Space([(0, 0), (100, 0), (100, 34), (0, 34)])
    pieces = [
        trapezoids.explore(hall, (0.0, 0.0), Pattern(10.0, math.radians(60.0), robots))
        for robots in (2, 3, 5)
    ]
    assert [one.figures().pieces for one in pieces] == [4, 2, 1]
    assert all(one.figures().missed_m2 == pytest.approx(0.0, abs=1e-6) for one in pieces)


# --- who knows where it is ----------------------------------------------------------------------
@pytest.fixture(scope="module")
def ends():
    square = Space([(0, 0), (40, 0), (40, 40), (0, 40)])
    found = trapezoids.explore(square, (0.0, 0.0), Pattern(10.0, math.radians(60.0)))
    legs = list(legs_of(found))
    assert all(leg.watcher is not None for leg in legs)
    return [followed(found, Noise(), seed, legs=legs) for seed in range(60)]


@pytest.mark.parametrize("which", [0, 1], ids=["watched", "alone"])
@pytest.mark.parametrize("robot", [0, 1])
def test_estimated_errors_are_honest(ends, which, robot):
    """The sum of NEES is of chi square with 180 degrees of freedom: 99.9 % lie in 122 to 250."""
    assert 122.0 < sum(pair[which].nees(robot) for pair in ends) < 250.0


def test_watched_errors_are_at_most_a_tenth(ends):
    watched, alone = (
        math.sqrt(np.mean([pair[which].error_m(robot) ** 2 for pair in ends for robot in (0, 1)]))
        for which in (0, 1)
    )
    assert watched < alone / 10.0


def test_covariance_of_a_straight_path_is_that_by_hand():
    """3 % of the root of 100 m is 0.3 m ahead; 0.3 degrees of drift are 0.3 m aside / sqrt(3)."""
    noise = Noise(along_m=0.03, drift_rad=math.radians(0.3), turn_rad=0.0)
    alone = Filter(noise, (0.0, 0.0), [0.0])
    leg = Leg(0, 0.0, 100.0, (100.0, 0.0), 0.0, None)
    alone.reckon(np.array([0.0, 100.0, 0.0, 0.0]), leg)
    place, covariance = alone.known.place(0)
    aside = math.radians(0.3) ** 2 * 100.0**3 / 3.0
    assert place == pytest.approx([100.0, 0.0])
    assert covariance == pytest.approx(np.diag([0.09, aside]), abs=1e-9)


def test_a_common_turn_of_all_stays_unknown():
    """Measurements between robots do not increase their common knowledge of north."""
    noise = Noise(turn_rad=math.radians(3.0))
    both = Filter(noise, (0.0, 0.0), [0.0, 0.0])
    for robot, end in ((0, (10.0, 0.0)), (1, (0.0, 10.0))):
        leg = Leg(robot, 1.0, 10.0, end, 0.0, 1 - robot)
        both.reckon(np.array([0.0, 10.0, 0.0, 0.0]), leg)
    common = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0])
    information = []
    for measured in ([0.3, 9.8, 0.02], [-0.2, 10.1, -0.01], [0.5, 9.9, 0.03]):
        information.append(common @ np.linalg.solve(both.known.spread, common))
        both.watch(1, 0, np.array(measured))
    assert information == pytest.approx([information[0]] * 3)


# --- what is refused ----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("ring", "holes", "message"),
    [
        ([(0, 0), (1, 1)], [], "without area"),
        ([(0, 0), (4, 4), (4, 0), (0, 4)], [], "not a polygon"),
        ([(0, 0), (9, 0), (9, 9), (0, 9)], [[(20, 0), (21, 0), (21, 1)]], "not a polygon"),
        ([(0, 0), (math.inf, 0), (9, 9)], [], "finite"),
        ([(math.cos(i / 400), math.sin(i / 400)) for i in range(2500)], [], "more than"),
    ],
)
def test_ground_that_is_no_polygon_is_refused(ring, holes, message):
    with pytest.raises(AreaError, match=message):
        Space([(1000.0 * x, 1000.0 * y) for x, y in ring], holes)


def test_ranges_that_do_not_fit_are_refused():
    with pytest.raises(StrategyError, match="longer one"):
        trapezoids.explore(HALL, (0.0, 0.0), Pattern(1e-4, 1.0))
    with pytest.raises(StrategyError, match=r"44\.7 m wide"):
        triangulation.explore(HALL, (0.0, 0.0), 44.0)


def test_moves_through_known_ground_are_distinguished():
    found = trapezoids.explore(HALL, (0.0, 0.0), Pattern(10.0, math.radians(60.0)))
    figures = found.figures()
    known = sum(move.length_m for move in found.moves if move.why is Why.WAY)
    assert figures.known_path_m == known
    assert figures.turns == 4
