"""The layers of a map: the region, tracks and frames, and the plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Point, Polygon
from shapely.geometry.polygon import orient

from missions.geo.geodesy import NORTH_LIMIT_DEG, SOUTH_LIMIT_DEG
from missions.geo.grid import Grid
from missions.mission.places import homes
from uavmap.base.printable import printable
from uavmap.base.version import __version__
from uavmap.journal.kept_frames import KeptFrame, read_kept
from uavmap.output.facts.flight_log import Fix
from uavmap.output.facts.flown_mission import BoundaryFacts, FlownMission
from uavmap.output.facts.map_model import CellTable, drift_m
from uavmap.output.formats.layers import Field, Layer, Row, Shapes, Value


def layers(flown: FlownMission) -> list[Layer]:
    """Create every layer of a map that has rows; the region always has one."""
    found = [
        _region(flown),
        *([] if flown.boundary is None else [_boundary(flown, flown.boundary)]),
        _cells(flown),
        _classes(flown),
        _tracks(flown),
        _track_points(flown),
        _frames(flown),
        _unsearched(flown),
        _fence(flown),
        _places(flown),
    ]
    return [layer for layer in found if next(layer.rows, None) is not None]


# --- the ground ----------------------------------------------------------------------------------
def _projected(grid: Grid, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project points of the fixed frame to metres; heights do not change."""
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    return np.column_stack([(origin + points[:, :2] * grid.scale).round(3), points[:, 2:]])


def _of_region(flown: FlownMission, shapes: Any) -> Shapes:
    grid, drift = flown.data.grid, drift_m(flown.data.grid, flown.data.t_s)
    moved = shapely.transform(shapes, lambda points: _projected(grid, points + drift))
    return np.atleast_1d(np.array(moved, dtype=object))


def _of_ground(flown: FlownMission, shapes: Sequence[Any], *, heights: bool = False) -> Shapes:
    grid = flown.data.grid
    array = np.empty(len(shapes), dtype=object)
    array[:] = shapes
    moved: Shapes = shapely.transform(
        array, lambda points: _projected(grid, points), include_z=heights
    )
    return moved


def _points(flown: FlownMission, points: Sequence[tuple[float, ...]]) -> Shapes:
    places = np.array(points, dtype=np.float64).reshape(-1, 3)
    return np.array(shapely.points(_projected(flown.data.grid, places)), dtype=object)


def _whole(shape: Polygon | MultiPolygon) -> MultiPolygon:
    return shape if isinstance(shape, MultiPolygon) else MultiPolygon([shape])


# --- what was found ------------------------------------------------------------------------------
_KINDS: Final = {
    "text": "name mission finding crs version state picture place_by kind class",
    "whole": "number cells parts holes open_cells column row positive votes vehicle sortie",
    "number": "area_m2 area_low area_high litres_low litres_max perim_m uncert_m open_m belief "
    "start_s end_s length_m t_s height_m charge_wh",
    "yes or no": "completed simulated region",
    "time": "begun_utc utc start_utc end_utc",
}
"""Names of columns by their kind."""
_KIND_OF: Final = {name: kind for kind, names in _KINDS.items() for name in names.split()}
_ABOUT: Final = "t_s utc crs version"


def _fields(names: str) -> tuple[Field, ...]:
    return tuple(Field(name, _KIND_OF[name]) for name in names.split())


def _about(flown: FlownMission) -> Row:
    t_s = flown.data.t_s
    return (round(t_s, 3), flown.calendar.utc(t_s), flown.crs, __version__)


def _region(flown: FlownMission) -> Layer:
    data, found = flown.data, flown.extent
    shape = found.outline
    shapes = np.array([None], dtype=object)
    if not shape.is_empty:
        shapes = _of_region(flown, _whole(shape))
    row: Row = (
        "region", data.mission, flown.completed, printable(str(flown.values.get("finding", ""))),
        int(np.count_nonzero(data.cells.roi)), round(found.area_m2, 1), round(found.low_m2, 1),
        round(found.high_m2, 1), round(found.perimeter_m, 1), found.parts, found.holes,
        found.open_cells, flown.calendar.utc(0.0), flown.simulated,
    )  # fmt: skip
    fields = _fields(
        "name mission completed finding cells area_m2 area_low area_high perim_m parts holes "
        f"open_cells begun_utc simulated {_ABOUT}"
    )
    rows = [(*row, *_about(flown))]
    return Layer.whole("region", "Region", "MultiPolygon", fields, shapes, rows)


