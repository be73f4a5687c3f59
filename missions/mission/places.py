"""The places of a mission: near the start, in valid polygons, inside the fence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import pyproj
import shapely
from shapely.geometry import Point, Polygon
from shapely.validation import explain_validity

from missions.geo.geodesy import NORTH_LIMIT_DEG, SOUTH_LIMIT_DEG
from missions.geo.grid import Grid
from missions.mission.schema import Mission, positions
from missions.mission.sections import PriorPlace, Vertex
from missions.mission.sim_section import SimRegion
from missions.planning.search.prior import Area, Spot
from missions.units import GridPoint, LatLon

SMALLEST_GAP_M = 8.0
"""Minimum gap between vehicles in a row: room for a person to swap a battery, m."""


def grid_of(mission: Mission) -> Grid:
    """Return the grid of a mission, which drifts with its region.

    Raises `GeodesyError` outside 80 S to 84 N.
    """
    drift = mission.drift
    return Grid.at(mission.home, mission.grid.cell_m, drift.speed_m_s, drift.toward_deg)


def homes(mission: Mission) -> tuple[LatLon, ...]:
    """Return the place of every vehicle, in the order of `mission.vehicles`.

    A vehicle without a `home` stands in a row from the start towards grid east, at the place of its
    number, `max(2 * separation_m, 8)` metres apart. Raises `GeodesyError` outside 80 S to 84 N.
    """
    grid = grid_of(mission)
    gap_m = max(2 * mission.team.separation_m, SMALLEST_GAP_M)
    return tuple(
        LatLon(*vehicle.home)
        if vehicle.home is not None
        # exactly the start, not its image through the projection and back
        else (grid.position(GridPoint(i * gap_m, 0.0)) if i else mission.home)
        for i, vehicle in enumerate(mission.vehicles)
    )


def home_heights_m(mission: Mission) -> tuple[float, ...]:
    """Return the height of every vehicle's home above the start, m.

    It is from the mission or its elevation model. Receivers on level ground differ by metres.
    """
    grid, surveyed = grid_of(mission), mission.surveyed
    return tuple(
        vehicle.home_height_m
        if vehicle.home_height_m is not None
        else (0.0 if surveyed is None else round(surveyed.height_m(grid.fixed(place)), 2))
        for vehicle, place in zip(mission.vehicles, homes(mission), strict=True)
    )


FARTHEST_M = 50_000.0
"""Maximum distance of a place from its mission's start, m."""

FAR_M = 2000.0
"""Distance of a home from the box beyond which the crew is warned, m: it cannot be seen."""

_SMALLEST_AREA_M2 = 0.01
_TOUCH_M = 0.01
"""Tolerance where a box shares an edge with the fence, m: decimals in the file are coarser."""


def _rings(mission: Mission) -> Iterator[tuple[str, tuple[Vertex, ...]]]:
    yield "search.box", mission.search.box
    yield "fence.polygon", mission.fence.polygon
    for i, hole in enumerate(mission.fence.holes):
        yield f"fence.holes[{i}]", hole
    drawn_as: dict[str, Sequence[PriorPlace | SimRegion]] = {
        "search.prior": mission.search.prior,
        "sim.roi": mission.sim.roi,
    }
    for key, shapes in drawn_as.items():
        for i, shape in enumerate(shapes):
            if shape.polygon is not None:
                yield f"{key}[{i}].polygon", shape.polygon
            for k, hole in enumerate(shape.holes):
                yield f"{key}[{i}].holes[{k}]", hole


