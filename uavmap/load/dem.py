"""The ground from the GeoTIFF that `terrain.dem` names, as a lattice that a mission holds.

A model may have any coordinate system and sea level. So its heights are sampled along the mission's
grid, relative to the start, and stored in the mission.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from missions.errors import MissionFileError
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain, encoded
from missions.mission.places import drawn, positions_near
from missions.mission.schema import Mission
from missions.mission.sections import MAX_POINTS, Lattice, TerrainSection
from missions.units import GridPoint, LatLon
from uavmap.base.extras import install_command

MIN_STEP_M: Final = 2.0
"""Minimum step of the lattice, m: a vehicle does not follow finer ground."""
MAX_STEP_M: Final = 100.0
"""Maximum step of an elevation model, m: a coarser one misses the ground between its heights."""
AROUND_M: Final = 40.0
"""Width of the ground outside of the fence that is sampled, m: pictures show it, gusts reach it."""
STEEPEST: Final = 4.0
MIN_JUMP_M: Final = 8.0
"""Minimum rise between two heights that counts as a mistake in the file if it is steep, m."""
_HIGHEST_M: Final = 9000.0
_LOWEST_M: Final = -500.0
_ELSEWHERE: Final = "no height at start.position; use a model that covers it"
LEVEL: Final = {
    "west_m": 0.0, "south_m": 0.0, "step_m": 1.0, "columns": 2, "rows": 2,
    "heights": encoded(np.zeros((2, 2))),
}  # fmt: skip
"""The lattice of a mission before its ground is read."""


@dataclass(frozen=True, slots=True)
class FenceLattice:
    """Points over the fence of a mission and around it."""

    grid: Grid
    fence: Polygon
    west_m: float
    south_m: float
    step_m: float
    columns: int
    rows: int

    @classmethod
    def around(cls, mission: Mission, fine_m: float, most: float) -> FenceLattice:
        """Return points `fine_m` apart; farther apart if they would be more than `most`."""
        grid = Grid.at(mission.home, mission.grid.cell_m)
        fence = drawn(mission.fence.polygon, grid)
        west, south, east, north = fence.buffer(AROUND_M).bounds
        width_m, depth_m = east - west, north - south
        step_m = max(fine_m, math.sqrt(width_m * depth_m / most))
        step_m = math.ceil(step_m * 10.0 - 1e-6) / 10.0
        columns, rows = math.ceil(width_m / step_m) + 1, math.ceil(depth_m / step_m) + 1
        return cls(grid, fence, round(west, 2), round(south, 2), step_m, columns, rows)

    @property
    def points(self) -> tuple[Floats, Floats]:
        """East and north of every point, (rows, columns)."""
        east = self.west_m + self.step_m * np.arange(self.columns)
        north = self.south_m + self.step_m * np.arange(self.rows)
        across, along = np.meshgrid(east, north)
        return across, along

    def utm(self) -> tuple[Floats, Floats]:
        """Return the points, and after them the start, in the grid's UTM zone."""
        grid, (east, north) = self.grid, self.points
        return (
            np.append(grid.origin.east_m + east.ravel() * grid.scale, grid.origin.east_m),
            np.append(grid.origin.north_m + north.ravel() * grid.scale, grid.origin.north_m),
        )

    def at(self, row: int, column: int) -> LatLon:
        """Return the position of a point."""
        east_m, north_m = self.west_m + column * self.step_m, self.south_m + row * self.step_m
        return self.grid.position(GridPoint(east_m, north_m))

    def place(self, index: Sequence[int]) -> str:
        """Write the position of a point in degrees, for messages."""
        place = self.at(index[0], index[1])
        return f"{place.lat_deg:.6f}, {place.lon_deg:.6f}"

    def table(self, heights_m: Floats) -> dict[str, Any]:
        """Return the ground of a mission from the height of each point above the start."""
        return {
            "west_m": self.west_m, "south_m": self.south_m, "step_m": self.step_m,
            "columns": self.columns, "rows": self.rows, "heights": encoded(heights_m),
        }  # fmt: skip


