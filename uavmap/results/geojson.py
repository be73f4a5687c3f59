"""map.geojson: cells, outline and tracks as RFC 7946 reads them.

Longitude before latitude, WGS84, seven decimals (about a centimetre), rings closed, exterior
rings counter-clockwise and holes clockwise (section 3.1.6), a bounding box (section 5). A third
coordinate, of tracks only, is the height above home in metres.

Longitudes run on past 180 degrees where a map crosses the antimeridian, so that no polygon spans
the globe.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon

from missions.units import GridPoint, LatLon
from uavmap.results.atomic import write_parts
from uavmap.results.model import MapData, Track

DECIMALS = 7

Coordinates = list[float]
Feature = dict[str, Any]


def write(data: MapData, path: Path, utc: str | None = None) -> None:
    """Write the map to `path`; `utc` is its date, ISO 8601, where anybody knows it."""
    write_parts(path, (part.encode() for part in _parts(data, utc)))


def encode(data: MapData, utc: str | None = None) -> str:
    """The map as a FeatureCollection, a feature a line; `utc` is its date.

    Features by their property `kind`:

    * `cell`: Polygon; `column`, `row`, `state`, `positive` and `votes` (frames); of recorded
      pictures that were weighed `belief`, 0 to 1.
    * `outline`: Polygon or MultiPolygon around the region's cells; `area_m2`, and `utc`, its date,
      if that is known. Its geometry is null for a map without a region.
    * `track`: LineString; `vehicle`, `start_s`, `end_s`. Vehicles that never moved have none.
    * `unsearched`: LineString, a stretch of a search lane that no judged frame shows.
    """
    return "".join(_parts(data, utc))


def _parts(data: MapData, utc: str | None) -> Iterator[str]:
    date = {} if utc is None else {"utc": utc}
    features = [_outline(data, date), *_tracks(data), *_unsearched(data)]
    head = json.dumps(
        {"type": "FeatureCollection", "mission": data.mission, "t_s": round(data.t_s, 3)}
        | date
        | ({"bbox": box} if (box := _bbox(features, _extremes(data))) else {})
    )
    yield f'{head[:-1]}, "features": [\n'
    for cell in _cells(data):
        yield f"{cell},\n"
    yield ",\n".join(json.dumps(feature, allow_nan=False) for feature in features)
    yield "\n]}\n"


def _cells(data: MapData) -> Iterator[str]:
    """A line for each cell. There are thousands, so they are written without a tree of their
    parts: numbers, and names of states that need no quoting."""

    def places(lon_deg: NDArray[np.float64], lat_deg: NDArray[np.float64]) -> list[str]:
        both = zip(_turned(data, lon_deg).tolist(), lat_deg.tolist(), strict=True)
        return [f"[{round(lon, DECIMALS)!r}, {round(lat, DECIMALS)!r}]" for lon, lat in both]

    parts = zip(data.table.parts(), data.corners.written(places), strict=True)
    for table, rings in parts:
        for (sw, se, ne, nw), row in zip(rings, table.values(), strict=True):
            (east, north), state, positive, votes, told = row
            belief = "" if told is None else f', "belief": {round(told, 3)!r}'
            yield (
                f'{{"type": "Feature", "id": "cell {east} {north}", "geometry": {{"type": '
                f'"Polygon", "coordinates": [[{sw}, {se}, {ne}, {nw}, {sw}]]}}, '
                f'"properties": {{"kind": "cell", "column": {east}, "row": {north}, '
                f'"state": "{state}", "positive": {positive}, "votes": {votes}{belief}}}}}'
            )


def _extremes(data: MapData) -> list[Coordinates]:
    """The south-western and the north-eastern corner of the box around all cells, if any."""
    lons, lats = data.corners.lon_deg, data.corners.lat_deg
    if not len(lons):
        return []
    turned = _turned(data, lons)
    corners = np.array([[turned.min(), lats.min()], [turned.max(), lats.max()]])
    return [[round(value, DECIMALS) for value in corner] for corner in corners.tolist()]


def _turned(data: MapData, lon_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Longitudes in the turn of the start's."""
    return lon_deg + 360.0 * np.round((data.start.lon_deg - lon_deg) / 360.0)


