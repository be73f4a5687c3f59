"""A small map with every kind of content, for the tests of the writers."""

import tempfile
from pathlib import Path

from shapely.geometry import Polygon, box

from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, LatLon
from uavmap.output.facts.map_model import CellRow, CellTable, MapData, Track

START = LatLon(47.6, 9.53)

# a ring of 5 x 5 cells, one cell that touches it by a corner only, and a rim
RING = [
    Cell(column, row)
    for column in range(5)
    for row in range(5)
    if not (1 < column < 4 and row == 2)
]
LONER = Cell(5, 5)
RIM = [Cell(column, -1) for column in range(5)]


def _state(cell):
    if cell in RIM:
        return "non-roi"
    if cell == LONER:
        return "unexplored"
    return "under exploration" if cell == Cell(4, 4) else "explored"


def make_map(*, start=START, drift_m_s=0.0, toward_deg=90.0, t_s=100.0):
    grid = Grid.at(start, 4.0, drift_m_s, toward_deg)

    def ring(west, south, east, north):
        corners = ((west, south), (east, south), (east, north), (west, north))
        return tuple(grid.position(GridPoint(*corner)) for corner in corners)

    def fix(i):
        return 25.0 * i, grid.position(GridPoint(4.0 * i, 4.0)), 12.0 + i

    return MapData(
        mission="test <map> & more",
        grid=grid,
        t_s=t_s,
        cells=CellTable.from_rows(
            CellRow(cell, _state(cell), positive=0 if cell in RIM else 4, votes=5)
            for cell in [*RING, LONER, *RIM]
        ),
        tracks=(Track(0, tuple(map(fix, range(5)))), Track(1, ((0.0, start, 0.0),))),
        start=start,
        box=ring(-10, -10, 40, 40),
        fence=ring(-30, -30, 60, 60),
        fence_holes=(ring(30, -20, 36, -14),),
        truth=Polygon(box(-1, -1, 19, 19).exterior, [box(7, 6, 14, 10).exterior]),
    )


def empty_map():
    full = make_map()
    return MapData(
        "empty", full.grid, 0.0, CellTable.from_rows(()), (), full.start, full.box, full.fence
    )


def written(write, data, *more):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map"
        write(data, path, *more)
        return path.read_text("utf-8")
