"""The live map on the ground: the content of a board at an instant, as shapes in WGS84."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from missions.geo.grid import Grid
from missions.units import Cell, LatLon
from uavmap.output.facts.cell_outlines import outline
from uavmap.output.facts.map_model import NOT_ROI, CellCorners, placed
from uavmap.output.formats.layers import DECIMALS
from uavmap.ui.page.board import Delta
from uavmap.ui.page.page_pipe import Message
from uavmap.ui.page.page_scene import STATES

_UNSURE = STATES.index("unsure")
_ROI = [code for code, state in enumerate(STATES) if state not in NOT_ROI]


@dataclass(frozen=True, slots=True)
class Aircraft:
    """A vehicle as the board has it: its number, its place in the fixed frame, and its record."""

    number: int
    east_m: float
    north_m: float
    record: Message


@dataclass(frozen=True)
class LiveMap:
    """The content of a board in the moving frame; `on_earth` transforms it to the ground.

    Attributes:
        mission: Name of the mission.
        start: Origin of the grid.
        t_s: Mission time, s.
        cells: Columns and rows, shape (n, 2).
        codes: Codes of the cells' states, or of classes of the region, shape (n,).
        snapshot: The whole board (`Board.since(0)`).
    """

    mission: str
    start: LatLon
    grid: Grid
    t_s: float
    cells: NDArray[np.int32]
    codes: NDArray[np.int32]
    snapshot: Delta

    @classmethod
    def from_board(cls, scene: Message, snapshot: Delta) -> Self:
        """Create the map of a scene (`uavmap.ui.page.page_scene`) and a snapshot."""
        lat_deg, lon_deg, cell_m, drift_m_s, toward_deg = scene["grid"]
        start = LatLon(lat_deg, lon_deg)
        table = np.array(snapshot["cells"], np.int32).reshape(-1, 3)
        return cls(
            scene["mission"],
            start,
            Grid.at(start, cell_m, drift_m_s, toward_deg),
            snapshot["fields"].get("t_s") or 0.0,
            table[:, :2],
            table[:, 2],
            snapshot,
        )

    @cached_property
    def region(self) -> Polygon | MultiPolygon:
        """Outline of the cells of the region."""
        return self._around(np.isin(self.codes, _ROI) | (self.codes >= len(STATES)))

    @cached_property
    def unsure(self) -> Polygon | MultiPolygon:
        """Outline of the unsure cells."""
        return self._around(self.codes == _UNSURE)

    @property
    def corners(self) -> CellCorners:
        """Corners of the cells on the ground."""
        return CellCorners.of_cells(self.cells, self.grid, self.t_s)

    def _around(self, some: NDArray[np.bool_]) -> Polygon | MultiPolygon:
        return outline([Cell(*cell) for cell in self.cells[some].tolist()], self.grid)

    def on_earth(self, shape: BaseGeometry) -> Any:
        """Return a shape in WGS84, longitude first."""
        where = self.grid, self.t_s, self.start, DECIMALS
        return shapely.transform(shape, lambda points: placed(points, *where))

    def aircraft(self) -> Iterator[Aircraft]:
        """Yield the vehicles."""
        east_m, north_m = (speed * self.t_s for speed in self.grid.drift_m_s)
        for number, record in self.snapshot["vehicles"].items():
            yield Aircraft(int(number), record["e"] + east_m, record["n"] + north_m, record)

    def place(self, aircraft: Aircraft) -> Any:
        """Return the place of a vehicle in WGS84."""
        east_m, north_m = (speed * self.t_s for speed in self.grid.drift_m_s)
        return self.on_earth(Point(aircraft.east_m - east_m, aircraft.north_m - north_m))

    def traffic(self) -> Iterator[tuple[Any, Message]]:
        """Yield the aircraft of others: the place of each, in WGS84, and its record."""
        for record in self.snapshot["fields"].get("traffic") or ():
            yield self.on_earth(Point(record["e"], record["n"])), record

    def tracks(self) -> Iterator[tuple[int, LineString]]:
        """Yield the vehicles that have flown, with the line of each."""
        for number, flat in self.snapshot["tracks"].items():
            if len(flat) > 2:
                yield int(number), LineString(np.array(flat).reshape(-1, 2))

    def paths(self) -> Iterator[tuple[int, LineString]]:
        """Yield the vehicles with an order, with the line from each to the end of its path."""
        for number, record in self.snapshot["vehicles"].items():
            flat = self.snapshot["fields"].get(f"path {number}")
            if flat:  # time, east, north, ...
                ahead = np.array(flat).reshape(-1, 3)[:, 1:]
                yield int(number), LineString([(record["e"], record["n"]), *ahead.tolist()])