def with_ground(mission: Mission, path: Path, where: str) -> Mission:
    """Return the mission with the ground of a GeoTIFF, in and around its fence.

    A mission with misplaced positions is returned unchanged: its check reports them. Raises
    `MissionFileError`, which begins with `where`: the mission file, the key and the value.
    """
    if any(positions_near(mission)):
        return mission
    return with_lattice(mission, _table(path, mission, where))


def with_lattice(mission: Mission, table: Mapping[str, Any]) -> Mission:
    """Return the mission with these heights for its ground."""
    section = TerrainSection(dem=Lattice.model_validate(table))
    return mission.model_copy(update={"terrain": section})


def _table(path: Path, mission: Mission, where: str) -> dict[str, Any]:
    with open_model(path, where) as model:
        metres, fine_m = metres_a_unit(model, where), spacing_m(model, mission.home)
        if not math.isfinite(fine_m):
            raise MissionFileError(f"{where}: {_ELSEWHERE}")
        lattice = FenceLattice.around(mission, max(fine_m, MIN_STEP_M), MAX_POINTS / 1.1)
        if lattice.step_m > MAX_STEP_M:
            raise MissionFileError(
                f"{where}: its heights, or as many as fit a fence of this size, are "
                f"{lattice.step_m:.0f} m apart, more than {MAX_STEP_M:g} m; use a finer model, or "
                "a smaller fence"
            )
        step = max(1, math.floor(lattice.step_m / fine_m + 0.1))
        heights = metres * heights_at(model, lattice.grid.zone.epsg, lattice.utm(), step, where)
    start_m, ground = heights[-1], heights[:-1].reshape(lattice.rows, lattice.columns)
    _refuse_gaps(ground, lattice, where)
    if not math.isfinite(start_m):
        raise MissionFileError(f"{where}: {_ELSEWHERE}")
    _refuse_jumps(ground - start_m, lattice, where)
    return lattice.table(_filled(ground) - start_m)


# --- what cannot be ground ----------------------------------------------------------------------
def _refuse_gaps(ground: Floats, lattice: FenceLattice, where: str) -> None:
    east, north = lattice.points
    # an autopilot that returns crosses the ground between two arms of the fence
    near = lattice.fence.convex_hull.buffer(lattice.step_m)
    shapely.prepare(near)
    inside = shapely.contains_xy(near, east, north)
    missing = inside & ~np.isfinite(ground)
    if missing.any():
        share = missing.sum() / inside.sum()
        raise MissionFileError(
            f"{where}: it has no height in {share:.1%} of fence.polygon, for example at "
            f"{lattice.place(np.argwhere(missing)[0])}; use a model that covers the fence "
            "without gaps, or draw the fence smaller"
        )
    wrong = np.isfinite(ground) & ((ground > _HIGHEST_M) | (ground < _LOWEST_M))
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0])
        raise MissionFileError(
            f"{where}: a height of {ground[at]:.0f} m at {lattice.place(at)}: not possible on "
            "Earth; check that heights are in metres, and that the file's no-data value is set"
        )


def _refuse_jumps(ground: Floats, lattice: FenceLattice, where: str) -> None:
    """Raise `MissionFileError` for an implausible rise: a gap that was set to 0, or a spike."""
    most_m = max(MIN_JUMP_M, STEEPEST * lattice.step_m)
    for axis in (0, 1):
        jumps = np.abs(np.diff(ground, axis=axis))
        jumps = np.where(np.isfinite(jumps), jumps, 0.0)
        if jumps.max() > most_m:
            at = tuple(map(int, np.unravel_index(int(jumps.argmax()), jumps.shape)))
            after = (at[0] + (axis == 0), at[1] + (axis == 1))
            raise MissionFileError(
                f"{where}: {ground[at]:.1f} m and {ground[after]:.1f} m above the start lie only "
                f"{lattice.step_m:g} m apart at {lattice.place(at)}: an implausible slope; check "
                "the file for spikes, or gaps that were filled with 0"
            )


def _filled(ground: Floats) -> Floats:
    """Return the ground with each missing height, outside of the fence, from the nearest known."""
    missing = ~np.isfinite(ground)
    if not missing.any():
        return ground
    filled = ground.copy()
    for lines in (filled, filled.T):  # along rows, then along columns
        for line in lines:
            known = np.flatnonzero(np.isfinite(line))
            if len(known):
                every = np.arange(len(line))
                right = np.clip(np.searchsorted(known, every), 0, len(known) - 1)
                left = np.clip(right - 1, 0, None)
                nearer = every - known[left] <= known[right] - every
                line[:] = line[np.where(nearer, known[left], known[right])]
    return filled


