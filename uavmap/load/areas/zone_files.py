"""Zones of authorities in files: ED-269 JSON, ED-318 GeoJSON, and plain GeoJSON.

If a part of a zone is not understood, the stricter meaning counts. Such parts are heights without
a known unit or reference, and times at which the zone applies. A zone without a readable place is
an error.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from shapely.geometry import Point, Polygon

from missions.errors import AreaError, MissionFileError
from uavmap.base.printable import printable
from uavmap.base.text_files import read_text
from uavmap.load.areas.drawing import WGS84
from uavmap.load.areas.geojson import system_of

MAX_BYTES: Final = 100_000_000
"""Maximum size of a file, bytes: files of whole countries have about 20 MB."""
_DEEPEST: Final = 20
_MOST: Final = 1e9
_UNITS_M: Final = {"M": 1.0, "FT": 0.3048}
REFERENCES: Final = ("AGL", "AMSL", "WGS84")
"""Known references of heights."""
_RESTRICTIONS: Final = {
    "PROHIBITED": "prohibited",
    "REQ_AUTHORISATION": "needs an authorisation",
    "REQ_AUTHORIZATION": "needs an authorisation",
    "CONDITIONAL": "conditional",
    "USPACE": "U-space",
}
UNRESTRICTED: Final = "NO_RESTRICTION"
_NAMES: Final = ("name", "title", "label", "identifier", "id")


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit in height; None as `reference`: it is not known."""

    height_m: float
    reference: str | None

    def __str__(self) -> str:
        return f"{self.height_m:g} m {self.reference or 'of an unknown reference'}"


@dataclass(frozen=True, slots=True)
class Volume:
    """A part of a zone: a polygon in degrees, longitude first, or a circle around a point."""

    shape: Polygon | Point
    radius_m: float = 0.0
    lower: Limit | None = None
    """Lower limit; None: from the ground, or not understood."""
    upper: Limit | None = None


@dataclass(frozen=True, slots=True)
class FileZone:
    """A zone as its file describes it."""

    ident: str
    name: str
    restriction: str
    """The restriction in words; empty if its file has none."""
    volumes: tuple[Volume, ...]
    limited_times: bool
    """True if it applies only at some times."""


def read_zones(path: Path, where: str) -> list[FileZone]:
    """Read the zones of a file. Raises `MissionFileError`, which begins with `where`."""
    try:
        root = json.loads(read_text(path, MAX_BYTES))
    except OSError as error:
        raise MissionFileError(
            f"{where}: cannot be read ({error.strerror}); give the path of a file of zones from "
            "the folder of the mission file"
        ) from None
    except (ValueError, RecursionError) as error:
        raise MissionFileError(f"{where}: not JSON ({printable(str(error), 80)})") from None
    features = root.get("features") if isinstance(root, Mapping) else None
    if not isinstance(features, list):
        raise MissionFileError(
            f"{where}: no list of features; give ED-269 JSON, ED-318 GeoJSON, or a GeoJSON "
            "FeatureCollection"
        )
    try:
        system = system_of(root.get("crs"), where)
    except AreaError as error:
        raise MissionFileError(str(error)) from None
    if system != WGS84:
        raise MissionFileError(f"{where}: crs: save the zones in WGS84 (EPSG:4326)")
    found = [_zone(feature, i, f"{where}: features[{i}]") for i, feature in enumerate(features)]
    return [zone for zone in found if zone is not None]


def _zone(feature: object, index: int, where: str) -> FileZone | None:
    """Return a zone; None for a zone without a restriction or an area."""
    if not isinstance(feature, Mapping):
        raise MissionFileError(f"{where}: no feature")
    properties = feature.get("properties")
    values = properties if isinstance(properties, Mapping) else feature
    named = [text for key in _NAMES if (text := _text(values.get(key)))]
    restriction = str(values.get("restriction") or values.get("type") or "").upper()
    if restriction == UNRESTRICTED:
        return None
    applies = values.get("applicability") or values.get("limitedApplicability") or []
    volumes = tuple(_volumes(feature.get("geometry"), where, _DEEPEST))
    if not volumes:
        if restriction in _RESTRICTIONS:
            raise MissionFileError(f"{where}: a zone without an area; give a polygon or a circle")
        return None
    times = applies if isinstance(applies, list) else [applies]
    return FileZone(
        _text(values.get("identifier")),
        named[0] if named else f"zone {index + 1}",
        _RESTRICTIONS.get(restriction, ""),
        volumes,
        any(map(_is_limited, times)),
    )


