"""The prior of a mission file on the ground, and whether it has to do with the box."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from shapely.geometry import Point, Polygon

from missions.geo.grid import Grid
from missions.mission.places import drawn
from missions.mission.schema import Mission, positions
from missions.mission.sections.search_sections import PriorPlace
from missions.planning.search.prior import Area, Spot
from missions.units import LatLon

FARTHEST_SPREADS: Final = 3.0
"""A point so many spreads from the box says next to nothing of what is in it."""


def prior_of(mission: Mission, grid: Grid) -> tuple[Spot | Area, ...]:
    """The places where the region may be, in the fixed frame; empty without a prior."""
    spread_m = default_spread_m(mission, grid)
    return tuple(_on_ground(place, grid, spread_m) for place in mission.search.prior)


def default_spread_m(mission: Mission, grid: Grid) -> float:
    """Of a point that has none of its own: half of the box's shorter side, along the grid."""
    west, south, east, north = drawn(mission.search.box, grid).bounds
    return min(east - west, north - south) / 2.0


def _on_ground(place: PriorPlace, grid: Grid, spread_m: float) -> Spot | Area:
    if place.position is not None:
        point = grid.fixed(LatLon(*place.position))
        return Spot(point, place.spread_m or spread_m, place.weight)
    rings = (place.polygon or (), *place.holes)
    shell, *holes = ([grid.fixed(p) for p in positions(ring)] for ring in rings)
    return Area(Polygon(shell, holes), place.weight)


def prior_faults(mission: Mission, grid: Grid) -> Iterator[str]:
    """Of a prior that says nothing of the box, and of holes that do not lie in their polygon."""
    if not mission.search.prior:
        return
    box, outside = drawn(mission.search.box, grid), True
    for i, part in enumerate(prior_of(mission, grid)):
        if isinstance(part, Spot):
            away_m = float(box.distance(Point(part.place)))
            outside &= away_m > FARTHEST_SPREADS * part.spread_m
            continue
        if not part.polygon.is_valid:
            yield (
                f"search.prior[{i}].holes: not inside search.prior[{i}].polygon, or on one "
                "another; a hole is cut out of its polygon"
            )
            return
        outside &= not part.polygon.intersection(box).area > 0.0
    if outside:
        yield (
            "search.prior: lies outside of search.box; move it, widen its spread_m, or leave it "
            "out (positions are [latitude, longitude]: are they swapped?)"
        )
