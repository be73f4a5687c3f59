"""The files that other programs open, by format: names and bytes, nothing is written here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from uavmap.results import (
    csv_layers,
    geojson_layers,
    geopackage,
    gpx,
    kml_flight,
    shapefile_layers,
)
from uavmap.results.boundary_told import read_boundary
from uavmap.results.flown import Flown
from uavmap.results.layers import Layer, layers


@dataclass(frozen=True, slots=True)
class Format:
    """A kind of file.

    Attributes:
        name: In the folder of the results: of the file, or of a folder for a file a layer.
        encode: Makes the bytes of one file, or of several by name.
        several: Whether it is a file a layer.
    """

    name: str
    encode: Callable[[Flown, Sequence[Layer]], bytes | dict[str, bytes]]
    several: bool = False


FORMATS: Final[Mapping[str, Format]] = {
    "gpkg": Format(geopackage.FILE, geopackage.encode),
    "shp": Format("shp", shapefile_layers.encode, several=True),
    "geojson": Format("geojson", geojson_layers.encode, several=True),
    "kml": Format(kml_flight.FILE, kml_flight.encode),
    "gpx": Format(gpx.FILE, gpx.encode),
    "csv": Format("csv", csv_layers.encode, several=True),
}


def files_of(flown: Flown, kind: str) -> dict[str, bytes]:
    """The files of a format by name; one file has the name of its format."""
    made = FORMATS[kind]
    data = made.encode(flown, layers(flown, read_boundary(flown.folder, flown.data)))
    return data if isinstance(data, dict) else {made.name: data}
