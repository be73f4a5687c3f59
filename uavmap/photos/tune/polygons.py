"""Polygons on the ground, in GeoJSON, projected into pictures as painted examples."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.classes import Classes
from missions.errors import ImageError
from missions.geo.grid import Grid
from missions.units import LatLon
from uavmap.base.messages import muted
from uavmap.base.text_files import read_text
from uavmap.photos.registration.refined_pictures import refined
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.sources.picture_record import Placed, credible
from vision.camera import Camera, project

SURROUND: Final = 0
REGION: Final = 1
UNKNOWN: Final = 255
"""Values of a pixel besides the number of a class; `REGION` if there are no classes."""
_LARGEST_GEOJSON: Final = 20_000_000
_GRID_M: Final = 2.0  # the grid serves for metres only
_WGS84: Final = ("CRS84", "EPSG::4326", "EPSG:4326")
_KINDS: Final = {"region": REGION, "surround": SURROUND, "undecided": UNKNOWN}

Rings = list[NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Polygons:
    """Polygons with the kinds that they paint, and the pictures with a pose."""

    shapes: Sequence[tuple[int, Rings]]
    placed: Sequence[Placed]

    @classmethod
    def read(cls, images: Path, files: Sequence[Path], classes: Classes | None) -> Self:
        """Read the files, and the poses of a folder of pictures. Raises `ImageError`."""
        shapes = [shape for path in files for shape in _shapes(path, classes)]
        gathered = gather(open_source(images))
        with muted():
            better = refined(gathered)
        verdicts = credible(better.gathered.posed)
        placed = [entry for entry in verdicts if not isinstance(entry, str)]
        if not placed:
            raise ImageError(
                f"{images}: polygons cannot be projected into pictures without a pose "
                f"({gathered.pictures[0].name}: {verdicts[0]}); paint masks"
            )
        return cls(shapes, placed)

    def painted(self, placed: Placed, shape: tuple[int, ...]) -> NDArray[np.uint8]:
        """Return the painted kinds of a picture's pixels, (rows, columns): see `Example`.

        Without a polygon of the surround, all other ground is surround.
        """
        lens = placed.picture.lens
        if lens is None:
            raise ImageError(
                f"{placed.picture.name}: no tag has its focal length, without which polygons "
                "cannot be projected into it; paint a mask"
            )
        rows, columns = shape
        grid = Grid.at(self.placed[0].pose.position, _GRID_M)
        matrix = Camera(lens.hfov_rad, columns, rows).homography(placed.pose, grid, 0.0)
        limited = any(kind == SURROUND for kind, _ in self.shapes)
        painted = np.full(shape, UNKNOWN if limited else SURROUND, np.uint8)
        # the surround is below the region, and the undecided ground above it
        for kind, rings in sorted(self.shapes, key=lambda one: _order(one[0])):
            painted[_drawn(rings, matrix, grid, shape)] = kind
        return painted


def _order(kind: int) -> int:
    return {SURROUND: 0, UNKNOWN: 2}.get(kind, 1)


def _drawn(
    rings: Rings, matrix: NDArray[np.float64], grid: Grid, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Return True for the pixels of a picture inside a polygon."""
    layer = np.zeros(shape, np.uint8)
    for ring in rings:  # even-odd: the first is the outline, the others are holes
        metres = [grid.fixed(LatLon(lat, lon)) for lon, lat in ring]
        pixels, _ = project(matrix, np.array([[p.east_m, p.north_m] for p in metres]))
        if np.isfinite(pixels).all() and np.abs(pixels).max() < 1e6:
            one = np.zeros_like(layer)
            cv2.fillPoly(one, [np.round(pixels * 16).astype(np.int32)], (255,), shift=4)
            layer ^= one
    return layer > 0


def _shapes(path: Path, classes: Classes | None) -> list[tuple[int, Rings]]:
    """Return the polygons of a GeoJSON file, and the kinds that they paint."""
    try:
        root = json.loads(read_text(path, _LARGEST_GEOJSON))
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise ImageError(f"{path}: not JSON ({error})") from None
    _refuse_other_crs(root, path)
    features = root.get("features") if isinstance(root, dict) else None
    if not isinstance(features, list) or not features:
        raise ImageError(f"{path}: no FeatureCollection with features; draw polygons")
    shapes = []
    for i, feature in enumerate(features):
        where, feature = f"{path}: features[{i}]", feature if isinstance(feature, dict) else {}
        geometry, properties = feature.get("geometry"), feature.get("properties")
        kind = _kind(properties if isinstance(properties, dict) else {}, classes, where)
        sort = geometry.get("type") if isinstance(geometry, dict) else None
        if not isinstance(geometry, dict) or sort not in ("Polygon", "MultiPolygon"):
            raise ImageError(f"{where}: a {sort}; draw a Polygon or a MultiPolygon")
        parts = geometry.get("coordinates")
        for part in [parts] if sort == "Polygon" else (parts or []):
            shapes.append((kind, _rings(part, where)))
    return shapes


def _kind(properties: Mapping[str, Any], classes: Classes | None, where: str) -> int:
    """Return the kind that a feature paints: by its property `kind`, or with classes by `class`."""
    kind = properties.get("kind", "region")
    if kind not in _KINDS:
        raise ImageError(f"{where}: kind is {kind!r}: expected one of {', '.join(_KINDS)}")
    if classes is None or kind != "region":
        return _KINDS[kind]
    given = properties.get("class")
    for number, name in classes.names.items():
        if given in (name, number):
            return number
    named = ", ".join(f"{name} ({number})" for number, name in classes.names.items())
    raise ImageError(f"{where}: class is {given!r}: expected one of {named}")


def _refuse_other_crs(root: Any, path: Path) -> None:
    """Raise `ImageError` if a file names another coordinate system, as old GeoJSON may."""
    crs = root.get("crs") if isinstance(root, dict) else None
    if crs is None:
        return
    text = json.dumps(crs)
    if not any(name in text for name in _WGS84):
        raise ImageError(
            f"{path}: crs is {text[:80]}; export the polygons as GeoJSON (RFC 7946), which is in "
            "WGS84 (EPSG:4326)"
        )


def _rings(part: Any, where: str) -> Rings:
    try:
        rings = [np.array([[float(p[0]), float(p[1])] for p in ring]) for ring in part]
    except (TypeError, ValueError, IndexError, KeyError):
        raise ImageError(f"{where}: not rings of [longitude, latitude]") from None
    for ring in rings:
        good = len(ring) >= 3 and bool(np.isfinite(ring).all())
        if not good or (np.abs(ring) > [180.0, 90.0]).any() or math.isnan(ring.sum()):
            raise ImageError(
                f"{where}: a ring of less than 3 places, or of no places on Earth; coordinates are "
                "longitude and latitude in WGS84 (EPSG:4326)"
            )
    return rings