def positions_near(mission: Mission) -> Iterator[str]:
    """Yield positions that no mission from this start can reach: one fault a key."""
    lat_deg, lon_deg = mission.start.position
    if not SOUTH_LIMIT_DEG <= lat_deg <= NORTH_LIMIT_DEG:
        yield _polar("start.position", (lat_deg, lon_deg))
        return
    geod = pyproj.Geod(ellps="WGS84")
    homes_given = [(f"vehicles[{i}].home", v.home) for i, v in enumerate(mission.vehicles)]
    prior = enumerate(mission.search.prior)
    spots = [(f"search.prior[{i}].position", place.position) for i, place in prior]
    single = [(key, (place,)) for key, place in (*homes_given, *spots) if place is not None]
    for key, ring in (*_rings(mission), *single):
        for vertex in ring:
            if not SOUTH_LIMIT_DEG <= vertex[0] <= NORTH_LIMIT_DEG:
                yield _polar(key, vertex)
                break
            away_m = geod.inv(lon_deg, lat_deg, vertex[1], vertex[0])[2]
            if away_m > FARTHEST_M:
                yield (
                    f"{key} = {_show(vertex)}: {away_m / 1000:.0f} km from start.position "
                    f"{_show((lat_deg, lon_deg))}; positions are [latitude, longitude]: are "
                    "latitude and longitude swapped?"
                )
                break


def _polar(key: str, vertex: Vertex) -> str:
    return (
        f"{key} = {_show(vertex)}: latitude {vertex[0]:g} is outside 80 S to 84 N, where UTM is "
        "defined; positions are [latitude, longitude]: are latitude and longitude swapped?"
    )


def _show(vertex: Vertex) -> str:
    return f"[{vertex[0]:.6g}, {vertex[1]:.6g}]"


def drawn(ring: tuple[Vertex, ...], grid: Grid) -> Polygon:
    """Return a ring of the file as a polygon in ground metres."""
    return Polygon([grid.fixed(place) for place in positions(ring)])


