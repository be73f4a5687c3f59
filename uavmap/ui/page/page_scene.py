"""The scene of a page, for JSON: ground, fence and colours; and the marks of judged pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import OutputError
from missions.events import Vote
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.geo.web_mercator import share_of
from missions.mission.schema import positions
from missions.units import GridPoint, LatLon
from uavmap.journal.kept_frames import KeptFrame
from uavmap.output.drawing import palette
from uavmap.output.drawing.mosaic_file import SIDE_PX, bounds_around
from uavmap.output.facts.map_model import State
from uavmap.photos.ground.rasters import there
from uavmap.ui.ground.layer import GroundLayer, open_layer
from vision.camera import Camera
from vision.projection import Projection
from vision.raster import Raster

PAPER: Final = (243, 247, 247)
_QUALITY: Final = 80
MAX_TILES: Final = 120
"""Maximum number of tiles; a larger area takes a coarser zoom."""
_NODES: Final = 33
"""Number of points on each side for which the projection is computed; linear between them."""
_MERCATOR_M: Final = 2.0 * math.pi * 6378137.0

Colours = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Background:
    """A picture of the ground, with its rectangle in the fixed frame."""

    jpeg: bytes
    west_m: float
    north_m: float
    width_m: float
    height_m: float

    @property
    def place(self) -> dict[str, Any]:
        """The place of the picture, for the scene of a page."""
        return placed(self.west_m, self.north_m, self.width_m, self.height_m)


def placed(west_m: float, north_m: float, width_m: float, height_m: float) -> dict[str, Any]:
    """Return the place of a picture of the ground, for JSON."""
    return {"west": west_m, "north": north_m, "width_m": width_m, "height_m": height_m}


def jpeg(image: NDArray[Any]) -> bytes:
    """Encode a picture of the ground for a page."""
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


def background_from_tiles(path: Path, setting: Setting) -> Background:
    """Return the part of a map file (`uavmap.ui.ground`) beneath a mission.

    Raises `OutputError` for another file, for vector tiles, or without tiles of the place.
    """
    west_m, south_m, east_m, north_m = bounds_around(setting)
    m_per_px = max(east_m - west_m, north_m - south_m) / SIDE_PX
    size = (round((east_m - west_m) / m_per_px), round((north_m - south_m) / m_per_px))
    nodes = _mercator(setting.grid, np.linspace(west_m, east_m, _NODES),
                      np.linspace(north_m, south_m, _NODES))  # fmt: skip
    with closing(open_layer(path)) as layer:
        laid = _laid(layer, nodes, m_per_px, setting.mission.home.lat_deg)
    if laid is None:
        raise OutputError(
            f"--tiles {path}: has no tile at the place of the mission; give tiles around latitude "
            f"{setting.mission.home.lat_deg:.3f}, longitude {setting.mission.home.lon_deg:.3f}"
        )
    canvas, pixels = laid
    maps = [cv2.resize(pixels[..., i].astype(np.float32), size) for i in (0, 1)]
    image = cv2.remap(canvas, maps[0], maps[1], cv2.INTER_LINEAR, borderValue=PAPER)
    return Background(
        jpeg(image), west_m, north_m, round(east_m - west_m, 3), round(north_m - south_m, 3)
    )


def background_from_mosaic(path: Path, setting: Setting) -> Background | None:
    """Return the mosaic of results; None without it or rasterio, or for a drifting region."""
    if not path.is_file() or not there() or setting.grid.drift_speed_m_s:
        return None
    import rasterio  # noqa: PLC0415 - an extra

    grid = setting.grid
    try:
        with rasterio.open(path) as file:
            if file.crs is None or file.crs.to_epsg() != grid.zone.epsg or file.count < 3:
                return None
            shrink = max(max(file.width, file.height) / SIDE_PX, 1.0)
            shape = (max(round(file.height / shrink), 1), max(round(file.width / shrink), 1))
            bands = file.read((1, 2, 3), out_shape=(3, *shape))
            seen = file.dataset_mask(out_shape=shape)
            bounds = file.bounds
    except OSError:  # the base of rasterio's errors
        return None
    image = np.ascontiguousarray(bands.transpose(1, 2, 0)[..., ::-1])
    image[seen == 0] = PAPER
    return Background(
        jpeg(image),
        (bounds.left - grid.origin.east_m) / grid.scale,
        (bounds.top - grid.origin.north_m) / grid.scale,
        (bounds.right - bounds.left) / grid.scale,
        (bounds.top - bounds.bottom) / grid.scale,
    )


def _mercator(
    grid: Grid, easts: NDArray[np.float64], norths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return Web Mercator, 0 to 1 from the upper left corner of the world, by rows and columns."""
    places = [grid.position(GridPoint(e, n)) for n in norths.tolist() for e in easts.tolist()]
    shares = share_of([place.lat_deg for place in places], [place.lon_deg for place in places])
    return np.stack(shares, axis=-1).reshape(len(norths), len(easts), 2)