def _boundary(flown: FlownMission, facts: BoundaryFacts) -> Layer:
    shapes = np.array([None], dtype=object)
    if not facts.region.is_empty:
        shapes = _of_ground(flown, [_whole(facts.region)])
    fields = _fields(f"name area_m2 area_low area_high perim_m uncert_m open_m {_ABOUT}")
    rows: list[Row] = [(
        "boundary", facts.area_m2, facts.low_m2, facts.high_m2, facts.length_m, facts.uncertainty_m,
        facts.open_m, *_about(flown),
    )]  # fmt: skip
    return Layer.whole("boundary", "Boundary by pixels", "MultiPolygon", fields, shapes, rows)


def _cells(flown: FlownMission) -> Layer:
    data, names = flown.data, [one.name for one in flown.data.class_areas]
    fields = _fields("column row state region positive votes belief" + " class" * bool(names))
    half_m = data.grid.cell_m / 2.0

    def parts() -> Iterator[tuple[Shapes, Iterator[Row]]]:
        drift = drift_m(data.grid, data.t_s)
        for table in data.cells.parts():
            middle = data.grid.cell_m * table.cells.astype(np.float64)
            # the axes of the grid are the axes of the projection
            low, high = (_projected(data.grid, middle + m + drift) for m in (-half_m, half_m))
            yield np.array(shapely.box(*low.T, *high.T), dtype=object), _cell_rows(table, names)

    return Layer("cells", "Cells", "Polygon", False, fields, parts)


def _cell_rows(table: CellTable, names: Sequence[str]) -> Iterator[Row]:
    columns = table.classes.tolist()
    for values, roi, column in zip(table.values(), table.roi.tolist(), columns, strict=True):
        (east, north), state, positive, votes, belief = values
        facts = None if belief is None else round(belief, 3)
        row: Row = (east, north, state, roi, positive, votes, facts)
        yield (*row, None if column < 0 else names[column]) if names else row


def _classes(flown: FlownMission) -> Layer:
    """Create the classes of the region, by number; empty for a detector without classes."""
    found = [one for one in flown.data.class_areas if one.cells]
    shapes = [_of_region(flown, _whole(one.outline)) for one in found]
    rows: list[Row] = []
    for one in found:
        litres = one.volume_l or (None, None)
        figures = one.area_m2, one.low_m2, one.high_m2, *litres
        rows.append((
            one.name, one.number, len(one.cells),
            *(None if value is None else round(value, 3) for value in figures), *_about(flown),
        ))  # fmt: skip
    fields = _fields(f"name number cells area_m2 area_low area_high litres_low litres_max {_ABOUT}")
    merged = np.concatenate(shapes) if shapes else np.array([], dtype=object)
    return Layer("classes", "Classes", "MultiPolygon", False, fields, lambda: [(merged, rows)])


# --- tracks and frames ---------------------------------------------------------------------------
def _tracks(flown: FlownMission) -> Layer:
    fields = _fields("name vehicle sortie start_s end_s start_utc end_utc length_m")
    lines, rows = [], list[Row]()
    for vehicle, sortie, points in track_lines(flown):
        there = np.array([(*fix.place, fix.height_m) for fix in points])
        length_m = float(np.hypot(*np.diff(there[:, :2], axis=0).T).sum())
        start_s, end_s = points[0].t_s, points[-1].t_s
        lines.append(shapely.linestrings(there))
        rows.append((
            f"vehicle {vehicle}, sortie {sortie}", vehicle, sortie, round(start_s, 3),
            round(end_s, 3), flown.calendar.utc(start_s), flown.calendar.utc(end_s),
            round(length_m, 1),
        ))  # fmt: skip
    shapes = _of_ground(flown, lines, heights=True)
    return Layer.whole("tracks", "Tracks", "LineString", fields, shapes, rows, heights=True)


def track_parts(flown: FlownMission) -> list[tuple[int, int, list[Fix]]]:
    """Return vehicle, sortie and places in the air; for recorded pictures, all places."""
    fixes = flown.log.fixes
    if flown.recorded:
        return [(vehicle, 1, list(found)) for vehicle, found in sorted(fixes.items())]
    return [(s.vehicle, s.number, flown.log.fixes_of(s)) for s in flown.log.sorties()]


def track_lines(flown: FlownMission) -> list[tuple[int, int, list[Fix]]]:
    """Return the parts of `track_parts` that make a line: the rows of the layer of tracks."""
    return [part for part in track_parts(flown) if len(part[2]) > 1]


def _track_points(flown: FlownMission) -> Layer:
    fields = _fields("vehicle sortie t_s utc height_m charge_wh")
    points, rows = list[tuple[float, ...]](), list[Row]()
    for vehicle, sortie, fixes in track_parts(flown):
        for fix in fixes:
            points.append((*fix.place, fix.height_m))
            charge: Value = None if flown.recorded else round(fix.remaining_wh, 2)
            utc = flown.calendar.utc(fix.t_s)
            rows.append((vehicle, sortie, round(fix.t_s, 3), utc, round(fix.height_m, 2), charge))
    shapes = _points(flown, points)
    return Layer.whole("track_points", "Track points", "Point", fields, shapes, rows, heights=True)


