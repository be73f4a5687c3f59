"""Robots that watch each other, on many random polygons with holes; prints the faults.

    python -m tests.benchmarks.planning.cooperation         1000 polygons, Table 1, errors of places
    python -m tests.benchmarks.planning.cooperation --polygons 50

Every polygon is explored in stripes (by two robots with triangles or diamonds, or by a column of
three to five) and in triangles. Three checks follow. Was every observed point and corner within
range and sight of some robot? Did a standing robot always see the one that moved? Was each part
seen before it was mapped? The exit code is 1 if a check failed.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from missions.lab.cooperation import trapezoids, triangulation
from missions.lab.cooperation.exploration import Exploration, Move, along, unseen
from missions.lab.cooperation.space import Point, Space
from missions.lab.cooperation.tracking import Noise, followed, legs_of
from missions.lab.cooperation.trapezoids import Cover, Pattern
from tests.benchmarks.frame import head, options_of, row
from tests.support.ground.polygons import random_space, random_start
from uavmap.lab.studies.two_robots import Covering, covered

POINTS = 120
SPACING = 1.0 / 20.0
"""Distance between two checks of sight along a robot's path, as a share of the range."""
BORDER_M = 3.0


def in_stripes(space: Space, seed: int) -> Exploration:
    """Explore a ground in stripes, in a random pattern."""
    rng = np.random.default_rng((seed, 1))
    robots = int(rng.integers(2, 6))
    cover = Cover.DIAMONDS if robots == 2 and rng.random() < 0.5 else Cover.TRIANGLES
    theta = math.radians(rng.uniform(10.0, 120.0))
    pattern = Pattern(float(rng.uniform(5.0, 25.0)), theta, robots, cover)
    return trapezoids.explore(space, random_start(space, seed), pattern)


def in_triangles(space: Space, seed: int) -> Exploration:
    """Explore a ground in triangles, with a range that just covers it."""
    return triangulation.explore(space, random_start(space, seed), space.diameter_m)


def points_in(space: Space, seed: int, wanted: int) -> NDArray[np.float64]:
    """Return points in a ground, and its corners."""
    west, south, east, north = space.polygon.bounds
    some = np.random.default_rng((seed, 2)).uniform((west, south), (east, north), (8 * wanted, 2))
    inside = some[shapely.contains_xy(space.polygon, some)][:wanted]
    return np.vstack([inside, np.array(space.corners)])


