"""The files that other programs open, by format: names and bytes, nothing is written here."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Final, NamedTuple

from uavmap.output.facts.flown_mission import Flown
from uavmap.output.formats.map_layers import layers


class Format(NamedTuple):
    """A kind of file.

    Attributes:
        name: In the folder of the results: of the file, or of a folder for a file a layer.
        module: What makes it, which is imported when it is asked for.
        several: Whether it is a file a layer.
    """

    name: str
    module: str
    several: bool = False


FORMATS: Final[Mapping[str, Format]] = MappingProxyType(
    {
        "gpkg": Format("map.gpkg", "geopackage_layers"),
        "shp": Format("shp", "shapefile_layers", several=True),
        "geojson": Format("geojson", "geojson_encoder", several=True),
        "kml": Format("flight.kml", "kml_encoder"),
        "gpx": Format("flight.gpx", "gpx_layers"),
        "csv": Format("csv", "csv_layers", several=True),
    }
)


def files_of(flown: Flown, kind: str) -> dict[str, bytes]:
    """The files of a format by name; one file has the name of its format."""
    made = FORMATS[kind]
    encode = import_module(f"uavmap.output.formats.{made.module}").encode
    data = encode(flown, layers(flown, flown.boundary))
    return data if isinstance(data, dict) else {made.name: data}