def polygons(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield rings that cross themselves or have no area."""
    for key, ring in _rings(mission):
        polygon = drawn(ring, grid)
        if not polygon.is_valid and (polygon.area > 0 or len(set(ring)) > 3):
            _, at = invalidity(polygon, grid)
            near = "" if at is None else f" near [{at.lat_deg:.6f}, {at.lon_deg:.6f}]"
            yield f"{key}: crosses or touches itself{near}; list the corners in order, once around"
        elif polygon.area < _SMALLEST_AREA_M2:
            yield f"{key}: has no area; it needs three corners that are not in a line"


def invalidity(polygon: Polygon, grid: Grid) -> tuple[str, LatLon | None]:
    """Return why a polygon is invalid, and near which place, if that is known."""
    reason, bracket, coordinates = explain_validity(polygon).partition("[")
    if not bracket:
        return reason, None
    east, north = (float(part) for part in coordinates.rstrip("]").split()[:2])
    return reason, grid.position(GridPoint(east, north))


# --- inside the fence ------------------------------------------------------------------------
def inside_fence(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield the box, homes and holes of a simulated region that are in a wrong place."""
    polygon = drawn(mission.fence.polygon, grid)
    holes = [drawn(hole, grid) for hole in mission.fence.holes]
    box = drawn(mission.search.box, grid)
    outside = box.difference(polygon.buffer(_TOUCH_M))
    if not outside.is_empty:
        beyond_m = max(polygon.distance(Point(xy)) for xy in shapely.get_coordinates(outside))
        yield (
            f"search.box: not inside fence.polygon (up to {beyond_m:.1f} m outside); shrink the "
            "box or widen the fence"
        )
    named = [hole_name(mission, i) for i in range(len(holes))]
    for name, hole in zip(named, holes, strict=True):
        if hole.buffer(_TOUCH_M).contains(box):
            yield f"search.box: lies wholly in {name}; move the box or drop the hole"
    margin_m = mission.fence.margin_m
    for i, place in enumerate(homes(mission)):
        key = home_key(mission, i)
        kept_out = dict(zip(named, holes, strict=True))
        yield from _standing(key, Point(grid.fixed(place)), place, polygon, kept_out, margin_m)
    for i, region in enumerate(mission.sim.roi):
        shell = drawn(region.polygon, grid).buffer(_TOUCH_M)
        for k, ring in enumerate(region.holes):
            if not shell.contains(drawn(ring, grid)):
                yield (
                    f"sim.roi[{i}].holes[{k}]: not inside sim.roi[{i}].polygon; a hole is cut "
                    "out of its polygon"
                )


def hole_name(mission: Mission, index: int) -> str:
    """The cause of a hole of the fence: a key of the file, or zones by name."""
    zones = [f"{zone.name!r} ({zone.why})" for zone in mission.fence.zones if index in zone.holes]
    return f"zone {' and '.join(zones)}" if zones else f"fence.holes[{index}]"


def holes_named(mission: Mission) -> str:
    """The causes of the holes of the fence, in short."""
    zones = [repr(zone.name) for zone in mission.fence.zones if zone.effect == "hole"]
    return f"fence.holes, with zone {', '.join(zones)}" if zones else "fence.holes"


def home_key(mission: Mission, vehicle: int) -> str:
    """Return the name of the home of a vehicle (from 0) in the file."""
    if mission.vehicles[vehicle].home is not None:
        return f"vehicles[{vehicle}].home"
    return "start.position" if vehicle == 0 else f"vehicles[{vehicle}] (in the row from the start)"


def _standing(
    key: str,
    point: Point,
    place: LatLon,
    polygon: Polygon,
    holes: Mapping[str, Polygon],
    margin_m: float,
) -> Iterator[str]:
    shown = f"{key} = {_show((place.lat_deg, place.lon_deg))}"
    if not polygon.contains(point):
        yield f"{shown}: outside fence.polygon; move it or widen the fence"
        return
    for name, hole in holes.items():
        if hole.intersects(point):
            yield f"{shown}: inside {name}; move it or shrink the hole"
            return
    rings = {"the fence": polygon, **holes}
    gap_m, name = min((ring.exterior.distance(point), name) for name, ring in rings.items())
    if gap_m < margin_m:
        yield (
            f"{shown}: {gap_m:.1f} m from {name}, nearer than fence.margin_m "
            f"({margin_m:g}); move it, widen the fence or lower the margin"
        )


def homes_apart(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield homes closer than the separation: vehicles take off and land side by side."""
    points = [grid.fixed(place) for place in homes(mission)]
    for i, point in enumerate(points):
        for k in range(i):
            gap_m = point.distance_to(points[k])
            if gap_m < mission.team.separation_m:
                yield (
                    f"{home_key(mission, i)}: {gap_m:.1f} m from {home_key(mission, k)}, nearer "
                    f"than team.separation_m ({mission.team.separation_m:g}); move one of them"
                )


def far_homes(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield homes so far from the box that their position may be a mistake."""
    box = drawn(mission.search.box, grid)
    for i, place in enumerate(homes(mission)):
        away_m = float(box.distance(Point(grid.fixed(place))))
        if away_m > FAR_M:
            yield (
                f"{home_key(mission, i)} = {_show((place.lat_deg, place.lon_deg))}: "
                f"{away_m / 1000:.1f} km from search.box; is that the place?"
            )


# --- the prior -------------------------------------------------------------------------------
FARTHEST_SPREADS: Final = 3.0
"""Distance from the box, in spreads, beyond which a point does not affect it."""


def prior_of(mission: Mission, grid: Grid) -> tuple[Spot | Area, ...]:
    """Return the places where the region may be, in the fixed frame; empty without a prior."""
    west, south, east, north = drawn(mission.search.box, grid).bounds
    spread_m = min(east - west, north - south) / 2.0
    return tuple(_on_ground(place, grid, spread_m) for place in mission.search.prior)


def _on_ground(place: PriorPlace, grid: Grid, spread_m: float) -> Spot | Area:
    if place.position is not None:
        point = grid.fixed(LatLon(*place.position))
        return Spot(point, place.spread_m or spread_m, place.weight)
    rings = (place.polygon or (), *place.holes)
    shell, *holes = ([grid.fixed(p) for p in positions(ring)] for ring in rings)
    return Area(Polygon(shell, holes), place.weight)


def prior_faults(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield faults of a prior outside the box, and of holes outside their polygon."""
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
