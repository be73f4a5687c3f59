"""The live map as GeoJSON by RFC 7946, for a GIS that loads it again and again."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from typing import Any

import shapely
from shapely.geometry.base import BaseGeometry

from uavmap.output.drawing import palette
from uavmap.output.formats.geojson_encoder import (
    bbox,
    cell_feature,
    collection,
    feature,
    written_parts,
)
from uavmap.ui.page.live_map import LiveMap
from uavmap.ui.page.page_pipe import Message
from uavmap.ui.page.page_scene import STATES

EMPTY = "".join(collection({}, [], ())).encode()
"""The map before the first version of the board."""


def part_of(data: bytes, asked: str) -> tuple[int, dict[str, str], bytes]:
    """Return status, headers and body of the response to a `Range`, with which GDAL reads files.

    >>> part_of(b"0123", "bytes=1-9")
    (206, {'content-range': 'bytes 1-3/4'}, b'123')
    >>> part_of(b"0123", "")
    (200, {'accept-ranges': 'bytes'}, b'0123')
    """
    found = re.fullmatch(r"bytes=([0-9]{1,12})-([0-9]{0,12})", asked)
    if found is None:
        return 200, {"accept-ranges": "bytes"}, data
    first, last = int(found[1]), min(int(found[2] or len(data)), len(data) - 1)
    if first > last:
        return 416, {"content-range": f"bytes */{len(data)}"}, b""
    return 206, {"content-range": f"bytes {first}-{last}/{len(data)}"}, data[first : last + 1]


def geojson(live: LiveMap, scene: Message) -> bytes:
    """Encode a live map with a feature on each line; all have the properties `kind` and `colour`.

    * `cell`: Polygon; `column`, `row`, `state`, and `class` if the detector has classes.
    * `outline`: Polygon or MultiPolygon around the region's cells; `unsure`: around unsure ones.
      `cells`, `area_m2`. The geometry is null if there are none.
    * `aircraft`: Point; `vehicle`, `height_m` above home, `amsl_m`, `battery` in percent, `doing`,
      `landed`, `at_s`, the mission time of its place.
    * `traffic`: Point of an aircraft of others; `name`, `height_m` above the start, perhaps null.
    * `track`, `path`: LineString that a vehicle has flown, or of its present order; `vehicle`.
    """
    head = {"mission": live.mission, "t_s": live.t_s, "phase": live.snapshot["fields"].get("phase")}
    marks = list(_marks(live))
    shapes = [shape for shape, _ in marks if not shape.is_empty]
    box = bbox(shapely.get_coordinates(shapes))

    def features() -> Iterator[str]:
        yield from _cells(live, scene)
        for shape, values in marks:
            geometry = "null" if shape.is_empty else shapely.to_geojson(shape)
            name = f"{values['kind']} {values.get('vehicle', '')}".strip()
            yield feature(name, geometry, values)

    return "".join(collection(head, box, features())).encode()


def _cells(live: LiveMap, scene: Message) -> Iterator[str]:
    """Yield a line for each cell; codes above those of the states are classes of the region."""
    classes = scene.get("classes", [])
    values = []
    for code, (_, colour) in enumerate(scene["states"]):
        state: dict[str, Any] = {"state": STATES[min(code, len(STATES) - 1)]}
        if code >= len(STATES):
            state = {"state": "explored", "class": classes[code - len(STATES)]}
        values.append(json.dumps({**state, "colour": colour})[1:-1])
    rings = itertools.chain.from_iterable(written_parts(live.corners, live.start))
    for place, code, ring in zip(live.cells.tolist(), live.codes.tolist(), rings, strict=True):
        yield cell_feature(place, ring, values[code])


def _marks(live: LiveMap) -> Iterator[tuple[BaseGeometry, dict[str, Any]]]:
    areas = (
        ("outline", live.region, palette.OUTLINE),
        ("unsure", live.unsure, palette.STATES["unsure"]),
    )
    for kind, area, colour in areas:
        cells = round(area.area / live.grid.cell_m**2)
        figures = {"cells": cells, "area_m2": round(area.area, 3), "colour": palette.css(colour)}
        yield live.on_earth(area), {"kind": kind, **figures}
    for kind, lines in (("track", live.tracks()), ("path", live.paths())):
        for number, line in lines:
            yield live.on_earth(line), {"kind": kind, **_of_vehicle(number)}
    for one in live.aircraft():
        record = one.record
        kept = ("amsl_m", "battery", "doing", "landed", "at_s")
        figures = {"height_m": record["up"]} | {name: record.get(name) for name in kept}
        yield live.place(one), {"kind": "aircraft", **_of_vehicle(one.number), **figures}
    for place, mark in live.traffic():
        values = {"name": mark["name"], "height_m": mark["up"]}
        yield place, {"kind": "traffic", "colour": palette.css(palette.TRAFFIC), **values}


def _of_vehicle(number: int) -> dict[str, Any]:
    return {"vehicle": number, "colour": palette.css(palette.track_colour(number))}