def _frames(flown: FlownMission) -> Layer:
    """Create the judged frames, at their kept pose, or else at the place by telemetry."""
    fields = _fields("vehicle t_s utc height_m cells positive picture place_by")
    kept = kept_by_time(flown)
    by_telemetry = "picture" if flown.recorded else "telemetry"
    courses = {
        vehicle: np.array([(f.t_s, *f.place, f.height_m) for f in fixes]).T
        for vehicle, fixes in flown.log.fixes.items()
    }
    points, rows = list[tuple[float, ...]](), list[Row]()
    for frame in flown.log.frames:
        own = kept.get((frame.vehicle, round(frame.t_s, 3)))
        if own is not None:
            place = flown.data.grid.fixed(own.pose.position)
            point, by, name = (*place, own.pose.height_m), "pose", PurePath(own.frame).name
        elif (course := courses.get(frame.vehicle)) is not None:
            times, *parts = course
            east_m, north_m, height_m = (float(np.interp(frame.t_s, times, p)) for p in parts)
            point, by, name = (east_m, north_m, height_m), by_telemetry, ""
        else:
            continue
        points.append(point)
        rows.append((
            frame.vehicle, round(frame.t_s, 3), flown.calendar.utc(frame.t_s), round(point[2], 2),
            frame.cells, frame.positive, printable(name) or None, by,
        ))  # fmt: skip
    shapes = _points(flown, points)
    return Layer.whole("frames", "Judged frames", "Point", fields, shapes, rows, heights=True)


def kept_by_time(flown: FlownMission) -> dict[tuple[int, float], KeptFrame]:
    """Return a flight's kept frames with a valid place, by vehicle and time."""
    if flown.recorded:
        return {}
    try:
        frames = [kept for kept in read_kept(flown.folder) if not isinstance(kept, str)]
    except (OSError, UnicodeDecodeError):  # without them places come from telemetry
        return {}
    return {
        (kept.vehicle, round(kept.t_s, 3)): kept
        for kept in frames
        if SOUTH_LIMIT_DEG <= kept.pose.position.lat_deg <= NORTH_LIMIT_DEG
        and abs(kept.pose.position.lon_deg) <= 360.0
        and all(map(math.isfinite, (kept.t_s, kept.pose.height_m)))
    }


# --- what was planned ----------------------------------------------------------------------------
def _unsearched(flown: FlownMission) -> Layer:
    fixed = flown.data.grid.fixed
    lines = [shapely.linestrings(list(map(fixed, lane))) for lane in flown.data.unsearched]
    rows = [(f"lane {number}, without a judged frame",) for number in range(1, len(lines) + 1)]
    shapes = _of_ground(flown, lines)
    return Layer.whole("unsearched", "Not searched", "LineString", _fields("name"), shapes, rows)


def _fence(flown: FlownMission) -> Layer:
    """Create the fence and the box; a replay without a mission has neither."""
    data, fixed = flown.data, flown.data.grid.fixed
    holes = [list(map(fixed, hole)) for hole in data.fence_holes]
    fence = orient(Polygon(list(map(fixed, data.fence)), holes))
    box = orient(Polygon(list(map(fixed, data.box))))
    named: list[Row] = [("geofence", "fence"), ("search box", "box")]
    drawn = [(s, row) for s, row in zip((fence, box), named, strict=True) if not s.is_empty]
    shapes, rows = _of_ground(flown, [shape for shape, _ in drawn]), [row for _, row in drawn]
    fields = _fields("name kind")
    return Layer.whole("fence", "Geofence and search box", "Polygon", fields, shapes, rows)


def _places(flown: FlownMission) -> Layer:
    """Create the start of recorded pictures, or the last reported homes of a flight."""
    grid, planned = flown.data.grid, homes(flown.setting.mission)
    fields = _fields("name vehicle")
    if flown.recorded:
        shapes = _of_ground(flown, [Point(grid.fixed(flown.data.start))])
        return Layer.whole("places", "Start", "Point", fields, shapes, [("start", None)])
    shown = {number: grid.fixed(place) for number, place in enumerate(planned, start=1)}
    shown |= flown.log.homes
    points = [Point(place) for place in shown.values()]
    rows: list[Row] = [(f"home of vehicle {number}", number) for number in shown]
    return Layer.whole("places", "Homes", "Point", fields, _of_ground(flown, points), rows)