def _text(value: object) -> str:
    """Return a name; if a file has one for each language, the English or the first one."""
    if isinstance(value, list):
        texts = [one for one in value if isinstance(one, Mapping)]
        english = [one for one in texts if str(one.get("lang", "")).startswith("en")]
        value = next((one.get("text") for one in (*english, *texts)), None)
    known = isinstance(value, str | int) and not isinstance(value, bool)
    return printable(str(value), 80).strip() if known else ""


def _is_limited(applies: object) -> bool:
    if not isinstance(applies, Mapping):
        return True
    return str(applies.get("permanent", "")).upper() != "YES" and bool(applies)


def _volumes(geometry: object, where: str, depth: int) -> Iterator[Volume]:
    if isinstance(geometry, list):  # ED-269 has several
        for part in geometry:
            yield from _volumes(part, where, depth - 1)
        return
    if not isinstance(geometry, Mapping) or depth < 0:
        raise MissionFileError(f"{where}: no geometry")
    if "horizontalProjection" in geometry:
        unit = geometry.get("uomDimensions")
        lower = _limit(geometry, "lowerLimit", "lowerVerticalReference", unit)
        upper = _limit(geometry, "upperLimit", "upperVerticalReference", unit)
        yield from _shapes(geometry["horizontalProjection"], where, lower, upper)
        return
    if geometry.get("type") == "GeometryCollection":
        for part in _list(geometry.get("geometries"), where):
            yield from _volumes(part, where, depth - 1)
        return
    layer = geometry.get("layer")
    layer = layer if isinstance(layer, Mapping) else {}
    unit = layer.get("uom")
    lower = _limit(layer, "lower", "lowerReference", unit)
    yield from _shapes(geometry, where, lower, _limit(layer, "upper", "upperReference", unit))


def _shapes(
    value: object, where: str, lower: Limit | None, upper: Limit | None
) -> Iterator[Volume]:
    if not isinstance(value, Mapping):
        raise MissionFileError(f"{where}: no geometry")
    kind, extent = value.get("type"), value.get("extent")
    if kind == "Circle" or (kind == "Point" and isinstance(extent, Mapping)):
        centre = value.get("center") if kind == "Circle" else value.get("coordinates")
        sized = extent if isinstance(extent, Mapping) else value
        radius_m = _number(sized.get("radius"), f"{where}: radius")
        if radius_m <= 0.0:
            raise MissionFileError(f"{where}: radius = {radius_m:g}: give one above 0, in metres")
        yield Volume(Point(_place(centre, where)), radius_m, lower, upper)
    elif kind in ("Polygon", "MultiPolygon"):
        parts = _list(value.get("coordinates"), where)
        for rings in [parts] if kind == "Polygon" else parts:
            yield Volume(_polygon(rings, where), 0.0, lower, upper)
    elif kind not in ("Point", "MultiPoint", "LineString", "MultiLineString"):
        raise MissionFileError(f"{where}: geometry of type {printable(str(kind), 40)!r}")


def _polygon(value: object, where: str) -> Polygon:
    rings = [[_place(at, where) for at in _list(ring, where)] for ring in _list(value, where)]
    if not rings or any(len(ring) < 4 for ring in rings):
        raise MissionFileError(f"{where}: a ring needs three corners, and the first one again")
    return Polygon(rings[0], rings[1:])


def _place(value: object, where: str) -> tuple[float, float]:
    """Read [longitude, latitude], the order in all three kinds of file."""
    values = _list(value, where)
    if len(values) < 2:
        raise MissionFileError(f"{where}: a position needs longitude and latitude")
    lon_deg, lat_deg = (_number(one, f"{where}: coordinates") for one in values[:2])
    if not (abs(lon_deg) <= 180.0 and abs(lat_deg) <= 90.0):
        raise MissionFileError(
            f"{where}: coordinates = [{lon_deg:g}, {lat_deg:g}]: must be [longitude, latitude] in "
            "degrees; check whether they are swapped, or in metres"
        )
    return lon_deg, lat_deg


def _limit(values: Mapping[str, Any], key: str, reference: str, unit: object) -> Limit | None:
    value, metres = values.get(key), _UNITS_M.get(str(unit).upper())
    if metres is None or not isinstance(value, int | float) or isinstance(value, bool):
        return None
    if not abs(value) <= _MOST:  # this also excludes NaN
        return None
    named = str(values.get(reference, "")).upper()
    return Limit(round(float(value) * metres, 2), named if named in REFERENCES else None)


def _list(value: object, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise MissionFileError(f"{where}: {printable(repr(value), 40)} where a list belongs")
    return value


def _number(value: object, where: str) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _MOST:
        return float(value)
    raise MissionFileError(f"{where} = {printable(repr(value), 40)}: give a number")
