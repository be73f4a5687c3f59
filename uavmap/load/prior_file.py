"""Where the region probably is, from the GeoJSON file that `search.prior` names."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from missions.errors import MissionFileError
from missions.mission.sections.search_sections import MAX_PRIOR_PLACES
from uavmap.base.text_files import read_text

LARGEST_BYTES: Final = 4_000_000
_SHOWN: Final = 40
_NUMBERS = ("weight", "spread_m")


def prior_places(path: Path, where: str) -> list[dict[str, Any]]:
    """Read the places of a file, as `search.prior` holds them.

    Raises `MissionFileError`, which begins with `where`: mission file, key and value.
    """
    try:
        content = read_text(path, LARGEST_BYTES)
    except OSError as error:
        raise MissionFileError(
            f"{where}: cannot be read ({error.strerror}); give the path of a GeoJSON file from "
            "the folder of the mission file"
        ) from None
    except ValueError:  # not UTF-8, or a path with a null character
        raise MissionFileError(f"{where}: not a text file in UTF-8") from None
    return list(_places(content, where))


def _places(content: str, where: str) -> Iterator[dict[str, Any]]:
    """The features of a collection, as the tables that a mission file may hold."""
    try:
        root = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise MissionFileError(f"{where}: not JSON ({error})") from None
    features = root.get("features") if isinstance(root, dict) else None
    collection = isinstance(root, dict) and root.get("type") == "FeatureCollection"
    if not collection or not isinstance(features, list) or not features:
        raise MissionFileError(
            f"{where}: no FeatureCollection with features; write each place as a feature with a "
            "Point or a Polygon"
        )
    if len(features) > MAX_PRIOR_PLACES:
        raise MissionFileError(
            f"{where}: {len(features)} features; at most {MAX_PRIOR_PLACES}, so join some of them"
        )
    for i, feature in enumerate(features):
        yield _place(feature, f"{where}: features[{i}]")


def _place(feature: object, where: str) -> dict[str, Any]:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(feature, dict) or not isinstance(geometry, dict) or not kind:
        raise MissionFileError(f"{where}: no feature with a geometry; give it a Point or a Polygon")
    values = geometry.get("coordinates")
    if kind == "Point":
        place: dict[str, Any] = {"position": _vertex(values, where)}
    elif kind == "Polygon" and isinstance(values, list) and values:
        shell, *holes = (_ring(ring, where) for ring in values)
        place = {"polygon": shell, **({"holes": holes} if holes else {})}
    else:
        raise MissionFileError(
            f"{where}: geometry.type = {kind!r}: write it as features with a Point or a Polygon "
            "each"
        )
    properties = feature.get("properties") or {}
    for key in _NUMBERS:
        if isinstance(properties, dict) and properties.get(key) is not None:
            place[key] = _number(properties[key], f"{where}: properties.{key}")
            if place[key] <= 0.0:
                raise MissionFileError(
                    f"{where}: properties.{key} = {place[key]:g}: give a number above 0"
                )
    return place


def _ring(ring: object, where: str) -> list[list[float]]:
    """A ring without its last vertex, which repeats the first in GeoJSON."""
    vertices = [_vertex(v, where) for v in ring] if isinstance(ring, list) else []
    if len(vertices) < 4 or vertices[0] != vertices[-1]:
        raise MissionFileError(
            f"{where}: a ring needs three vertices, and the first once more at its end"
        )
    return vertices[:-1]


def _vertex(value: object, where: str) -> list[float]:
    """[latitude, longitude]; GeoJSON has them the other way round."""
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise MissionFileError(f"{where}: coordinates are [longitude, latitude], in degrees")
    lon_deg, lat_deg = (_number(part, f"{where}: coordinates") for part in value[:2])
    if not (-180.0 <= lon_deg <= 180.0 and -90.0 <= lat_deg <= 90.0):
        raise MissionFileError(
            f"{where}: coordinates = [{lon_deg:g}, {lat_deg:g}]: they are [longitude, latitude], "
            "in degrees: are they swapped, or in metres?"
        )
    return [lat_deg, lon_deg]


def _number(value: object, where: str) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # a whole number of hundreds of digits
            if math.isfinite(number := float(value)):
                return number
    raise MissionFileError(f"{where} = {str(value)[:_SHOWN]!r}: give a number")