def _laid(
    file: GroundLayer, nodes: NDArray[np.float64], m_per_px: float, lat_deg: float
) -> tuple[Colours, NDArray[np.float64]] | None:
    low, high = file.zooms[0], file.zooms[-1]
    fine = math.log2(_MERCATOR_M * math.cos(math.radians(lat_deg)) / 256.0 / m_per_px)
    for zoom in range(min(high, math.ceil(fine), 24), max(low, 0) - 1, -1):
        (left, top), (right, bottom) = (
            np.floor(edge * 2**zoom).astype(int).tolist()
            for edge in (nodes.min(axis=(0, 1)), nodes.max(axis=(0, 1)))
        )
        if (right - left + 1) * (bottom - top + 1) > MAX_TILES:
            continue
        tiles = dict(_tiles(file, zoom, range(left, right + 1), range(top, bottom + 1)))
        if tiles:
            side = next(iter(tiles.values())).shape[0]
            shape = ((bottom - top + 1) * side, (right - left + 1) * side, 3)
            canvas: Colours = np.full(shape, PAPER, np.uint8)
            for (x, y), tile in tiles.items():
                if tile.shape == (side, side, 3):
                    at = ((y - top) * side, (x - left) * side)
                    canvas[at[0] : at[0] + side, at[1] : at[1] + side] = tile
            return canvas, (nodes * 2**zoom - (left, top)) * side - 0.5
    return None


def _tiles(
    file: GroundLayer, zoom: int, columns: range, rows: range
) -> Iterator[tuple[tuple[int, int], Colours]]:
    for x in columns:
        for y in rows:
            if (data := file.tile(zoom, x, y)) is None:
                continue
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            if image is not None and image.shape[0] <= 1024:
                yield (x, y), _on_paper(image)


def _on_paper(image: NDArray[Any]) -> Colours:
    """Return a tile in colours, with its gaps filled."""
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2).astype(np.uint8)
    if image.shape[2] == 3:
        return image.astype(np.uint8)
    there = image[..., 3:] / 255.0
    return np.round(image[..., :3] * there + np.array(PAPER) * (1.0 - there)).astype(np.uint8)


STATES: Final[tuple[State, ...]] = tuple(palette.STATES)
"""States of a cell; a board has their index. Classes of the region follow them."""