def mapped_unseen(exploration: Exploration, pieces: int) -> int:
    """Return the number of pieces that had a point of the border unseen when they were mapped."""
    count = 0
    step = max(len(exploration.pieces) // pieces, 1)
    for piece in exploration.pieces[::step]:
        ring = shapely.LinearRing(piece.outline).segmentize(BORDER_M)
        until = replace(exploration, moves=exploration.moves[: piece.moves])
        spacing_m = exploration.range_m * SPACING
        count += bool(len(unseen(until, shapely.get_coordinates(ring), spacing_m)))
    return count


def unwatched(exploration: Exploration, spacing_m: float) -> list[tuple[Move, Point]]:
    """Return places of a moving robot without a standing one within range and sight.

    The checks are every `spacing_m` along the paths, and at the ends of legs.
    """
    found = []
    most_m = exploration.range_m * (1.0 + 1e-9)
    for move, standing in exploration.standing():
        others = [place for robot, place in enumerate(standing) if robot != move.robot]
        for point, _ in along(move, spacing_m):
            near = sorted(others, key=lambda place: math.dist(place, point))
            if not any(
                math.dist(place, point) <= most_m and exploration.space.sees(place, point)
                for place in near
            ):
                found.append((move, point))
    return found


def faults(exploration: Exploration, seed: int, points: int = POINTS, pieces: int = 4) -> list[str]:
    """Return the faults of an exploration."""
    found = []
    space, spacing_m = exploration.space, exploration.range_m * SPACING
    if exploration.figures().missed_m2 > 1e-6 * space.area_m2:
        found.append("area missing from the map")
    if len(unseen(exploration, points_in(space, seed, points), spacing_m)):
        found.append("points unseen")
    if unwatched(exploration, exploration.range_m / 5.0):
        found.append("a robot moved unwatched")
    if mapped_unseen(exploration, pieces):
        found.append("mapped before it was seen")
    return found


def many(polygons: int) -> bool:
    """Explore many polygons; return whether all checks hold."""
    failed: Counter[str] = Counter()
    holes = corners = 0
    begin_s = said_s = time.monotonic()
    for seed in range(polygons):
        space = random_space(seed)
        holes, corners = holes + len(space.rings) - 1, corners + len(space.corners)
        for name, explore in (("stripes", in_stripes), ("triangles", in_triangles)):
            try:
                wrong = faults(explore(space, seed), seed)
            except Exception as error:  # it is counted, and the next polygon follows
                wrong = [f"{type(error).__name__}: {error}"]
            for what in wrong:
                failed[f"{name}: {what}"] += 1
                print(f"polygon {seed}, {name}: {what}")
        if time.monotonic() - said_s > 30.0:
            said_s = time.monotonic()
            print(f"{seed + 1} of {polygons}", file=sys.stderr)
    took_s = time.monotonic() - begin_s
    print(
        f"{polygons} polygons, {corners / polygons:.1f} corners and {holes / polygons:.1f} holes "
        f"each: {sum(failed.values())} faults ({took_s:.0f} s)"
    )
    return not failed


def table_1() -> None:
    """Print the rectangles of the study."""
    print(head("covering", "theta", "path off %", "steps off %", "turns off % (corrected)"))
    for cover, theta in itertools.product(Cover, (20, 60, 90, 120)):
        ours = covered(Covering(cover, theta, 20, 100))
        said = ours.formula
        pairs = (
            (ours.path_m, said.path_m),
            (ours.steps, said.steps),
            (ours.turns, said.turns_corrected),
        )
        print(row(cover, theta, *(f"{100.0 * (a / b - 1.0):.2f}" for a, b in pairs)))


def places(runs: int) -> None:
    """Print errors of places, watched and alone, for trackers of several qualities."""
    hall = Space([(0, 0), (80, 0), (80, 80), (0, 80)])
    exploration = trapezoids.explore(hall, (0.0, 0.0), Pattern(10.0, math.radians(60.0)))
    legs = list(legs_of(exploration))
    # Wilson and Hilferty's approximation of chi square, for the mean of as many runs
    free = 3.0 * runs
    low, high = (
        3.0 * (1.0 - 2.0 / (9.0 * free) + z * math.sqrt(2.0 / (9.0 * free))) ** 3
        for z in (-1.96, 1.96)
    )
    path_m = exploration.figures().path_m
    print(f"80 m square, {path_m:.0f} m, {runs} runs; 95 % of means of NEES lie")
    print(f"between {low:.2f} and {high:.2f}")
    columns = ("watched m", "alone m", "ratio", "NEES watched", "alone (robot 1)")
    print(head("tracker, deg", *columns))
    for degrees in (0.02, 0.05, 0.1, 0.2, 0.5):
        angle = math.radians(degrees)
        noise = replace(Noise(), bearing_rad=angle, heading_rad=angle)
        ends = [followed(exploration, noise, seed, legs=legs) for seed in range(runs)]
        watched, alone = (
            math.sqrt(np.mean([pair[which].error_m(0) ** 2 for pair in ends])) for which in (0, 1)
        )
        nees = (np.mean([pair[which].nees(0) for pair in ends]) for which in (0, 1))
        figures = (f"{value:.2f}" for value in (watched, alone, alone / watched, *nees))
        print(row(degrees, *figures))


def main() -> int:
    """Print all tables."""
    options = options_of(__doc__, polygons=1000, runs=200)
    table_1()
    places(options.runs)
    return 0 if many(options.polygons) else 1


if __name__ == "__main__":
    raise SystemExit(main())
