"""What must hold between the values of a mission file, and a reader that checks it all.

`missions.mission_file.schema` looks at one value at a time; here they are held against each
other: a box against the fence, a camera against the cells, a vehicle against the others. Every
fault is a line that names the file, the key, the value and the remedy, and all faults are
reported at once.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import pyproj
import shapely
from shapely.geometry import Point, Polygon
from shapely.validation import explain_validity

from missions.errors import MissionFileError
from missions.explorers import EXPLORERS
from missions.ground.geodesy import NORTH_LIMIT_DEG, SOUTH_LIMIT_DEG
from missions.ground.grid import Grid
from missions.mission_file.launch_pads import homes
from missions.mission_file.schema import Mission, Vertex, parse_fields, positions
from missions.units import GridPoint, LatLon

STRATEGIES = tuple(EXPLORERS)
DETECTORS = ("threshold", "paved")

FARTHEST_M = 50_000.0
"""No place of a mission lies farther from its start: nothing here flies that far."""

_SMALLEST_AREA_M2 = 0.01
_TOUCH_M = 0.01
"""A box may share an edge with the fence: decimals in the file are coarser than this."""


def parse_mission(
    text: str,
    source: str,
    *,
    strategies: Collection[str] = STRATEGIES,
    detectors: Collection[str] = DETECTORS,
) -> Mission:
    """A mission that can be flown, from the text of a mission file.

    Args:
        text: TOML.
        source: what to call the file in messages.
        strategies: names that `strategy` may have.
        detectors: names that `detector.name` may have.

    Raises:
        MissionFileError: with a line for each fault.
    """
    mission = parse_fields(text, source)
    check(mission, source, strategies=strategies, detectors=detectors)
    return mission


def check(
    mission: Mission,
    source: str,
    *,
    strategies: Collection[str] = STRATEGIES,
    detectors: Collection[str] = DETECTORS,
) -> None:
    """Raise `MissionFileError`, with a line for each fault, for a mission that cannot be flown.

    Places come first: while one of them is not a place near the start, or a polygon is not a
    polygon, lengths and areas mean nothing, and the geometry is not looked at.
    """
    faults = [
        *_names(mission, strategies, detectors),
        *_camera(mission),
        *_speeds(mission),
        *_team(mission),
    ]
    places = list(_places(mission))
    if not places:
        grid = Grid.at(mission.home, mission.grid.cell_m)
        drawn = _Drawn(grid)
        places = list(_polygons(mission, drawn)) or [
            *_inside(mission, drawn),
            *_apart(mission, grid),
        ]
    if faults or places:
        raise MissionFileError("\n".join(f"{source}: {fault}" for fault in [*places, *faults]))


# --- single values ---------------------------------------------------------------------------
def _names(
    mission: Mission, strategies: Collection[str], detectors: Collection[str]
) -> Iterator[str]:
    for key, name, known in (
        ("strategy", mission.strategy, strategies),
        ("detector.name", mission.detector.name, detectors),
    ):
        if name not in known:
            near = difflib.get_close_matches(name, list(known), n=1)
            guess = f"did you mean {near[0]!r}? " if near else ""
            yield f"{key} = {name!r}: unknown; {guess}known: {', '.join(sorted(known))}"


def _camera(mission: Mission) -> Iterator[str]:
    """A frame votes on a cell and its four neighbours, so it must show 3 x 3 cells whole."""
    camera, need_m = mission.camera, 3 * mission.grid.cell_m
    height_m = min(mission.altitude_m(i) for i in range(len(mission.vehicles)))
    across_m = 2 * height_m * math.tan(math.radians(camera.hfov_deg) / 2)
    along_m = across_m * camera.height_px / camera.width_px
    short_m = min(across_m, along_m)
    if short_m >= need_m:
        return
    ratio = need_m / short_m
    hfov_deg = math.degrees(2 * math.atan(ratio * across_m / 2 / height_m))
    remedies = [f"raise flight.altitude_m to {_up(height_m * ratio)}"]
    if hfov_deg < 170:
        remedies.append(f"use a camera of hfov_deg {_up(hfov_deg)}")
    yield (
        f"camera.hfov_deg = {camera.hfov_deg:g}: from {height_m:g} m a frame shows "
        f"{across_m:.1f} m x {along_m:.1f} m, but 3 x 3 cells of {mission.grid.cell_m:g} m need "
        f"{need_m:g} m each way; {' or '.join(remedies)} or shrink grid.cell_m to "
        f"{math.floor(short_m / 3 * 10 + 1e-9) / 10:g}"
    )


def _up(value: float) -> str:
    """Rounded up to a tenth, so that the remedy suffices."""
    return f"{math.ceil(value * 10 - 1e-9) / 10:g}"


def _speeds(mission: Mission) -> Iterator[str]:
    if mission.drift.speed_m_s >= mission.flight.speed_m_s:
        yield (
            f"drift.speed_m_s = {mission.drift.speed_m_s:g}: the region must drift slower than "
            f"the vehicles fly; raise flight.speed_m_s ({mission.flight.speed_m_s:g})"
        )


def _team(mission: Mission) -> Iterator[str]:
    team, vehicles = mission.team, mission.vehicles
    if len(vehicles) > 1 and team.layer_m <= team.separation_m:
        yield (
            f"team.layer_m = {team.layer_m:g}: layers must lie further apart than "
            f"team.separation_m ({team.separation_m:g}), for what vehicles waver in height"
        )
    seen: dict[str, int] = {}
    for i, vehicle in enumerate(vehicles):
        if vehicle.url is not None and (first := seen.setdefault(vehicle.url, i)) != i:
            yield (
                f"vehicles[{i}].url = {vehicle.url!r}: also the URL of vehicles[{first}]; "
                "give every vehicle its own"
            )


# --- places ----------------------------------------------------------------------------------
def _rings(mission: Mission) -> Iterator[tuple[str, tuple[Vertex, ...]]]:
    """Every ring of the file with its key."""
    yield "search.box", mission.search.box
    yield "fence.polygon", mission.fence.polygon
    for i, hole in enumerate(mission.fence.holes):
        yield f"fence.holes[{i}]", hole
    for i, region in enumerate(mission.sim.roi):
        yield f"sim.roi[{i}].polygon", region.polygon
        for k, hole in enumerate(region.holes):
            yield f"sim.roi[{i}].holes[{k}]", hole


def _places(mission: Mission) -> Iterator[str]:
    """Positions that no mission from this start can reach: one fault a key."""
    lat_deg, lon_deg = mission.start.position
    if not SOUTH_LIMIT_DEG <= lat_deg <= NORTH_LIMIT_DEG:
        yield _polar("start.position", (lat_deg, lon_deg))
        return
    geod = pyproj.Geod(ellps="WGS84")
    named = list(_rings(mission))
    named += [
        (f"vehicles[{i}].home", (vehicle.home,))
        for i, vehicle in enumerate(mission.vehicles)
        if vehicle.home is not None
    ]
    for key, ring in named:
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


@dataclass(frozen=True, slots=True)
class _Drawn:
    """Rings of the file as polygons in ground metres."""

    grid: Grid

    def polygon(self, ring: tuple[Vertex, ...]) -> Polygon:
        return Polygon([self.grid.fixed(place) for place in positions(ring)])

    def point(self, place: LatLon) -> Point:
        return Point(self.grid.fixed(place))


def _polygons(mission: Mission, drawn: _Drawn) -> Iterator[str]:
    for key, ring in _rings(mission):
        polygon = drawn.polygon(ring)
        if not polygon.is_valid and (polygon.area > 0 or len(set(ring)) > 3):
            yield (
                f"{key}: crosses or touches itself{_where(polygon, drawn.grid)}; list the "
                "corners in order, once around"
            )
        elif polygon.area < _SMALLEST_AREA_M2:
            yield f"{key}: has no area; it needs three corners that are not in a line"


def _where(polygon: Polygon, grid: Grid) -> str:
    """The place of the crossing in degrees, when GEOS names one."""
    _, bracket, coordinates = explain_validity(polygon).partition("[")
    if not bracket:
        return ""
    east, north = (float(part) for part in coordinates.rstrip("]").split()[:2])
    place = grid.position(GridPoint(east, north))
    return f" near [{place.lat_deg:.6f}, {place.lon_deg:.6f}]"


# --- inside the fence ------------------------------------------------------------------------
def _inside(mission: Mission, drawn: _Drawn) -> Iterator[str]:
    polygon = drawn.polygon(mission.fence.polygon)
    holes = [drawn.polygon(hole) for hole in mission.fence.holes]
    box = drawn.polygon(mission.search.box)
    outside = box.difference(polygon.buffer(_TOUCH_M))
    if not outside.is_empty:
        beyond_m = max(polygon.distance(Point(xy)) for xy in shapely.get_coordinates(outside))
        yield (
            f"search.box: not inside fence.polygon (up to {beyond_m:.1f} m outside); shrink the "
            "box or widen the fence"
        )
    for i, hole in enumerate(holes):
        if hole.buffer(_TOUCH_M).contains(box):
            yield f"search.box: lies wholly in fence.holes[{i}]; move the box or drop the hole"
    margin_m = mission.fence.margin_m
    for i, place in enumerate(homes(mission)):
        key = _home_key(mission, i)
        yield from _standing(key, drawn.point(place), place, polygon, holes, margin_m)
    for i, region in enumerate(mission.sim.roi):
        shell = drawn.polygon(region.polygon).buffer(_TOUCH_M)
        for k, ring in enumerate(region.holes):
            if not shell.contains(drawn.polygon(ring)):
                yield (
                    f"sim.roi[{i}].holes[{k}]: not inside sim.roi[{i}].polygon; a hole is cut "
                    "out of its polygon"
                )


def _home_key(mission: Mission, vehicle: int) -> str:
    if mission.vehicles[vehicle].home is not None:
        return f"vehicles[{vehicle}].home"
    return "start.position" if vehicle == 0 else f"vehicles[{vehicle}] (in the row from the start)"


def _standing(
    key: str,
    point: Point,
    place: LatLon,
    polygon: Polygon,
    holes: list[Polygon],
    margin_m: float,
) -> Iterator[str]:
    """A home must lie inside, and as far inside as legs are planned."""
    shown = f"{key} = {_show((place.lat_deg, place.lon_deg))}"
    if not polygon.contains(point):
        yield f"{shown}: outside fence.polygon; move it or widen the fence"
        return
    for i, hole in enumerate(holes):
        if hole.intersects(point):
            yield f"{shown}: inside fence.holes[{i}]; move it or shrink the hole"
            return
    gap_m = min(ring.exterior.distance(point) for ring in (polygon, *holes))
    if gap_m < margin_m:
        yield (
            f"{shown}: {gap_m:.1f} m from the fence, nearer than fence.margin_m "
            f"({margin_m:g}); move it, widen the fence or lower the margin"
        )


def _apart(mission: Mission, grid: Grid) -> Iterator[str]:
    """Vehicles take off and land side by side, so their homes keep the separation too."""
    points = [grid.fixed(place) for place in homes(mission)]
    for i, point in enumerate(points):
        for k in range(i):
            gap_m = point.distance_to(points[k])
            if gap_m < mission.team.separation_m:
                yield (
                    f"{_home_key(mission, i)}: {gap_m:.1f} m from {_home_key(mission, k)}, nearer "
                    f"than team.separation_m ({mission.team.separation_m:g}); move one of them"
                )
