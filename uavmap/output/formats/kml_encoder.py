"""KML 2.2 for Google Earth: map.kml of each flight, and the export with times and all layers.

Coordinates are longitude and latitude. Tracks have the height above the ground, which is assumed to
be level with home. Colours are alpha, blue, green, red. A placemark's elements have the order of
the schema.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import shapely
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry

from uavmap.base.atomic_write import write_parts
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Colour
from uavmap.output.facts.class_areas import ClassArea
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.facts.map_model import NOT_ROI, MapData
from uavmap.output.formats.layers import (
    DECIMALS,
    Layer,
    described,
    in_degrees,
    line_in_degrees,
    outline_in_degrees,
    text_of,
)
from uavmap.output.formats.map_layers import track_lines, track_parts

NAMESPACE = "http://www.opengis.net/kml/2.2"
_EXTENSIONS = "http://www.google.com/kml/ext/2.2"
_SHOWN = ("region", "boundary", "classes", "cells", "tracks", "unsearched", "fence", "places")
_ABOVE_GROUND = "<altitudeMode>relativeToGround</altitudeMode>"


def write(data: MapData, path: Path) -> None:
    """Write map.kml: folders Outline, Cells (a folder per state), Tracks, Not searched (if any)."""
    write_parts(path, (part.encode() for part in _map(data)))


def encode(flown: FlownMission, layers: Sequence[Layer], ground: str = "") -> bytes:
    """Encode a flight with its times: `ground`, then a folder per layer, tracks as gx:Track."""
    known = {layer.name: layer for layer in layers}
    head = f"<description>{_text(flown.values.get('finding', ''))}</description>"
    vehicles = {number for number, _, _ in track_parts(flown)}
    write = {"cells": lambda f, layer: _cells(f.data), "tracks": _tracks}
    folders = (
        _folder(known[name].title, write.get(name, _marks)(flown, known[name]))
        for name in _SHOWN
        if name in known
    )
    above = itertools.chain([iter((ground,))], folders)
    parts = _document(flown.data, head, vehicles, _extended(described(flown)), above)
    return "".join(parts).encode()


def _document(
    data: MapData, head: str, vehicles: Iterable[int], tail: str, folders: Iterable[Iterator[str]]
) -> Iterator[str]:
    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<kml xmlns="{NAMESPACE}" xmlns:gx="{_EXTENSIONS}">\n'
        f"<Document><name>{_text(data.mission)}</name>{head}\n"
        f"{''.join(_styles(data, vehicles))}{tail}\n"
    )
    for folder in folders:
        yield from folder
    yield "</Document>\n</kml>\n"


# --- styles --------------------------------------------------------------------------------------
def _styles(data: MapData, vehicles: Iterable[int]) -> Iterator[str]:
    for state, colour in palette.STATES.items():
        fill = _abgr(colour, 90 if state in NOT_ROI else 150)
        yield _style(state.replace(" ", "-"), colour, 1, fill)
    for one in data.class_areas:
        colour = palette.class_colour(one.number)
        yield _style(f"class-{one.number}", colour, 2, _abgr(colour, 150))
    yield _style("region", palette.OUTLINE, 3)
    yield _style("boundary", palette.BOUNDARY, 2)
    yield _style("unsearched", palette.UNSEARCHED, 3)
    yield _style("fence", palette.FENCE, 2)
    yield _style("box", palette.BOX, 2)
    yield _style("places", palette.INK, 2)
    for vehicle in sorted(vehicles):
        yield _style(f"track-{vehicle}", palette.track_colour(vehicle), 2)


def _style(name: str, line: Colour, width: int, fill: str | None = None) -> str:
    inside = "<fill>0</fill>" if fill is None else f"<color>{fill}</color>"
    return (
        f"<Style id={quoteattr(name)}><LineStyle><color>{_abgr(line, 255)}</color>"
        f"<width>{width}</width></LineStyle><PolyStyle>{inside}</PolyStyle></Style>\n"
    )


def _abgr(colour: Colour, alpha: int) -> str:
    red, green, blue = colour
    return f"{alpha:02x}{blue:02x}{green:02x}{red:02x}"


# --- map.kml -------------------------------------------------------------------------------------
def _map(data: MapData) -> Iterator[str]:
    tracks = [track for track in data.tracks if len(track.points) > 1]
    shape, outline = outline_in_degrees(data, data.outline), []
    if not shape.is_empty:
        size = f"{len(data.roi_cells)} cells, {data.outline.area:.0f} m2"
        outline = [_mark("Region", "region", _geometry(shape), description=size)]
    folders = [_folder("Outline", outline), _folder("Cells", _cells(data))]
    if classes := [_class_mark(data, one) for one in data.class_areas if one.cells]:
        folders.insert(1, _folder("Classes", classes))
    lines = []
    for track in tracks:
        places = line_in_degrees(data, (place for _, place, _ in track.points))
        points = [(*at, height) for at, (_, _, height) in zip(places, track.points, strict=True)]
        name = f"Vehicle {track.vehicle}" if data.pictures is None else "Pictures"
        lines.append(_mark(name, f"track-{track.vehicle}", _aloft(points)))
    folders.append(_folder("Tracks", lines))
    lanes = [
        _mark(
            f"Lane {number}, without a judged frame",
            "unsearched",
            _geometry(LineString(line_in_degrees(data, lane))),
        )
        for number, lane in enumerate(data.unsearched, start=1)
    ]
    if lanes:
        folders.append(_folder("Not searched", lanes))
    yield from _document(data, "", {track.vehicle for track in tracks}, "", folders)


def _class_mark(data: MapData, one: ClassArea) -> str:
    shape = _geometry(outline_in_degrees(data, one.outline))
    return _mark(one.name, f"class-{one.number}", shape, values=one.figures())


# --- layers --------------------------------------------------------------------------------------
def _cells(data: MapData) -> Iterator[str]:
    """Write a folder per state, `AT_ONCE` of thousands of cells at a time."""
    for state in palette.STATES:
        there = data.cells.in_state(state)
        if not there.any():
            continue
        names = palette.STATE_NAMES if data.pictures is None else palette.RECORDED_NAMES
        yield f"<Folder><name>{names[state]}</name>\n"
        style = state.replace(" ", "-")
        some, corners = data.cells.subset(there), data.corners.subset(there)
        texts = corners.written(data.start, lambda *at: _place(at))
        for table, rings in zip(some.parts(), texts, strict=True):
            for ring, row in zip(rings, table.values(), strict=True):
                (east, north), _, positive, votes, belief = row
                frames = f"{positive} of {votes} frames positive"
                frames += "" if belief is None else f", belief {belief:.3f}"
                square = _ring("outerBoundaryIs", " ".join([*ring, ring[0]]))
                square = f"<Polygon>{square}</Polygon>"
                yield _mark(f"{east}, {north}", style, square, description=frames)
        yield "</Folder>\n"


def _marks(flown: FlownMission, layer: Layer) -> Iterator[str]:
    shapes = in_degrees(layer, flown.data)
    stamp = flown.calendar.utc(flown.data.t_s)
    dated = layer.name in ("region", "boundary") and stamp is not None
    when = f"<TimeStamp><when>{stamp}</when></TimeStamp>" if dated else ""
    for shape, values in zip(shapes, layer.records(), strict=True):
        style = layer.name
        if layer.name == "fence":
            style = str(values["kind"])
        elif layer.name == "classes":
            style = f"class-{values['number']}"
        yield _mark(values["name"], style, _geometry(shape), when=when, values=values)


def _tracks(flown: FlownMission, layer: Layer) -> Iterator[str]:
    lines = zip(in_degrees(layer, flown.data), layer.records(), track_lines(flown), strict=True)
    for shape, values, (vehicle, _, fixes) in lines:
        times = [flown.calendar.utc(fix.t_s) for fix in fixes]
        points = shapely.get_coordinates(shape, include_z=True).tolist()
        if None in times:
            geometry = _aloft(points)
        else:
            whens = "".join(f"<when>{time}</when>" for time in times)
            coords = "".join(f"<gx:coord>{x} {y} {z:.2f}</gx:coord>" for x, y, z in points)
            geometry = f"<gx:Track>{_ABOVE_GROUND}\n{whens}\n{coords}</gx:Track>"
        yield _mark(values["name"], f"track-{vehicle}", geometry, values=values)


# --- parts ---------------------------------------------------------------------------------------
def _folder(title: str, marks: Iterable[str]) -> Iterator[str]:
    yield f"<Folder><name>{_text(title)}</name>\n"
    yield from marks
    yield "</Folder>\n"


def _mark(
    title: object,
    style: str,
    geometry: str,
    *,
    description: str = "",
    when: str = "",
    values: Mapping[str, Any] | None = None,
) -> str:
    about = f"<description>{_text(description)}</description>" if description else ""
    return (
        f"<Placemark><name>{_text(title)}</name>{about}{when}<styleUrl>#{style}</styleUrl>"
        f"{_extended(values or {})}{geometry}</Placemark>\n"
    )


def _geometry(shape: BaseGeometry | None) -> str:
    match shape:
        case None:
            return ""
        case shapely.Point():
            return f"<Point>{_coordinates(shape.coords)}</Point>"
        case shapely.LineString():
            places = _coordinates(shape.coords)
            return f"<LineString><tessellate>1</tessellate>{places}</LineString>"
        case shapely.Polygon():
            outer = _ring("outerBoundaryIs", _places(shape.exterior.coords))
            holes = (_ring("innerBoundaryIs", _places(hole.coords)) for hole in shape.interiors)
            return f"<Polygon>{outer}{''.join(holes)}</Polygon>"
    parts = "".join(map(_geometry, shapely.get_parts(shape)))
    return f"<MultiGeometry>{parts}</MultiGeometry>"


def _aloft(points: Iterable[Sequence[float]]) -> str:
    return f"<LineString>{_ABOVE_GROUND}{_coordinates(points)}</LineString>"


def _ring(tag: str, places: str) -> str:
    return f"<{tag}><LinearRing><coordinates>{places}</coordinates></LinearRing></{tag}>"


def _coordinates(points: Iterable[Sequence[float]]) -> str:
    return f"<coordinates>{_places(points)}</coordinates>"


def _places(points: Iterable[Sequence[float]]) -> str:
    return " ".join(map(_place, points))


def _place(point: Sequence[float]) -> str:
    return ",".join(f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".") for value in point)


def _extended(values: Mapping[str, Any]) -> str:
    data = "".join(
        f"<Data name={quoteattr(name)}><value>{_text(value)}</value></Data>"
        for name, value in values.items()
        if value is not None and name != "name"
    )
    return f"<ExtendedData>{data}</ExtendedData>" if data else ""


def _text(value: object) -> str:
    """Escape a value; remove characters that XML cannot hold."""
    return escape("".join(c for c in text_of(value) if c >= " " and c not in "\ufffe\uffff"))
