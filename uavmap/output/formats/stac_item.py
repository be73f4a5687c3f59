"""A STAC item of the results, for catalogues of imagery (pystac, the extra `geo`).

It is in the folder of its assets and names them by relative paths, so the folder can be moved.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry import mapping
from shapely.geometry.polygon import orient

from missions.errors import OutputError, UavmapError
from uavmap.base.extras import install_command
from uavmap.output.drawing.mosaic_file import ORTHO, PROBABILITY
from uavmap.output.drawing.scene import Bounds
from uavmap.output.facts.flown_mission import BOUNDARY_FILE, FlownMission
from uavmap.output.facts.map_model import turned
from uavmap.output.formats.layers import DECIMALS, Layer, described

COG: Final = "image/tiff; application=geotiff; profile=cloud-optimized"
GEOJSON: Final = "application/geo+json"


class Asset(NamedTuple):
    """A file of results: key and title in the item, media type, roles."""

    file: str
    key: str
    title: str
    media: str
    roles: tuple[str, ...]


ASSETS: Final = (
    Asset(ORTHO, "mosaic", "Mosaic of the pictures", COG, ("data", "visual")),
    Asset(PROBABILITY, "probability", "Probability of region", COG, ("data",)),
    Asset(BOUNDARY_FILE, "boundary", "Boundary by pixels", GEOJSON, ("data",)),
    Asset("map.geojson", "map", "Cells, outline and tracks", GEOJSON, ("data",)),
    Asset("map.gpkg", "geopackage", "Layers with styles", "application/geopackage+sqlite3",
          ("data",)),
    Asset("report.html", "report", "Report", "text/html", ("metadata",)),
    Asset("report.pdf", "report-pdf", "Report to print", "application/pdf", ("metadata",)),
    Asset("map.png", "thumbnail", "Map", "image/png", ("thumbnail",)),
)  # fmt: skip


def encode(flown: FlownMission, layers: Sequence[Layer]) -> bytes:
    """Encode the item. Raises `UavmapError` without pystac or rasterio, or for an unknown date."""
    try:
        import pystac  # noqa: PLC0415 - an extra
        from pystac.extensions.projection import ProjectionExtension  # noqa: PLC0415
    except ImportError:
        raise UavmapError(f"--to stac needs pystac: {install_command('geo')}") from None
    folder = flown.folder
    rasters = {one: _raster(folder / one.file) for one in ASSETS if one.media == COG}
    shape = _footprint(flown, layers, [one.bounds for one in rasters.values() if one])
    begun, ended = flown.calendar.date(0.0), flown.calendar.date(flown.data.t_s)
    if begun is None or ended is None:
        raise OutputError(
            f"{folder}: its date is not known, and a STAC item needs one; write the times of "
            "exposure into the pictures (EXIF), and replay them again"
        )
    item = pystac.Item(
        id=folder.resolve().name,
        geometry=None if shape is None else mapping(shape),
        bbox=None if shape is None else list(shape.bounds),
        datetime=None,
        start_datetime=begun,
        end_datetime=ended,
        properties=_properties(flown),
    )
    projection = ProjectionExtension.ext(item, add_if_missing=True)
    projection.apply(code=flown.crs)
    for one in ASSETS:
        if not (folder / one.file).is_file():
            continue
        asset = pystac.Asset(f"./{one.file}", one.title, None, one.media, list(one.roles))
        item.add_asset(one.key, asset)
        raster = rasters.get(one)
        if raster is not None:
            asset.extra_fields |= raster.fields
            ProjectionExtension.ext(asset).apply(
                code=raster.code,
                shape=list(raster.shape),
                transform=list(raster.transform),
                bbox=list(raster.bounds),
            )
    values = item.to_dict(include_self_link=False, transform_hrefs=False)
    return (json.dumps(values, indent=2, allow_nan=False) + "\n").encode()


def _properties(flown: FlownMission) -> dict[str, Any]:
    """Return title, finding and figures; figures without a name in STAC get a prefix."""
    known = described(flown)
    own = {name: known[name] for name in ("completed", "simulated", "version")}
    own |= flown.extent.figures()
    own |= {
        "unsure_area_m2": flown.values.get("cells_unsure_m2", 0.0),
        "clock": flown.calendar.clock,
    }
    if flown.boundary is not None:
        own["boundary_area_m2"] = round(flown.boundary.area_m2, 1)
    return {
        "title": known["mission"],
        "description": known["finding"] or known["mission"],
        **{f"uavmap:{name}": value for name, value in own.items()},
    }


def _footprint(
    flown: FlownMission, layers: Sequence[Layer], rasters: Sequence[Bounds]
) -> shapely.Polygon | None:
    """Return the rectangle in UTM around rasters and cells, in degrees; None for an empty map."""
    boxes = [shapely.box(*bounds) for bounds in rasters]
    boxes += [
        shapely.box(*shapely.total_bounds(layer.shapes))
        for layer in layers
        if layer.name == "cells"
    ]
    if not boxes:
        return None
    whole = shapely.box(*shapely.total_bounds(boxes))
    data = flown.data

    def in_degrees(points: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        there = data.grid.zone.lon_lat(points)
        there[:, 0] = turned(there[:, 0], data.start)
        return there.round(DECIMALS)

    return orient(shapely.transform(whole, in_degrees))


class _Raster(NamedTuple):
    """The description of a GeoTIFF in an asset; `transform` is in the order of `Affine`."""

    fields: dict[str, Any]
    code: str
    shape: tuple[int, int]
    transform: tuple[float, ...]
    bounds: Bounds


def _raster(path: Path) -> _Raster | None:
    """Read the place of a GeoTIFF; None without the file."""
    if not path.is_file():
        return None
    try:
        import rasterio  # noqa: PLC0415 - an extra
    except ImportError:
        raise UavmapError(f"--to stac needs rasterio: {install_command('geo')}") from None
    try:
        with rasterio.open(path) as file:
            fields = {"data_type": file.dtypes[0], "gsd": round(file.res[0], 4)}
            if file.nodata is not None:
                fields["nodata"] = file.nodata
            code, transform = f"EPSG:{file.crs.to_epsg()}", tuple(file.transform)[:6]
            return _Raster(fields, code, file.shape, transform, tuple(file.bounds))
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be read ({error}); move it away, or replay the pictures again"
        ) from None
