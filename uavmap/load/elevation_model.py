"""A digital elevation model in a GeoTIFF: its heights, in metres, wherever they are asked for."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyproj
from numpy.typing import NDArray

from missions.errors import MissionFileError
from missions.units import LatLon
from uavmap.base.extras import install_command

_FOOT_M: Final = 0.3048
_SURVEY_FOOT_M: Final = 1200.0 / 3937.0
_METRES: Final = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot", "international feet"), _FOOT_M),
    **dict.fromkeys(("us-ft", "us_ft", "ftus", "us survey foot", "us survey feet"), _SURVEY_FOOT_M),
}
"""How many metres a unit has that a band names."""
_WGS84: Final = pyproj.CRS.from_epsg(4326)

Floats = NDArray[np.float64]


@contextlib.contextmanager
def opened(path: Path, where: str) -> Iterator[Any]:
    """The model, open. Raises `MissionFileError` where it is none."""
    try:
        import rasterio  # noqa: PLC0415 - an extra
        from rasterio.errors import NotGeoreferencedWarning, RasterioError  # noqa: PLC0415
    except ImportError:
        raise MissionFileError(
            f"{where}: a GeoTIFF needs rasterio: {install_command('geo')}"
        ) from None
    if not path.is_file():
        raise MissionFileError(f"{where}: there is no such file beside the mission file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path, driver="GTiff") as model:
                if model.crs is None:
                    raise MissionFileError(
                        f"{where}: it does not say its coordinate system; write it into the file "
                        "(gdal_edit.py -a_srs EPSG:...)"
                    )
                if model.count != 1:
                    raise MissionFileError(
                        f"{where}: it has {model.count} bands, where a model has one, of heights; "
                        "is it a picture?"
                    )
                if not (_crs(model).is_geographic or _crs(model).is_projected):
                    raise MissionFileError(
                        f"{where}: its coordinate system, {_crs(model).name!r}, is tied to no "
                        "place; write the right one into the file (gdal_edit.py -a_srs EPSG:...)"
                    )
                yield model
    except RasterioError as error:
        raise MissionFileError(f"{where}: cannot be read as a GeoTIFF ({error})") from None


def _crs(model: Any) -> pyproj.CRS:
    return pyproj.CRS.from_user_input(model.crs.to_wkt())


def metres_a_unit(model: Any, where: str) -> float:
    """How many metres a unit of the heights has: by the band, by the vertical system, or one."""
    unit = model.units[0]
    if unit:
        if unit.casefold() not in _METRES:
            raise MissionFileError(
                f"{where}: its heights are in {unit!r}, which is no unit that is known here; "
                "convert them to metres"
            )
        return _METRES[unit.casefold()]
    vertical = [axis for axis in _crs(model).axis_info if axis.direction in ("up", "down")]
    if any(axis.direction == "down" for axis in vertical):
        raise MissionFileError(f"{where}: it holds depths; take a model of heights")
    return vertical[0].unit_conversion_factor if vertical else 1.0


def spacing_m(model: Any, start: LatLon) -> float:
    """Return the distance of two heights near the start, m; infinite for one outside."""
    crs = _crs(model)
    to_model = pyproj.Transformer.from_crs(_WGS84, crs, always_xy=True)
    back = pyproj.Transformer.from_crs(crs, _WGS84, always_xy=True)
    x, y = to_model.transform(start.lon_deg, start.lat_deg)
    if not (math.isfinite(x) and math.isfinite(y)):
        return math.inf
    to_pixel, to_place = _pixels_and_places(model)
    column, row = to_pixel @ (x, y, 1.0)
    geod, spacings = pyproj.Geod(ellps="WGS84"), []
    for step in ((1.0, 0.0), (0.0, 1.0)):
        lon, lat = back.transform(*(to_place @ (column + step[0], row + step[1], 1.0)))
        spacings.append(abs(geod.inv(start.lon_deg, start.lat_deg, lon, lat)[2]))
    widest_m = max(spacings)
    return widest_m if math.isfinite(widest_m) else math.inf


def _pixels_and_places(model: Any) -> tuple[Floats, Floats]:
    """The (2, 3) matrices from places in the model's system to pixels, and back."""
    a, b, c, d, e, f = tuple(model.transform)[:6]
    places = np.array([[a, b, c], [d, e, f], [0.0, 0.0, 1.0]])
    return np.linalg.inv(places)[:2], places[:2]


def heights_at(
    model: Any, epsg: int, places: tuple[Floats, Floats], step: int, where: str
) -> Floats:
    """Return the model's heights at places in a system, east and north; NaN where it has none.

    Bilinear between pixels, or, with a `step` above 1, between means of `step` x `step` pixels: a
    model of centimetres holds stones, and more pixels than memory.
    """
    system = pyproj.CRS.from_epsg(epsg)
    to_model = pyproj.Transformer.from_crs(system, _crs(model), always_xy=True)
    x, y = to_model.transform(*places)
    to_pixel, _ = _pixels_and_places(model)
    columns, rows = to_pixel @ np.stack([x, y, np.ones_like(x)])
    found = np.full(columns.shape, np.nan)
    known = np.isfinite(columns) & np.isfinite(rows)
    known &= (columns >= 0.0) & (columns <= model.width) & (rows >= 0.0) & (rows <= model.height)
    if not known.any():
        return found
    across = _Stretch.around(columns[known], step, model.width)
    along = _Stretch.around(rows[known], step, model.height)
    if across.count < 2 or along.count < 2:
        raise MissionFileError(f"{where}: only a line of its heights lies in the fence")
    band = _means(model, along, across)
    right, down = across.at(columns[known]), along.at(rows[known])
    j = np.minimum(right.astype(np.intp), across.count - 2)
    i = np.minimum(down.astype(np.intp), along.count - 2)
    right, down = right - j, down - i
    upper = band[i, j] * (1.0 - right) + band[i, j + 1] * right
    lower = band[i + 1, j] * (1.0 - right) + band[i + 1, j + 1] * right
    found[known] = upper * (1.0 - down) + lower * down
    return found


@dataclass(frozen=True, slots=True)
class _Stretch:
    """The columns, or rows, of a model that are read: from `first` to before `end`, as `count`."""

    first: int
    end: int
    count: int

    @classmethod
    def around(cls, edges: Floats, step: int, size: int) -> _Stretch:
        """All that lie around these coordinates, `step` of them as one."""
        first = max(math.floor(edges.min()) - step, 0)
        end = min(math.ceil(edges.max()) + step, size)
        return cls(first, end, math.ceil((end - first) / step))

    def at(self, edges: Floats) -> Floats:
        """Where a coordinate lies between the middles of what is read, the first being 0."""
        each = (self.end - self.first) / self.count
        inside: Floats = np.clip((edges - self.first) / each - 0.5, 0.0, self.count - 1.0)
        return inside


def _means(model: Any, along: _Stretch, across: _Stretch) -> Floats:
    """The heights in two stretches of rows and columns; NaN where there is none."""
    from rasterio.enums import Resampling  # noqa: PLC0415 - an extra

    band = model.read(
        1,
        window=((along.first, along.end), (across.first, across.end)),
        out_shape=(along.count, across.count),
        resampling=Resampling.average,
        masked=True,
    )
    heights: Floats = band.astype(np.float64).filled(np.nan) * model.scales[0] + model.offsets[0]
    return heights