# --- the GeoTIFF ----------------------------------------------------------------------------------
_FOOT_M: Final = 0.3048
_SURVEY_FOOT_M: Final = 1200.0 / 3937.0
_METRES: Final = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot", "international feet"), _FOOT_M),
    **dict.fromkeys(("us-ft", "us_ft", "ftus", "us survey foot", "us survey feet"), _SURVEY_FOOT_M),
}
"""Metres in each unit that a band may name."""
_WGS84: Final = pyproj.CRS.from_epsg(4326)

Floats = NDArray[np.float64]


@contextlib.contextmanager
def open_model(path: Path, where: str) -> Iterator[Any]:
    """Open an elevation model. Raises `MissionFileError` for any other file."""
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
                        f"{where}: it names no coordinate system; write it into the file "
                        "(gdal_edit.py -a_srs EPSG:...)"
                    )
                if model.count != 1:
                    raise MissionFileError(
                        f"{where}: it has {model.count} bands; a model has one band of heights; "
                        "check that it is not a picture"
                    )
                if not (_crs(model).is_geographic or _crs(model).is_projected):
                    raise MissionFileError(
                        f"{where}: its coordinate system, {_crs(model).name!r}, has no place on "
                        "Earth; write the right one into the file (gdal_edit.py -a_srs EPSG:...)"
                    )
                yield model
    except RasterioError as error:
        raise MissionFileError(f"{where}: cannot be read as a GeoTIFF ({error})") from None


def _crs(model: Any) -> pyproj.CRS:
    return pyproj.CRS.from_user_input(model.crs.to_wkt())


def metres_a_unit(model: Any, where: str) -> float:
    """Return the metres in a unit of the heights: by the band, by the vertical system, or 1."""
    unit = model.units[0]
    if unit:
        if unit.casefold() not in _METRES:
            raise MissionFileError(
                f"{where}: its heights are in {unit!r}, an unknown unit; convert them to metres"
            )
        return _METRES[unit.casefold()]
    vertical = [axis for axis in _crs(model).axis_info if axis.direction in ("up", "down")]
    if any(axis.direction == "down" for axis in vertical):
        raise MissionFileError(f"{where}: it holds depths; use a model of heights")
    return vertical[0].unit_conversion_factor if vertical else 1.0


def spacing_m(model: Any, start: LatLon) -> float:
    """Return the distance of two heights near the start, m; infinite if the start is outside."""
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
    a, b, c, d, e, f = tuple(model.transform)[:6]
    places = np.array([[a, b, c], [d, e, f], [0.0, 0.0, 1.0]])
    return np.linalg.inv(places)[:2], places[:2]


def heights_at(
    model: Any, epsg: int, places: tuple[Floats, Floats], step: int, where: str
) -> Floats:
    """Return the model's heights at places in a system, east and north; NaN where it has none.

    They are interpolated between means of `step` x `step` pixels: a model with pixels of
    centimetres shows stones, and does not fit into memory.
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
    found[known] = Terrain(0.0, 0.0, 1.0, band).at(across.at(columns[known]), along.at(rows[known]))
    return found


@dataclass(frozen=True, slots=True)
class _Stretch:
    """The columns, or rows, of a model that are read: `count` means from `first` up to `end`."""

    first: int
    end: int
    count: int

    @classmethod
    def around(cls, edges: Floats, step: int, size: int) -> _Stretch:
        """Return the stretch around these coordinates, with a mean of each `step` pixels."""
        first = max(math.floor(edges.min()) - step, 0)
        end = min(math.ceil(edges.max()) + step, size)
        return cls(first, end, math.ceil((end - first) / step))

    def at(self, edges: Floats) -> Floats:
        """Return coordinates in steps of the means, from the middle of the first one."""
        each = (self.end - self.first) / self.count
        return (edges - self.first) / each - 0.5


def _means(model: Any, along: _Stretch, across: _Stretch) -> Floats:
    """Read the heights in two stretches of rows and columns; NaN where there is none."""
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
