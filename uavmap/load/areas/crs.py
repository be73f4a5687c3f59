"""Coordinate reference systems of files, and coordinates in WGS84."""

from __future__ import annotations

import math
from typing import Final

import pyproj
from pyproj.exceptions import CRSError, ProjError

from missions.errors import AreaError
from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.load.areas.drawing import Area, Drawing, Layer, Points, Positions, Role, Shape

WGS84: Final = pyproj.CRS.from_epsg(4326)
_LONGEST: Final = 100_000


def crs_of_epsg(code: int, where: str) -> pyproj.CRS:
    """A system by its EPSG number. Raises `AreaError`."""
    try:
        return pyproj.CRS.from_epsg(code)
    except CRSError:
        raise AreaError(
            f"{where}: EPSG:{code} is not known; save the area in WGS84 (EPSG:4326)"
        ) from None


def crs_of_wkt(text: str, where: str) -> pyproj.CRS:
    """A system by its well-known text (of OGC or ESRI). Raises `AreaError`."""
    try:
        # a text of another kind could name files of grids
        return pyproj.CRS.from_wkt(text[:_LONGEST].strip().lstrip("\ufeff"))
    except CRSError:
        raise AreaError(
            f"{where}: the coordinate system {printable(text.strip(), 40)!r} is not known; save "
            "the area in WGS84 (EPSG:4326)"
        ) from None


def in_wgs84(layers: list[Layer], source: str, *, given: int | None, swap: bool) -> Drawing:
    """Return the drawing of a file in WGS84. Raises `AreaError`.

    `given` is the EPSG number for a file that names none; `swap` turns latitude, longitude round.
    """
    found: dict[Role, list[Area]] = {role: [] for role in Role}
    notices: list[str] = []
    for layer in layers:
        notices += layer.notices
        system = layer.crs
        if system is None and given is not None:
            system = crs_of_epsg(given, f"{source}: --crs")
        elif given is not None and system is not None:
            raise AreaError(
                f"{source}: --crs {given}, but the file says {_title(system)} itself; leave it out"
            )
        if system is None:
            _must_be_degrees(layer, source)
            notices.append("the file names no coordinate system; taken for WGS84")
        elif not system.equals(WGS84, ignore_axis_order=True):
            notices.append(f"coordinates are turned from {_title(system)} into WGS84")
        for shape in layer.shapes:
            found[shape.role].append(_area(shape, system or WGS84, source, swap))
    homes = found[Role.HOME]
    if len(homes) > 1:
        notices.append(f"{len(homes)} homes; taken: {homes[0].name}")
    return Drawing(
        source,
        tuple(found[Role.AREA]),
        tuple(found[Role.FENCE]),
        tuple(found[Role.KEEP_OUT]),
        homes[0].ring[0] if homes else None,
        tuple(dict.fromkeys(notices)),
    )


def _title(system: pyproj.CRS) -> str:
    code = system.to_epsg()
    return f"EPSG:{code}" if code is not None else printable(system.name, 40)


def _must_be_degrees(layer: Layer, source: str) -> None:
    for shape in layer.shapes:
        for x, y in shape.ring:
            if not (abs(x) <= 180.0 and abs(y) <= 180.0):
                raise AreaError(
                    f"{source}: {shape.name}: {x:g}, {y:g} are no degrees, and nothing says what "
                    "they are (a .prj beside the .shp would); give --crs EPSG, or save the area "
                    "in WGS84"
                )


def _area(shape: Shape, system: pyproj.CRS, source: str, swap: bool) -> Area:
    rings = [_places(shape, ring, system, source, swap) for ring in (shape.ring, *shape.holes)]
    return Area(shape.name, rings[0], tuple(rings[1:]))


def _places(shape: Shape, ring: Points, system: pyproj.CRS, source: str, swap: bool) -> Positions:
    where = f"{source}: {shape.name}"
    if not all(math.isfinite(x) and math.isfinite(y) for x, y in ring):
        raise AreaError(f"{where}: a coordinate is no finite number; draw it anew")
    if swap:
        ring = tuple((y, x) for x, y in ring)
    if not system.equals(WGS84, ignore_axis_order=True):
        ring = _turned(ring, system, where)
    for lon_deg, lat_deg in ring:
        if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
            raise AreaError(_out_of_range(where, lat_deg, lon_deg, swap))
    return tuple(LatLon(lat_deg, lon_deg) for lon_deg, lat_deg in ring)


def _turned(ring: Points, system: pyproj.CRS, where: str) -> Points:
    try:
        turn = pyproj.Transformer.from_crs(system, WGS84, always_xy=True)
        lons, lats = turn.transform([x for x, _ in ring], [y for _, y in ring])
    except (ProjError, CRSError):
        raise AreaError(
            f"{where}: {_title(system)} cannot be turned into WGS84; save the area in WGS84"
        ) from None
    if not all(map(math.isfinite, (*lons, *lats))):
        raise AreaError(
            f"{where}: {ring[0][0]:g}, {ring[0][1]:g} lie outside of {_title(system)}; is that the "
            "system of the file?"
        )
    return tuple(zip(map(float, lons), map(float, lats), strict=True))


def _out_of_range(where: str, lat_deg: float, lon_deg: float, swapped: bool) -> str:
    said = f"{where}: latitude {lat_deg:g}, longitude {lon_deg:g}: "
    if abs(lon_deg) <= 90.0 and abs(lat_deg) <= 180.0:
        turn = "leave out --swap" if swapped else "give --swap"
        return f"{said}they are swapped; {turn}, or write longitude first"
    if abs(lat_deg) > 180.0 or abs(lon_deg) > 360.0:
        return f"{said}these are metres, not degrees; save the area in WGS84 (EPSG:4326)"
    return f"{said}no place on earth; draw it anew"
