"""The size of a region by its cells, with bounds.

A cell belongs to the region where at least `detector.share` of it looks like region. So along the
outline a cell of the region counts from that share on to all of it, a judged one beside it from
nothing to that share, and one without a verdict may be region whole. The outline runs along the
sides of cells: a smooth line through them is shorter, by a factor of 1 to the root of 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon

from uavmap.output.facts.map_model import MapData, packed

_NEIGHBOURS: Final = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]], np.int32)


@dataclass(frozen=True, slots=True)
class Extent:
    """A region in numbers: square metres and metres on the ground.

    Attributes:
        area_m2: Of all its cells.
        low_m2: Minimum of region in them.
        high_m2: Maximum of region, with that in the cells beside.
        outline: Around its cells, in the moving frame; may be empty.
        perimeter_m: Of the outline, holes included.
        parts: Cells that share only a corner are of different parts.
        open_cells: Cells of the region beside a cell without a verdict: it may go on there.
    """

    area_m2: float
    low_m2: float
    high_m2: float
    outline: Polygon | MultiPolygon
    perimeter_m: float
    parts: int
    holes: int
    open_cells: int

    @property
    def shortest_m(self) -> float:
        """The perimeter of a smooth outline that runs diagonally all along."""
        return self.perimeter_m / math.sqrt(2.0)

    def figures(self) -> dict[str, Any]:
        """Return the figures for the summary."""
        return {
            "area_m2": round(self.area_m2, 1),
            "area_low_m2": round(self.low_m2, 1),
            "area_high_m2": round(self.high_m2, 1),
            "perimeter_m": round(self.perimeter_m, 1),
        }


def extent(data: MapData, share: float) -> Extent:
    """Measure a map's region; a cell belongs to it from `share` on."""
    table = data.cells
    roi = table.cells[table.roi]
    rim, beside, beyond, open_cells = _around(roi, table.cells[table.are("non-roi")])
    cell_m2 = data.grid.cell_m**2
    shape = data.outline
    parts = [] if shape.is_empty else list(getattr(shape, "geoms", [shape]))
    return Extent(
        len(roi) * cell_m2,
        (len(roi) - (1.0 - share) * rim) * cell_m2,
        (len(roi) + share * beside + beyond) * cell_m2,
        shape,
        float(shape.length),
        len(parts),
        sum(len(part.interiors) for part in parts),
        open_cells,
    )


def _around(roi: NDArray[np.int32], judged: NDArray[np.int32]) -> tuple[int, int, int, int]:
    """Count rim cells of the region, judged and unjudged cells beside them, and open cells.

    >>> _around(np.array([[0, 0]], np.int32), np.array([[1, 0], [0, 1], [0, -1], [5, 5]], np.int32))
    (1, 3, 1, 1)
    """
    inside, known = packed(roi), packed(judged)
    near = packed((roi[:, None] + _NEIGHBOURS).reshape(-1, 2))
    outer = ~np.isin(near, inside)
    unjudged = outer & ~np.isin(near, known)
    rim, open_cells = (int(side.reshape(-1, 4).any(axis=1).sum()) for side in (outer, unjudged))
    outside, beyond = (len(np.unique(near[side])) for side in (outer, unjudged))
    return rim, outside - beyond, beyond, open_cells
