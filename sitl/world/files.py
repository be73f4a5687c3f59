"""Worlds from files: regions from GeoJSON, the ground from a georeferenced picture.

GeoJSON is WGS84 (RFC 7946). A picture is a GeoTIFF, or a PNG or JPEG with a world file beside it
(six numbers: `a.pgw`, `a.jgw`, `a.wld`, ...). The coordinate system of that is given as an EPSG
code.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyproj
from PIL import Image, UnidentifiedImageError
from pyproj.exceptions import CRSError
from shapely.geometry import Polygon

from missions.errors import WorldError
from missions.geo.geodesy import LocalPlane
from missions.units import LatLon
from sitl.world.ground import Matrix, Orthophoto
from sitl.world.world import Patch

WGS84 = 4326
_FARTHEST_M = 20_000.0  # from home: the plane is flat, and the camera sees nothing so far away
_SUFFIXES = {"JPEG": (".jgw", ".jpgw", ".jpegw"), "PNG": (".pgw", ".pngw"), "TIFF": (".tfw",)}

# TIFF tags and GeoTIFF keys (OGC 19-008)
_PIXEL_SCALE, _TIE_POINT, _TRANSFORMATION, _KEYS = 33550, 33922, 34264, 34735
_MODEL_TYPE, _RASTER_TYPE, _GEOGRAPHIC, _PROJECTED = 1024, 1025, 2048, 3072
_PIXEL_IS_POINT, _USER_DEFINED = 2, 32767


@dataclass(frozen=True, slots=True)
class Ground:
    """Regions of interest, and the picture of the ground below them."""

    patches: tuple[Patch, ...] = ()
    orthophoto: Orthophoto | None = None


def load_ground(
    paths: Sequence[Path | str], epsg: int | None = None, home: LatLon | None = None
) -> Ground:
    """Load the ground from files, at most one of them a picture.

    Args:
        paths: GeoJSON (`.geojson`, `.json`) and pictures.
        epsg: System of the coordinates of a world file, by default WGS84 degrees.
        home: Place of the vehicles; the ground has to be within 20 km.

    Raises:
        WorldError: A file is wrong; names it and the reason.
    """
    patches: list[Patch] = []
    orthophoto: Orthophoto | None = None
    for path in map(Path, paths):
        if path.suffix.lower() in (".geojson", ".json"):
            more = load_patches(path)
            patches += more
            first = more[0].polygon[0]
        else:
            if orthophoto is not None:
                raise WorldError(f"{path}: one picture can be the ground, not two")
            orthophoto = load_orthophoto(path, epsg)
            rows, columns = orthophoto.known.shape
            first = orthophoto.position(columns / 2, rows / 2)
        if home is not None:
            away_m = math.hypot(*LocalPlane(home).to_plane(first))
            if not away_m <= _FARTHEST_M:
                raise WorldError(
                    f"{path}: lies at {first.lat_deg:.5f}, {first.lon_deg:.5f}, "
                    f"{away_m / 1000.0:.0f} km from home"
                )
    return Ground(tuple(patches), orthophoto)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise WorldError(f"{path}: {error.strerror or error}") from error


# --- GeoJSON ------------------------------------------------------------------------------------
def load_patches(path: Path) -> tuple[Patch, ...]:
    """Return the polygons of a GeoJSON file; raises `WorldError` if there are none."""
    try:
        root = json.loads(_read(path))
    except (ValueError, RecursionError) as error:
        raise WorldError(f"{path}: not JSON ({error})") from error
    patches = []
    for number, coordinates in enumerate(_polygons(root, path), start=1):
        try:
            shell, *holes = [_ring(ring) for ring in coordinates]
            if not Polygon(_xy(shell), [_xy(hole) for hole in holes]).is_valid:
                raise ValueError("its outline crosses itself, or a hole lies outside")
        except (ValueError, TypeError) as error:
            raise WorldError(f"{path}: polygon {number}: {error}") from error
        patches.append(Patch(shell, tuple(holes)))
    if not patches:
        raise WorldError(f"{path}: no Polygon or MultiPolygon in this file")
    return tuple(patches)


def _polygons(item: Any, path: Path) -> Iterator[Any]:
    kind = item.get("type") if isinstance(item, dict) else None
    try:
        if kind == "FeatureCollection":
            for feature in item["features"]:
                yield from _polygons(feature, path)
        elif kind == "Feature":
            if item["geometry"] is not None:
                yield from _polygons(item["geometry"], path)
        elif kind == "GeometryCollection":
            for geometry in item["geometries"]:
                yield from _polygons(geometry, path)
        elif kind == "Polygon":
            yield item["coordinates"]
        elif kind == "MultiPolygon":
            yield from item["coordinates"]
        else:
            raise WorldError(
                f"{path}: {kind or 'something without a type'}: a world is made of Polygon, "
                "MultiPolygon, Feature, FeatureCollection"
            )
    except (KeyError, TypeError) as error:
        raise WorldError(f"{path}: {kind} without {error}") from error


def _ring(points: Any) -> tuple[LatLon, ...]:
    ring = []
    for lon, lat, *_ in points:
        if not (math.isfinite(lon) and abs(lon) <= 180.0 and abs(lat) <= 90.0):
            raise ValueError(f"{lon}, {lat} is not a longitude and a latitude in degrees")
        ring.append(LatLon(float(lat), float(lon)))
    if len(ring) < 4 or ring[0] != ring[-1]:
        raise ValueError("a ring has four positions or more, the last equal to the first")
    return tuple(ring[:-1])


def _xy(ring: Sequence[LatLon]) -> list[tuple[float, float]]:
    return [(p.lon_deg, p.lat_deg) for p in ring]


# --- pictures -----------------------------------------------------------------------------------
def load_orthophoto(path: Path, epsg: int | None = None) -> Orthophoto:
    """Load a GeoTIFF, or a PNG or JPEG with a world file; raises `WorldError`."""
    try:
        with warnings.catch_warnings():
            # Pillow warns of large pictures, and refuses the largest
            warnings.simplefilter("ignore")
            with Image.open(path, formats=tuple(_SUFFIXES)) as picture:
                kind = picture.format or ""
                tags: Mapping[int, Any] = getattr(picture, "tag_v2", {})
                to_crs, own_epsg = _place(path, kind, tags)
                pixels, known = _pixels(picture, path)
    except FileNotFoundError as error:
        raise WorldError(f"{path}: no such file") from error
    except UnidentifiedImageError as error:
        raise WorldError(f"{path}: neither GeoJSON nor a GeoTIFF, PNG or JPEG") from error
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise WorldError(f"{path}: not a readable picture ({error})") from error
    code = own_epsg or epsg or WGS84
    try:
        pyproj.CRS.from_epsg(code)
    except CRSError as error:
        raise WorldError(f"{path}: EPSG:{code} is not a known coordinate system") from error
    try:
        return Orthophoto(pixels, known, to_crs, code)
    except WorldError as error:
        hint = "" if own_epsg or epsg else "; give its EPSG code"
        raise WorldError(f"{path}: {error}{hint}") from error


def _pixels(
    picture: Image.Image, path: Path
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Return blue-green-red, and where there are data."""
    if picture.mode not in ("1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "YCbCr"):
        raise WorldError(f"{path}: its pixels are {picture.mode}; save it with 8 bits a channel")
    rgba = np.asarray(picture.convert("RGBA"))
    return np.ascontiguousarray(rgba[:, :, 2::-1]), np.ascontiguousarray(rgba[:, :, 3])


def _place(path: Path, kind: str, tags: Mapping[int, Any]) -> tuple[Matrix, int | None]:
    """Return the matrix from pixels to coordinates, and their system if the file names it."""
    if _TRANSFORMATION in tags or (_PIXEL_SCALE in tags and _TIE_POINT in tags):
        return _geotiff(path, tags)
    for suffix in (*_SUFFIXES[kind], f"{path.suffix}w", ".wld"):
        for name in (path.with_suffix(suffix), path.with_suffix(suffix.upper())):
            if name.is_file():
                return _world_file(name), None
    expected = path.with_suffix(_SUFFIXES[kind][0]).name
    raise WorldError(f"{path}: its place is unknown: no GeoTIFF tags, no {expected} or .wld")


def _world_file(path: Path) -> Matrix:
    try:
        a, d, b, e, c, f = (float(word) for word in _read(path).decode("ascii").split())
    except ValueError as error:
        raise WorldError(f"{path}: a world file holds six numbers ({error})") from error
    return _affine(path, ((a, b, c), (d, e, f)))


def _affine(path: Path, rows: Sequence[Sequence[float]]) -> Matrix:
    matrix = np.array([*rows, (0.0, 0.0, 1.0)], dtype=np.float64)
    if not np.isfinite(matrix).all():
        raise WorldError(f"{path}: its place is not given in finite numbers")
    return matrix


def _geotiff(path: Path, tags: Mapping[int, Any]) -> tuple[Matrix, int | None]:
    keys = _geo_keys(tags.get(_KEYS, ()))
    if _TRANSFORMATION in tags:
        m = [float(v) for v in tags[_TRANSFORMATION]]
        if len(m) != 16:
            raise WorldError(f"{path}: GeoTIFF tag {_TRANSFORMATION} has not 16 numbers")
        matrix = _affine(path, ((m[0], m[1], m[3]), (m[4], m[5], m[7])))
    else:
        scale, tie = tags[_PIXEL_SCALE], tags[_TIE_POINT]
        if len(scale) < 2 or len(tie) < 6:
            raise WorldError(f"{path}: GeoTIFF tags {_PIXEL_SCALE}, {_TIE_POINT} are too short")
        sx, sy = float(scale[0]), float(scale[1])
        column, row, x, y = (float(tie[i]) for i in (0, 1, 3, 4))
        matrix = _affine(path, ((sx, 0.0, x - sx * column), (0.0, -sy, y + sy * row)))
    if keys.get(_RASTER_TYPE) != _PIXEL_IS_POINT:
        # (0, 0) of a raster of areas is the corner of the first pixel, not its centre
        matrix = matrix @ np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    code = keys.get(_PROJECTED if keys.get(_MODEL_TYPE) == 1 else _GEOGRAPHIC)
    return matrix, None if code in (0, _USER_DEFINED) else code


def _geo_keys(directory: Sequence[int]) -> dict[int, int]:
    """Return the keys whose values are in the directory itself, as all codes are."""
    entries = [directory[i : i + 4] for i in range(4, len(directory) - 3, 4)]
    return {int(key): int(value) for key, place, _, value in entries if place == 0}
