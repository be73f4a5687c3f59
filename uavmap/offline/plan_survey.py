"""The mapped region as a survey of QGroundControl, to be flown once more with any tool.

A survey has one polygon, without holes: each part of the region is a survey of its own, and its
holes are flown over. The lines are computed here, around what the fence forbids; QGroundControl
computes them anew, without regard to the fence, as soon as somebody changes the survey there.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

import shapely
from shapely import affinity
from shapely.geometry import LineString, Polygon
from shapely.geometry import box as rectangle
from shapely.geometry.base import BaseGeometry

from missions.ground.footprint import Footprint
from missions.ground.lanes import Lane
from missions.mission_file.height_and_speed import speed_limits
from missions.mission_file.launch_pads import homes
from missions.mission_file.schema import Mission
from missions.mission_file.views import LEAST_M_S
from missions.state import Setting
from missions.units import Cell, GridPoint, LatLon
from uavmap.offline.plan_file import Survey, ring_of
from uavmap.offline.plan_items import Item, Profile, along, climb, way_back
from uavmap.results.outline import outline

_SENSOR_WIDTH_MM: Final = 6.17
"""Of the most common small sensor. Only its ratio to the focal length, which is set to give the
mission's angle of view, has an effect."""
_SHORTEST_M: Final = 0.5


@dataclass(frozen=True, slots=True)
class Overlap:
    """How much of a picture the next one along a line, and that of the next line, show again.

    In percent, 0 to 95.
    """

    front_percent: float = 75.0
    side_percent: float = 65.0


@dataclass(frozen=True, slots=True)
class SurveyFlight:
    """A flight over the mapped region, and what of the region it does without."""

    home: LatLon
    profile: Profile
    parts: tuple[Item | Survey, ...]
    holes: int
    """Dropped: they are flown over."""
    left_out: int
    """Parts of the region that no line inside the fence leads over."""

    @property
    def surveys(self) -> tuple[Survey, ...]:
        """One a part of the region that is flown over."""
        return tuple(part for part in self.parts if isinstance(part, Survey))

    @property
    def items(self) -> tuple[Item, ...]:
        """All mission items, those of the surveys among them."""
        return tuple(
            item
            for part in self.parts
            for item in (part.items if isinstance(part, Survey) else (part,))
        )


def survey_flight(
    setting: Setting,
    cells: Collection[Cell],
    t_s: float,
    *,
    height_m: float,
    overlap: Overlap,
    vehicle: int = 0,
) -> SurveyFlight:
    """The flight of a vehicle (from 0) over the region of these cells, as it lies at `t_s`."""
    mission, grid, fence = setting.mission, setting.grid, setting.fence
    footprint = mission.camera.optics.footprint(height_m)
    side_m, front_m = _steps_m(mission, footprint, overlap)
    profile = Profile(height_m, _speed_m_s(mission, height_m, front_m), front_m)
    home = homes(mission)[vehicle]
    shape = outline(cells, grid)
    drifted = affinity.translate(shape, grid.drift_east_m_s * t_s, grid.drift_north_m_s * t_s)
    at, left_out, holes = grid.fixed(home), 0, 0
    found: list[Item | Survey] = list(climb(home, profile))
    for part in getattr(drifted, "geoms", [drifted]):
        holes += len(part.interiors)
        lines, angle_rad = transects(Polygon(part.exterior), fence.inner, side_m)
        flown = along(lines, at, fence, grid, profile)
        if not flown.items:
            left_out += 1
            continue
        at = flown.last
        ring = [grid.position(GridPoint(x, y)) for x, y, *_ in part.exterior.coords]
        angle_deg = math.degrees(angle_rad + grid.convergence_rad)
        fields = _fields(
            ring, _half_turn(angle_deg), len(flown.ends) // 2,
            _camera(mission, height_m, side_m, front_m, overlap),
        )  # fmt: skip
        found.append(Survey(fields, flown.ends, flown.items))
    found += way_back(at, home, fence, grid, profile)
    return SurveyFlight(home, profile, tuple(found), holes, left_out)


def transects(
    polygon: Polygon, allowed: BaseGeometry, side_m: float
) -> tuple[tuple[Lane, ...], float]:
    """Lines over a polygon along its longer side, at most so far apart, back and forth.

    A line is as long as the polygon is anywhere in the strip that it stands for, so a slanting rim
    leaves no gap; what interrupts it for less than `side_m` is flown over. Lines are cut where
    `allowed` ends. Returns them with their bearing, clockwise from grid north.

    >>> square = Polygon([(0, 0), (40, 0), (40, 10), (0, 10)])
    >>> lines, bearing_rad = transects(square, square, 5.0)
    >>> len(lines), abs(round(math.degrees(bearing_rad)))
    (2, 90)
    """
    bearing_rad = _longer_side_rad(polygon)
    upright, room = _turned(polygon, bearing_rad), _turned(allowed, bearing_rad)
    west, south, east, north = upright.bounds
    count = max(1, math.ceil((east - west) / side_m))
    half_m = (east - west) / count / 2.0
    lines: list[Lane] = []
    for k in range(count):
        x = west + (2 * k + 1) * half_m
        strip = upright.intersection(rectangle(x - half_m, south - 1.0, x + half_m, north + 1.0))
        row: list[Lane] = []
        for low, high in _spans(strip, side_m):
            cut = room.intersection(LineString([(x, low), (x, high)]))
            ends = sorted((p.bounds[1], p.bounds[3]) for p in _lines_of(cut))
            row += [(_back(x, a, bearing_rad), _back(x, b, bearing_rad)) for a, b in ends]
        lines += [(end, start) for start, end in reversed(row)] if k % 2 else row
    return tuple(lines), bearing_rad