def _outline(data: MapData, date: dict[str, str]) -> Feature:
    shape = data.outline
    return {
        "type": "Feature",
        "id": "outline",
        "geometry": _polygons(data, shape),
        "properties": {
            "kind": "outline",
            "mission": data.mission,
            "t_s": round(data.t_s, 3),
            "cells": len(data.roi_cells),
            "area_m2": round(shape.area, 3),
            **date,
        },
    }


def _polygons(data: MapData, shape: Polygon | MultiPolygon) -> dict[str, Any] | None:
    if shape.is_empty:
        return None
    rings = [
        [_ring(data, _points(ring.coords)) for ring in (part.exterior, *part.interiors)]
        for part in (shape.geoms if isinstance(shape, MultiPolygon) else [shape])
    ]
    if len(rings) == 1:
        return {"type": "Polygon", "coordinates": rings[0]}
    return {"type": "MultiPolygon", "coordinates": rings}


def _points(coordinates: Iterable[tuple[float, ...]]) -> list[GridPoint]:
    return [GridPoint(east, north) for east, north, *_ in coordinates]


def _tracks(data: MapData) -> Iterator[Feature]:
    for track in data.tracks:
        if len(track.points) < 2:  # a LineString has two positions at least
            continue
        yield {
            "type": "Feature",
            "id": f"track {track.vehicle}",
            "geometry": {"type": "LineString", "coordinates": _line(data, track)},
            "properties": {
                "kind": "track",
                "vehicle": track.vehicle,
                "start_s": round(track.points[0][0], 3),
                "end_s": round(track.points[-1][0], 3),
                "altitude": "metres above home",
            },
        }


def _unsearched(data: MapData) -> Iterator[Feature]:
    for number, lane in enumerate(data.unsearched, start=1):
        yield {
            "type": "Feature",
            "id": f"unsearched {number}",
            "geometry": {
                "type": "LineString",
                "coordinates": [_lon_lat(place, data.start) for place in lane],
            },
            "properties": {"kind": "unsearched"},
        }


def _line(data: MapData, track: Track) -> list[Coordinates]:
    return [
        [*_lon_lat(place, data.start), round(height_m, 2)] for _, place, height_m in track.points
    ]


def _ring(data: MapData, points: Iterable[GridPoint]) -> list[Coordinates]:
    """A closed ring of points of the moving frame, in their order."""
    ring = [_lon_lat(data.place(point), data.start) for point in points]
    return ring if ring[0] == ring[-1] else [*ring, ring[0]]


def _lon_lat(place: LatLon, start: LatLon) -> Coordinates:
    return [_longitude(place.lon_deg, start), round(place.lat_deg, DECIMALS)]


def _longitude(lon_deg: float, start: LatLon) -> float:
    """A longitude in the turn of the start's."""
    turns = round((start.lon_deg - lon_deg) / 360.0)
    return round(lon_deg + 360.0 * turns, DECIMALS)


def _bbox(features: Iterable[Feature], cells: Sequence[Coordinates]) -> Coordinates:
    """West, south, east, north of all features, and of cells; empty without any geometry."""
    places = [place for f in features if f["geometry"] for place in _flat(f["geometry"])]
    lons, lats = ([place[axis] for place in (*places, *cells)] for axis in (0, 1))
    if not lons:
        return []
    heights = [place[2] for place in places if len(place) > 2]
    low, high = [min(lons), min(lats)], [max(lons), max(lats)]
    # as many numbers a corner as there are dimensions (section 5)
    return [*low, min(heights), *high, max(heights)] if heights else [*low, *high]


def _flat(geometry: dict[str, Any]) -> Iterator[Coordinates]:
    stack: list[Any] = [geometry["coordinates"]]
    while stack:
        item = stack.pop()
        if isinstance(item[0], float):
            yield item
        else:
            stack.extend(item)
