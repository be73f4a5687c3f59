"""flight.gpx (GPX 1.1): tracks with times, outline, homes; elevations if home's is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gpxpy.gpx as gpx
import shapely

from uavmap.base.version import __version__
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.layers import Layer, described, in_degrees, text_of
from uavmap.output.formats.map_layers import track_lines


def encode(flown: FlownMission, layers: Sequence[Layer]) -> bytes:
    """Encode the file."""
    known = {layer.name: layer for layer in layers}
    file = gpx.GPX()
    file.creator = f"uavmap {__version__}"
    file.name = flown.data.mission
    about = ((name, value) for name, value in described(flown).items() if value not in (None, ""))
    file.description = "; ".join(f"{name} {text_of(value)}" for name, value in about)
    file.time = _date(flown, flown.data.t_s)
    if "places" in known:
        shapes, names = in_degrees(known["places"], flown.data), known["places"].column("name")
        file.waypoints.extend(
            gpx.GPXWaypoint(latitude=shape.y, longitude=_turned(shape.x), name=str(name))
            for shape, name in zip(shapes, names, strict=True)
        )
    if "tracks" in known:
        file.tracks.extend(_tracks(flown, known["tracks"]))
    if "region" in known:
        file.tracks.extend(_outline(flown, known["region"]))
    return f"{file.to_xml('1.1')}\n".encode()


def _date(flown: FlownMission, t_s: float) -> Any:
    return None if flown.calendar.utc(t_s) is None else flown.calendar.date(t_s)


def _turned(lon_deg: float) -> float:
    """Return a longitude in GPX's range, from -180 to below 180 degrees.

    >>> _turned(180.0), _turned(-12.5), _turned(180.25)
    (-180.0, -12.5, -179.75)
    """
    return lon_deg if -180.0 <= lon_deg < 180.0 else round((lon_deg + 180.0) % 360.0 - 180.0, 7)


def _tracks(flown: FlownMission, layer: Layer) -> list[gpx.GPXTrack]:
    tracks: dict[int, gpx.GPXTrack] = {}
    home_m = None if flown.recorded else flown.log.amsl_m
    flights = track_lines(flown)
    for shape, (vehicle, _, fixes) in zip(in_degrees(layer, flown.data), flights, strict=True):
        if vehicle not in tracks:
            tracks[vehicle] = gpx.GPXTrack(name=f"vehicle {vehicle}")
        segment = gpx.GPXTrackSegment()
        points = shapely.get_coordinates(shape, include_z=True).tolist()
        for (lon, lat, height_m), fix in zip(points, fixes, strict=True):
            above_m = None if home_m is None else round(home_m + height_m, 2)
            segment.points.append(
                gpx.GPXTrackPoint(lat, _turned(lon), elevation=above_m, time=_date(flown, fix.t_s))
            )
        tracks[vehicle].segments.append(segment)
    return list(tracks.values())


def _outline(flown: FlownMission, layer: Layer) -> list[gpx.GPXTrack]:
    """Create a segment for each ring: GPX has no areas."""
    (shape,) = in_degrees(layer, flown.data)
    if shape is None:
        return []
    track = gpx.GPXTrack(name="outline of the region")
    for part in shape.geoms:
        for ring in (part.exterior, *part.interiors):
            points = [gpx.GPXTrackPoint(lat, _turned(lon)) for lon, lat in ring.coords]
            track.segments.append(gpx.GPXTrackSegment(points))
    return [track]
