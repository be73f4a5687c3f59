"""The KML with times and its mosaic in one file, for Google Earth, phones and ground stations.

The mosaic is in UTM. It is resampled along meridians and parallels, so that a LatLonBox gives its
place. LatLonBox is in the standard; gx:LatLonQuad is an extension.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np

from uavmap.output.drawing.mosaic_file import Ground, finest_ground
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.facts.map_model import MapData, turned
from uavmap.output.formats import kml_encoder
from uavmap.output.formats.archive_bytes import zipped
from uavmap.output.formats.layers import Layer
from vision.mosaic import Colours

SIDE_PX: Final = 2048
"""Maximum of the longer side of the picture, px: phones draw no larger one."""
PICTURE: Final = "files/mosaic.png"
_LOG: Final = logging.getLogger("uavmap.output")


class Overlay(NamedTuple):
    """A picture whose rows are parallels: red, green, blue, opacity; its edges in degrees."""

    image: Colours
    west: float
    south: float
    east: float
    north: float


def encode(flown: FlownMission, layers: Sequence[Layer]) -> bytes:
    """Encode the archive; without a mosaic, write the map alone, and report it."""
    ground = finest_ground(flown.folder, flown.data.grid, SIDE_PX)
    if ground is None:
        _LOG.info(f"{flown.folder}: has no mosaic; the KMZ has the map alone")
        return zipped({"doc.kml": kml_encoder.encode(flown, layers)})
    overlay = along_meridians(ground, flown.data)
    done, png = cv2.imencode(".png", cv2.cvtColor(overlay.image, cv2.COLOR_RGBA2BGRA))
    assert done
    document = kml_encoder.encode(flown, layers, ground=_ground_overlay(overlay))
    return zipped({"doc.kml": document, PICTURE: png.tobytes()})


def along_meridians(ground: Ground, data: MapData) -> Overlay:
    """Resample a mosaic to rows along parallels.

    A projective map by the four corners is enough. Over 10 km, meridians and parallels in UTM bend
    by 2.4 m, half a pixel of the largest picture.
    """
    raster, grid = ground.raster, data.grid
    high, wide = ground.image.shape[:2]
    pixels = np.array([(0, 0), (wide, 0), (wide, high), (0, high)], np.float64)
    fixed = (raster.west_m, raster.north_m) + pixels * (raster.pitch_m, -raster.pitch_m)
    degrees = grid.zone.lon_lat((grid.origin.east_m, grid.origin.north_m) + fixed * grid.scale)
    degrees[:, 0] = turned(degrees[:, 0], data.start)
    (west, south), (east, north) = degrees.min(axis=0).tolist(), degrees.max(axis=0).tolist()
    # the same resolution along the longer side, at any latitude
    stretch = np.cos(np.radians((south + north) / 2.0))
    shrink = max(wide, high) / max((east - west) * stretch, north - south)
    size = max(round((east - west) * stretch * shrink), 1), max(round((north - south) * shrink), 1)
    target = (degrees - (west, north)) / (east - west, south - north) * size
    # here coordinates are edges of pixels, in OpenCV they are middles
    matrix = cv2.getPerspectiveTransform(
        (pixels - 0.5).astype(np.float32), (target - 0.5).astype(np.float32)
    )
    image = cv2.warpPerspective(ground.image, matrix, size, flags=cv2.INTER_LINEAR)
    laid = np.asarray(image, np.uint8)
    laid[..., 3] = np.where(laid[..., 3] >= 250, 255, 0)  # rims have colours of what is not there
    return Overlay(laid, west, south, east, north)


def _ground_overlay(overlay: Overlay) -> str:
    edges = (
        f"<{name}>{value:.9f}</{name}>"
        for name, value in (
            ("north", overlay.north), ("south", overlay.south),
            ("east", overlay.east), ("west", overlay.west),
        )
    )  # fmt: skip
    return (
        f"<GroundOverlay><name>Mosaic</name><drawOrder>-1</drawOrder><Icon><href>{PICTURE}</href>"
        f"</Icon><LatLonBox>{''.join(edges)}</LatLonBox></GroundOverlay>\n"
    )
