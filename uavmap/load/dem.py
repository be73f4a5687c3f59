"""The ground from the GeoTIFF that `terrain.dem` names, as a lattice that a mission holds.

A model may have any coordinate system and any sea level; a flight needs heights relative to its
start. So heights are sampled on a lattice along the mission's grid, and kept with the mission.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely.geometry import Polygon

from missions.errors import MissionFileError
from missions.geo.grid import Grid
from missions.geo.terrain import encoded
from missions.mission.places import positions_near
from missions.mission.schema import Mission
from missions.mission.sections.terrain_section import MOST_POINTS, Lattice, TerrainSection
from missions.units import GridPoint, LatLon
from uavmap.load.elevation_model import Floats, heights_at, metres_a_unit, opened, spacing_m

LEAST_STEP_M: Final = 2.0
"""Between two points of the lattice: what is finer is no ground that a vehicle follows."""
MOST_STEP_M: Final = 100.0
"""Of an elevation model: what is coarser does not know the ground between."""
AROUND_M: Final = 40.0
"""Pictures show, and gusts carry to, ground so far outside of the fence."""
STEEPEST: Final = 4.0
LEAST_JUMP_M: Final = 8.0
"""Ground that rises by more, and steeper, from one height to the next is a mistake in the file."""
_HIGHEST_M: Final = 9000.0
_LOWEST_M: Final = -500.0
_ELSEWHERE: Final = "no height at start.position; take a model that covers it"
LEVEL: Final = {
    "west_m": 0.0, "south_m": 0.0, "step_m": 1.0, "columns": 2, "rows": 2,
    "heights": encoded(np.zeros((2, 2))),
}  # fmt: skip
"""The lattice of a mission until its ground is read."""


@dataclass(frozen=True, slots=True)
class _Lattice:
    grid: Grid
    fence: Polygon
    west_m: float
    south_m: float
    step_m: float
    columns: int
    rows: int

    @classmethod
    def around(cls, mission: Mission, fine_m: float) -> _Lattice:
        """Over the fence of a mission and around it, as fine as the model, and not too large."""
        grid = Grid.at(mission.home, mission.grid.cell_m)
        fence = Polygon([grid.fixed(LatLon(*vertex)) for vertex in mission.fence.polygon])
        west, south, east, north = fence.buffer(AROUND_M).bounds
        width_m, depth_m = east - west, north - south
        step_m = max(fine_m, LEAST_STEP_M, math.sqrt(1.1 * width_m * depth_m / MOST_POINTS))
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
        """The same in the grid's UTM zone, and the start behind them."""
        grid, (east, north) = self.grid, self.points
        return (
            np.append(grid.origin.east_m + east.ravel() * grid.scale, grid.origin.east_m),
            np.append(grid.origin.north_m + north.ravel() * grid.scale, grid.origin.north_m),
        )

    def place(self, index: tuple[int, int]) -> str:
        """Where a point is, in degrees."""
        at = GridPoint(self.west_m + index[1] * self.step_m, self.south_m + index[0] * self.step_m)
        place = self.grid.position(at)
        return f"{place.lat_deg:.6f}, {place.lon_deg:.6f}"


def with_ground(mission: Mission, path: Path, where: str) -> Mission:
    """Return the mission with the ground of a GeoTIFF, in and around its fence.

    A mission with misplaced positions comes back as it is: its check reports them. Raises
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
    with opened(path, where) as model:
        metres, fine_m = metres_a_unit(model, where), spacing_m(model, mission.home)
        if not math.isfinite(fine_m):
            raise MissionFileError(f"{where}: {_ELSEWHERE}")
        lattice = _Lattice.around(mission, fine_m)
        if lattice.step_m > MOST_STEP_M:
            raise MissionFileError(
                f"{where}: its heights, or those that can be kept of a fence so large, lie "
                f"{lattice.step_m:.0f} m apart, more than {MOST_STEP_M:g}; take a finer model, or "
                "a smaller fence"
            )
        step = max(1, math.floor(lattice.step_m / fine_m + 0.1))
        heights = metres * heights_at(model, lattice.grid.zone.epsg, lattice.utm(), step, where)
    start_m, ground = heights[-1], heights[:-1].reshape(lattice.rows, lattice.columns)
    _refuse_gaps(ground, lattice, where)
    if not math.isfinite(start_m):
        raise MissionFileError(f"{where}: {_ELSEWHERE}")
    _refuse_jumps(ground - start_m, lattice, where)
    ground = _filled(ground) - start_m
    return {
        "west_m": lattice.west_m, "south_m": lattice.south_m, "step_m": lattice.step_m,
        "columns": lattice.columns, "rows": lattice.rows, "heights": encoded(ground),
    }  # fmt: skip


# --- what cannot be ground ----------------------------------------------------------------------
def _refuse_gaps(ground: Floats, lattice: _Lattice, where: str) -> None:
    """Raise where a height is missing in the fence, or is not one of this Earth."""
    east, north = lattice.points
    # an autopilot that returns crosses what lies between two arms of the fence
    near = lattice.fence.convex_hull.buffer(lattice.step_m)
    shapely.prepare(near)
    inside = shapely.contains_xy(near, east, north)
    missing = inside & ~np.isfinite(ground)
    if missing.any():
        share = missing.sum() / inside.sum()
        first = np.argwhere(missing)[0]
        raise MissionFileError(
            f"{where}: it has no height in {share:.1%} of fence.polygon, for example at "
            f"{lattice.place((int(first[0]), int(first[1])))}; take a model that covers the fence "
            "without gaps, or draw the fence smaller"
        )
    wrong = np.isfinite(ground) & ((ground > _HIGHEST_M) | (ground < _LOWEST_M))
    if wrong.any():
        first = np.argwhere(wrong)[0]
        at = int(first[0]), int(first[1])
        raise MissionFileError(
            f"{where}: a height of {ground[at]:.0f} m at {lattice.place(at)}: no ground of this "
            "Earth; are these heights in metres, and is the file's value for no data set?"
        )


def _refuse_jumps(ground: Floats, lattice: _Lattice, where: str) -> None:
    """Raise where the ground rises as no ground does: a height that was set to 0, or a spike."""
    most_m = max(LEAST_JUMP_M, STEEPEST * lattice.step_m)
    for axis in (0, 1):
        jumps = np.abs(np.diff(ground, axis=axis))
        jumps = np.where(np.isfinite(jumps), jumps, 0.0)
        if jumps.max() > most_m:
            i, j = np.unravel_index(int(jumps.argmax()), jumps.shape)
            at = int(i), int(j)
            after = (at[0] + 1, at[1]) if axis == 0 else (at[0], at[1] + 1)
            raise MissionFileError(
                f"{where}: {ground[at]:.1f} m and {ground[after]:.1f} m above the start lie only "
                f"{lattice.step_m:g} m apart at {lattice.place(at)}: no ground rises so; mend the "
                "file (a spike, or a gap that was filled with 0?)"
            )


def _filled(ground: Floats) -> Floats:
    """Heights that are missing outside of the fence, taken from the nearest that is known."""
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
