"""A flight for Google Earth, with time: KML 2.2, tracks as gx:Track, a folder a layer.

The elements of a placemark come in the order of the schema, and what is known of it is in its
ExtendedData. Heights are above the ground, which is taken to be level with home.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import shapely

from uavmap.output.drawing.palette import (
    BOUNDARY,
    BOX,
    FENCE,
    INK,
    OUTLINE,
    STATES,
    UNSEARCHED,
    Colour,
    track_colour,
)
from uavmap.results.flown import Flown
from uavmap.results.layers import Layer, in_degrees
from uavmap.results.map_layers import track_parts
from uavmap.results.told import described

_SHOWN = ("region", "boundary", "cells", "tracks", "unsearched", "fence", "places")


def encode(flown: Flown, layers: Sequence[Layer]) -> bytes:
    """The document."""
    known = {layer.name: layer for layer in layers}
    shown = [known[name] for name in _SHOWN if name in known]
    folders = "".join(_folder(flown, layer) for layer in shown)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2">\n'
        f"<Document><name>{_text(flown.data.mission)}</name>"
        f"<description>{_text(flown.values.get('finding', ''))}</description>\n"
        f"{''.join(_styles(flown))}{_extended(described(flown))}\n{folders}</Document>\n</kml>\n"
    ).encode()


# --- styles --------------------------------------------------------------------------------------
def _styles(flown: Flown) -> Iterator[str]:
    for state, colour in STATES.items():
        faint = state in ("non-roi", "provisional non-roi", "provisional")
        yield _style(_id(state), colour, 1, _abgr(colour, 90 if faint else 150))
    yield _style("region", OUTLINE, 3)
    yield _style("boundary", BOUNDARY, 2)
    yield _style("unsearched", UNSEARCHED, 3)
    yield _style("fence", FENCE, 2)
    yield _style("box", BOX, 2)
    yield _style("places", INK, 2)
    for vehicle in sorted({number for number, _, _ in track_parts(flown)}):
        yield _style(f"track-{vehicle}", track_colour(vehicle), 2)


def _style(name: str, line: Colour, width: int, fill: str | None = None) -> str:
    inside = "<fill>0</fill>" if fill is None else f"<color>{fill}</color>"
    return (
        f"<Style id={quoteattr(name)}><LineStyle><color>{_abgr(line, 255)}</color>"
        f"<width>{width}</width></LineStyle><PolyStyle>{inside}</PolyStyle></Style>\n"
    )


def _abgr(colour: Colour, alpha: int) -> str:
    red, green, blue = colour
    return f"{alpha:02x}{blue:02x}{green:02x}{red:02x}"


def _id(state: str) -> str:
    return state.replace(" ", "-")


# --- folders -------------------------------------------------------------------------------------
def _folder(flown: Flown, layer: Layer) -> str:
    if layer.name == "tracks":
        marks = "".join(_tracks(flown, layer))
    else:
        marks = "".join(_marks(flown, layer))
    return f"<Folder><name>{_text(layer.title)}</name>\n{marks}</Folder>\n"


def _marks(flown: Flown, layer: Layer) -> Iterator[str]:
    names = [field.name for field in layer.fields]
    shapes = in_degrees(layer, flown.data.grid, flown.data.start)
    stamp = flown.calendar.utc(flown.data.t_s)
    for shape, row in zip(shapes, layer.rows, strict=True):
        values = dict(zip(names, row, strict=True))
        when = ""
        if layer.name in ("region", "boundary") and stamp is not None:
            when = f"<TimeStamp><when>{stamp}</when></TimeStamp>"
        style = layer.name
        if layer.name == "cells":
            style = _id(str(values["state"]))
        elif layer.name == "fence":
            style = str(values["kind"])
        title = values.get("name", f"{values.get('column')}, {values.get('row')}")
        yield _mark(title, when, style, values, _geometry(shape))


def _mark(title: object, when: str, style: str, values: dict[str, Any], geometry: str) -> str:
    return (
        f"<Placemark><name>{_text(title)}</name>{when}<styleUrl>#{style}</styleUrl>"
        f"{_extended(values)}{geometry}</Placemark>\n"
    )


def _tracks(flown: Flown, layer: Layer) -> Iterator[str]:
    """Lines in time; without dates plain lines."""
    names = [field.name for field in layer.fields]
    fixes = {(vehicle, number): found for vehicle, number, found in track_parts(flown)}
    shapes = in_degrees(layer, flown.data.grid, flown.data.start)
    for shape, row in zip(shapes, layer.rows, strict=True):
        values = dict(zip(names, row, strict=True))
        vehicle, sortie = values["vehicle"], values["sortie"]
        times = [flown.calendar.utc(fix.t_s) for fix in fixes[int(vehicle or 0), int(sortie or 0)]]
        points = shapely.get_coordinates(shape, include_z=True).tolist()
        if None in times:
            geometry = (
                "<LineString><altitudeMode>relativeToGround</altitudeMode><coordinates>"
                f"{_places(points)}</coordinates></LineString>"
            )
        else:
            whens = "".join(f"<when>{time}</when>" for time in times)
            coords = "".join(f"<gx:coord>{x} {y} {z:.2f}</gx:coord>" for x, y, z in points)
            geometry = (
                f"<gx:Track><altitudeMode>relativeToGround</altitudeMode>\n{whens}\n{coords}"
                "</gx:Track>"
            )
        yield _mark(values["name"], "", f"track-{vehicle}", values, geometry)


# --- parts ---------------------------------------------------------------------------------------
def _geometry(shape: Any) -> str:
    if shape is None:
        return ""
    if shape.geom_type == "Point":
        return f"<Point><coordinates>{_places(shape.coords)}</coordinates></Point>"
    if shape.geom_type == "LineString":
        places = _places(shape.coords)
        return (
            f"<LineString><tessellate>1</tessellate><coordinates>{places}</coordinates>"
            "</LineString>"
        )
    if shape.geom_type == "Polygon":
        rings = "".join(_ring("innerBoundaryIs", hole) for hole in shape.interiors)
        return f"<Polygon>{_ring('outerBoundaryIs', shape.exterior)}{rings}</Polygon>"
    return f"<MultiGeometry>{''.join(map(_geometry, shape.geoms))}</MultiGeometry>"


def _ring(tag: str, ring: Any) -> str:
    places = _places(ring.coords)
    return f"<{tag}><LinearRing><coordinates>{places}</coordinates></LinearRing></{tag}>"


def _places(points: Iterable[Sequence[float]]) -> str:
    return " ".join(",".join(f"{value:.7f}".rstrip("0").rstrip(".") for value in p) for p in points)


def _extended(values: dict[str, Any]) -> str:
    data = "".join(
        f"<Data name={quoteattr(name)}><value>{_text(value)}</value></Data>"
        for name, value in values.items()
        if value is not None and name != "name"
    )
    return f"<ExtendedData>{data}</ExtendedData>" if data else ""


def _text(value: object) -> str:
    """A value as XML holds it: without the characters that XML cannot hold at all."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return escape("".join(c for c in str(value) if c >= " " and c not in "\ufffe\uffff"))