def _spans(strip: BaseGeometry, gap_m: float) -> list[tuple[float, float]]:
    """From where to where a strip is covered along y; gaps up to `gap_m` do not count."""
    found: list[tuple[float, float]] = []
    parts = (p for p in getattr(strip, "geoms", [strip]) if isinstance(p, Polygon))
    for low, high in sorted((part.bounds[1], part.bounds[3]) for part in parts):
        if found and low - found[-1][1] <= gap_m:
            low, high = found[-1][0], max(found.pop()[1], high)
        found.append((low, high))
    return found


def _lines_of(cut: BaseGeometry) -> list[LineString]:
    """The lines in what is left of a line, but for those too short to be flown."""
    parts = getattr(cut, "geoms", [cut])
    return [p for p in parts if isinstance(p, LineString) and p.length >= _SHORTEST_M]


def _longer_side_rad(polygon: Polygon) -> float:
    """The bearing of the longer side of the smallest rectangle around a polygon."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(polygon))
    (x0, y0), (x1, y1) = max(
        (corners[0:2], corners[1:3]), key=lambda side: math.dist(side[0], side[1])
    )
    return math.atan2(float(x1 - x0), float(y1 - y0))


def _turned(shape: BaseGeometry, bearing_rad: float) -> BaseGeometry:
    """A shape in the plane whose y axis is the bearing."""
    return affinity.rotate(shape, bearing_rad, origin=(0.0, 0.0), use_radians=True)


def _back(x: float, y: float, bearing_rad: float) -> GridPoint:
    """A point of the turned plane in the grid's."""
    cos, sin = math.cos(bearing_rad), math.sin(bearing_rad)
    return GridPoint(x * cos + y * sin, y * cos - x * sin)


def _half_turn(angle_deg: float) -> float:
    """The same line with an angle of -90 to 90 degrees."""
    return round(math.remainder(angle_deg, 180.0), 3)


def _landscape(mission: Mission) -> bool:
    """Whether the wide side of a picture lies across the way."""
    yaw_rad = math.radians(mission.camera.yaw_deg)
    return abs(math.cos(yaw_rad)) >= abs(math.sin(yaw_rad))


def _steps_m(mission: Mission, footprint: Footprint, overlap: Overlap) -> tuple[float, float]:
    """Metres between two lines, and between two pictures along one."""
    side_m, front_m = footprint if _landscape(mission) else reversed(footprint)
    return (
        side_m * (1.0 - overlap.side_percent / 100.0),
        front_m * (1.0 - overlap.front_percent / 100.0),
    )


def _speed_m_s(mission: Mission, height_m: float, front_m: float) -> float:
    """As fast as the mission flies, unless pictures blur then, or come too slowly."""
    limits = speed_limits(mission, height_m)
    return max(
        min(limits.flight_m_s, limits.blur_m_s, front_m / mission.camera.interval_s), LEAST_M_S
    )


# --- as QGroundControl writes it ----------------------------------------------------------------
def _fields(
    ring: list[LatLon], angle_deg: float, lines: int, camera: dict[str, Any]
) -> dict[str, Any]:
    """The object of a survey, but for its items."""
    return {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 5,
        "angle": angle_deg,
        "entryLocation": 0,
        "flyAlternateTransects": False,
        "splitConcavePolygons": False,
        "polygon": ring_of(ring),
        "TransectStyleComplexItem": {
            "version": 1,
            "CameraCalc": camera,
            "CameraShots": 0,  # QGroundControl counts them
            "CameraTriggerInTurnAround": False,
            "FollowTerrain": False,
            "HoverAndCapture": False,
            "Refly90Degrees": False,
            "TurnAroundDistance": 0,
        },
    }


def _camera(
    mission: Mission, height_m: float, side_m: float, front_m: float, overlap: Overlap
) -> dict[str, Any]:
    """The camera of the mission, as a custom camera."""
    camera = mission.camera
    focal_mm = _SENSOR_WIDTH_MM / 2.0 / math.tan(math.radians(camera.hfov_deg) / 2.0)
    pixel_mm = _SENSOR_WIDTH_MM / camera.width_px
    return {
        "version": 1,
        "CameraName": "Custom Camera",
        "SensorWidth": _SENSOR_WIDTH_MM,
        "SensorHeight": round(pixel_mm * camera.height_px, 4),
        "ImageWidth": camera.width_px,
        "ImageHeight": camera.height_px,
        "FocalLength": round(focal_mm, 4),
        "Landscape": _landscape(mission),
        "FixedOrientation": False,
        "MinTriggerInterval": 0,
        "ValueSetIsDistance": True,
        "DistanceToSurface": round(height_m, 3),
        "DistanceToSurfaceRelative": True,
        "ImageDensity": round(100.0 * height_m * pixel_mm / focal_mm, 4),
        "FrontalOverlap": overlap.front_percent,
        "SideOverlap": overlap.side_percent,
        "AdjustedFootprintSide": round(side_m, 4),
        "AdjustedFootprintFrontal": round(front_m, 4),
    }
