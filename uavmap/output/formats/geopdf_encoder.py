"""map.png over the mosaic as a geospatial PDF, by GDAL (rasterio, the extra `geo`).

A PDF reader that supports geospatial PDF shows coordinates and measures; a phone shows its own
place on the map. GDAL writes the Measure dictionary of ISO 32000. rasterio passes no path to that
driver unchanged, so lines are a part of the picture.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from missions.errors import UavmapError
from uavmap.base.extras import install_command
from uavmap.base.version import __version__
from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.mosaic_file import finest_ground
from uavmap.output.drawing.scene import View
from uavmap.output.drawing.sheet import MARGIN_PX, TITLE_PX, draw_sheet
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.layers import Layer

FINER: Final = 2
"""Number of pixels along one pixel of map.png: the map is printed larger."""
DPI: Final = 150
_SIDE_PX: Final = 4096
_NO_DATE: Final = "D:19700101000000Z"


def encode(flown: FlownMission, layers: Sequence[Layer]) -> bytes:
    """Encode the file. Raises `UavmapError` without a GDAL that writes PDF."""
    rasterio = _gdal()
    scene = map_scene(flown.data)
    view = scene.view
    view = replace(
        view,
        px_per_m=view.px_per_m * FINER,
        width_px=view.width_px * FINER,
        height_px=view.height_px * FINER,
    )
    ground = finest_ground(flown.folder, flown.data.grid, _SIDE_PX)
    photograph = None if ground is None else ground.beneath(view)
    sheet = draw_sheet(replace(scene, view=view), photograph)
    place = _transform(flown, view)
    frame = shapely.transform(
        shapely.box(MARGIN_PX, TITLE_PX, MARGIN_PX + view.width_px, TITLE_PX + view.height_px),
        lambda pixels: np.column_stack(rasterio.Affine(*place) @ pixels.T),
    )
    profile = {
        "driver": "GTiff", "width": sheet.width, "height": sheet.height, "count": 3,
        "dtype": "uint8", "photometric": "RGB", "crs": flown.crs,
        "transform": rasterio.Affine(*place),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        raw, done = Path(name) / "sheet.tif", Path(name) / "sheet.pdf"
        with rasterio.open(raw, "w", **profile) as file:
            file.write(np.asarray(sheet).transpose(2, 0, 1))
            file.update_tags(
                TITLE=flown.data.mission,
                SUBJECT=str(flown.values.get("finding", "")),
                CREATOR=f"uavmap {__version__}",
                CREATION_DATE=_pdf_date(flown),
            )
        compressed = {"compress": "DEFLATE"}
        if photograph is not None:
            compressed = {"compress": "JPEG", "jpeg_quality": "90"}
        rasterio.shutil.copy(
            raw, done, driver="PDF", dpi=DPI, neatline=frame.wkt, layer_name="MAP", **compressed
        )
        return done.read_bytes()


def _gdal() -> Any:
    try:
        import rasterio  # noqa: PLC0415 - an extra
        import rasterio.shutil  # noqa: PLC0415
    except ImportError:
        raise UavmapError(f"--to geopdf needs rasterio: {install_command('geo')}") from None
    with rasterio.Env() as gdal:
        if "PDF" not in gdal.drivers():
            raise UavmapError(
                f"--to geopdf: the GDAL {rasterio.__gdal_version__} of this rasterio writes no "
                f"PDF; use the wheel of PyPI: {install_command('geo')}"
            )
    return rasterio


def _transform(flown: FlownMission, view: View) -> tuple[float, ...]:
    """Return the matrix from columns and rows of the sheet to UTM, in the order of `Affine`."""
    grid = flown.data.grid
    step = grid.scale / view.px_per_m
    west = grid.origin.east_m + view.left_m * grid.scale - MARGIN_PX * step
    north = grid.origin.north_m + view.top_m * grid.scale + TITLE_PX * step
    return step, 0.0, west, 0.0, -step, north


def _pdf_date(flown: FlownMission) -> str:
    """Write the date of the map; without it GDAL would write the date of the computer's clock."""
    date = flown.calendar.date(flown.data.t_s)
    if date is None:
        return _NO_DATE
    return f"D:{date:%Y%m%d%H%M%S}{'' if flown.calendar.clock == 'camera' else 'Z'}"