def scene_of(
    setting: Setting,
    background: Background | None = None,
    mosaic: Raster | None = None,
    *,
    recorded: bool = False,
    drawn: bool = True,
) -> dict[str, Any]:
    """Return the scene of a mission, for JSON, with the picture under its map.

    Points are in m east and north in the fixed frame. Cells are in the moving frame, which drifts
    with `drift_m_s` from mission time 0. `grid` has the arguments of `Grid.at`, the first as
    latitude and longitude.

    Args:
        setting: The setting of the mission.
        background: The picture beneath the map.
        mosaic: The place of the mosaic of the results in the fixed frame; the mosaic may grow.
        recorded: True for recorded pictures.
        drawn: True if box and fence are drawn, and not derived from pictures.
    """
    mission, grid, drift = setting.mission, setting.grid, setting.mission.drift

    def ring(places: Iterable[LatLon]) -> list[list[float]]:
        points = (grid.fixed(place) for place in places)
        return [[round(point.east_m, 2), round(point.north_m, 2)] for point in points]

    (home,) = ring([mission.home])
    rings = (mission.search.box, mission.fence.polygon, *mission.fence.holes)
    box, fence, *holes = (ring(positions(one)) if drawn else [] for one in rings)
    names = palette.RECORDED_NAMES if recorded else palette.STATE_NAMES
    detector = mission.detector
    classes = (
        []
        if detector.classes is None
        else [
            [detector.classes.names[number], palette.css(palette.class_colour(number))]
            for number in detector.explored
        ]
    )
    return {
        "mission": mission.name,
        "strategy": "recorded pictures" if recorded else mission.strategy,
        "vehicles": 0 if recorded else len(mission.vehicles),
        "cell_m": grid.cell_m,
        "grid": [
            mission.home.lat_deg,
            mission.home.lon_deg,
            grid.cell_m,
            drift.speed_m_s,
            drift.toward_deg,
        ],
        "drift_m_s": [round(grid.drift_east_m_s, 6), round(grid.drift_north_m_s, 6)],
        "home": home,
        "home_mark": []
        if recorded
        else [[radius, palette.css(colour)] for radius, colour in palette.HOME_DOT],
        "box": box,
        "fence": fence,
        "holes": holes,
        "states": [
            *([names[state], palette.css(palette.STATES[state])] for state in STATES),
            *classes,
        ],
        "classes": [name for name, _ in classes],
        "lines": {
            key: {"name": name, "colour": palette.css(style.colour), "dash": style.dash_px}
            for key, (name, style) in palette.LINES.items()
            if key in ("box", "fence") and drawn
        },
        "marks": {} if recorded else dict(palette.MARKS),
        "ink": palette.css(palette.INK),
        "traffic": palette.css(palette.TRAFFIC),
        "land": palette.css(palette.LAND),
        "background": None if background is None else background.place,
        "mosaic": None
        if mosaic is None
        else placed(
            mosaic.west_m,
            mosaic.north_m,
            mosaic.columns * mosaic.pitch_m,
            mosaic.rows * mosaic.pitch_m,
        ),
        "tracks": [palette.css(colour) for colour in palette.TRACKS],
    }


def camera_of(setting: Setting, frame: KeptFrame) -> Camera:
    """Return the camera of a picture, with the size at which it is judged."""
    optics = setting.mission.camera.optics
    return Camera(math.radians(frame.hfov_deg), optics.width_px, optics.height_px)


def marks_of(setting: Setting, frame: KeptFrame, votes: Sequence[Vote]) -> dict[str, Any]:
    """Return the verdicts of a picture, for JSON.

    `cells` has a row for each cell in front of the camera. The first eight values are its corners,
    as shares of the picture's width and height. Then come 1 for region, else 0, and the share of
    its pixels that are rated as region.
    """
    optics, camera = setting.mission.camera.optics, camera_of(setting, frame)
    laid = Projection(camera, frame.pose, frame.t_s, setting.grid, setting.ground)
    corners = np.array(
        [setting.grid.corners_of(vote.cell) for vote in votes], dtype=np.float64
    ).reshape(-1, 4, 2)
    size = np.array([optics.width_px, optics.height_px], dtype=np.float64)
    parts = (laid.pixels(corners) + 0.5) / size
    cells = [
        [*(round(float(part), 4) for part in quad.ravel()), int(vote.positive), vote.share]
        for quad, vote in zip(parts, votes, strict=True)
        if np.isfinite(quad).all()
    ]
    return {"vehicle": frame.vehicle, "t_s": frame.t_s, "cells": cells}
