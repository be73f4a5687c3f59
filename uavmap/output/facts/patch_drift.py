"""The drift of each patch of a region, measured by the frames that show it.

Cells move with the drift of the mission file. A patch with another drift moves through the cells:
its outline at the time of the map differs from the outline at first sight. Each vote has the share
of a cell that looked like region, so an outline is known to a small part of a cell.

The method uses cells in and around a patch that frames show over at least `MIN_SPAN_S`. Each has a
mean share in the first `WINDOW_S` after its first frame, and one in the last `WINDOW_S`. If the
patch moves by (u, v) m/s, the last share at x equals the first one at x - (u, v) dt. The measured
drift is the (u, v) with the least squares of differences, by bilinear interpolation between cells.
A patch that looks wider or narrower on all sides does not shift.

The error is that of a jackknife over sectors of the outline, plus 1 m for the vehicles' position.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.events import FrameSeen
from missions.geo.grid import Grid
from missions.units import Cell
from uavmap.output.summary import MAX_PATCHES

MIN_SPAN_S: Final = 30.0
"""Minimum time between the first and the last frame of a cell that counts, s."""
WINDOW_S: Final = 5.0
"""Time after the first and before the last frame in which votes are averaged, s."""
REACH_CELLS: Final = 5.0
"""Maximum move of a patch through its cells; beyond it, its map is wrong and it is not measured."""
MIN_CELLS: Final = 12
"""Minimum number of cells of the outline that were observed twice."""
PART: Final = (0.05, 0.95)
"""Range of a share that puts a cell on the outline."""
SECTORS: Final = 8
POSITION_M: Final = 1.0
"""Change of a vehicle's position error within minutes, m."""
_LEVELS: Final = ((0.5, 10), (0.125, 4), (1.0 / 32.0, 4))
"""Steps of the search in cells of the median time, and their number to each side."""
_MAX_ERROR: Final = 0.5
"""Maximum difference of shares that counts."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Drift:
    """The drift of a patch over ground, along the axes of the grid, m/s."""

    east_m_s: float
    north_m_s: float
    error_m_s: float
    """The standard error."""
    off_m_s: float
    """Difference from the drift of the mission file, m/s."""

    @property
    def differs(self) -> bool:
        """Return whether it surely differs from the drift of the mission file."""
        return self.off_m_s > 3.0 * self.error_m_s

    def figures(self, grid: Grid) -> dict[str, float | bool]:
        """Return the drift for the summary, with a true bearing."""
        bearing = math.degrees(math.atan2(self.east_m_s, self.north_m_s) + grid.convergence_rad)
        return {
            "speed_m_s": round(math.hypot(self.east_m_s, self.north_m_s), 3),
            "toward_deg": round(bearing % 360.0, 1),
            "error_m_s": round(self.error_m_s, 3),
            "off_m_s": round(self.off_m_s, 3),
            "differs": self.differs,
        }


class _Sightings(NamedTuple):
    """Times and shares of cells, first and last; all of shape (N,)."""

    east: NDArray[np.int64]
    north: NDArray[np.int64]
    begin_s: Floats
    begin_share: Floats
    end_s: Floats
    end_share: Floats


class Shares:
    """All votes of a flight: the share of a cell that looked like region, and its time."""

    def __init__(self) -> None:
        self._cells = array("q")
        self._times_s = array("d")
        self._shares = array("d")

    def note(self, event: FrameSeen) -> None:
        """Note the votes of a frame."""
        for cell, _, share in event.votes:
            self._cells.append(cell.east)
            self._cells.append(cell.north)
            self._times_s.append(event.t_s)
            self._shares.append(share)

    def drifts_of(self, patches: Sequence[Collection[Cell]], grid: Grid) -> list[Drift | None]:
        """Measure the drift of each patch, the largest first; None if it cannot be measured.

        A drift cannot be measured if frames show too little of the outline twice, or if it moved by
        more than `REACH_CELLS`. Patches after `MAX_PATCHES` are not measured.
        """
        if not len(self._times_s):
            return [None] * len(patches)
        seen = self._seen()
        found = [_measured(_around(patch, seen), grid) for patch in patches[:MAX_PATCHES]]
        return [*found, *[None] * (len(patches) - len(found))]

    def _seen(self) -> _Sightings:
        """Return the votes by cell, in an order that does not depend on that of the frames."""
        cells = np.array(self._cells, np.int64).reshape(-1, 2)
        times_s, shares = np.array(self._times_s), np.array(self._shares)
        order = np.lexsort((shares, times_s, cells[:, 1], cells[:, 0]))
        cells, times_s, shares = cells[order], times_s[order], shares[order]
        new = np.ones(len(order), np.bool_)
        new[1:] = (cells[1:] != cells[:-1]).any(axis=1)
        starts = np.flatnonzero(new)
        which = np.cumsum(new) - 1
        first_s = times_s[starts]
        last_s = times_s[np.append(starts[1:], len(order)) - 1]

        def mean(chosen: NDArray[np.bool_], values: Floats) -> Floats:
            sums: Floats = np.add.reduceat(np.where(chosen, values, 0.0), starts)
            return sums / np.add.reduceat(chosen.astype(np.float64), starts)

        early = times_s <= first_s[which] + WINDOW_S
        late = times_s >= last_s[which] - WINDOW_S
        return _Sightings(
            cells[starts, 0], cells[starts, 1], mean(early, times_s), mean(early, shares),
            mean(late, times_s), mean(late, shares),
        )  # fmt: skip


def _around(patch: Collection[Cell], seen: _Sightings) -> _Sightings:
    """Return the cells of a patch and around it, as far as it may have moved."""
    own = np.array(sorted(patch), dtype=np.int64)
    margin = math.ceil(REACH_CELLS) + 1
    low = own.min(axis=0) - margin
    wide, deep = (own.max(axis=0) + margin - low + 1).tolist()
    near = np.zeros((wide, deep), np.uint8)
    near[tuple((own - low).T)] = 1
    near = cv2.dilate(near, np.ones((2 * margin + 1, 2 * margin + 1), np.uint8))
    column, row = seen.east - low[0], seen.north - low[1]
    inside = (column >= 0) & (row >= 0) & (column < wide) & (row < deep)
    inside[inside] = near[column[inside], row[inside]]
    return _Sightings(column[inside], row[inside], *(values[inside] for values in seen[2:]))


def _is_part(share: Floats) -> NDArray[np.bool_]:
    return (share > PART[0]) & (share < PART[1])


class _Registration:
    """The first shares of cells against their last shares."""

    def __init__(self, seen: _Sightings, long: NDArray[np.bool_], cell_m: float) -> None:
        shape = int(seen.east.max()) + 2, int(seen.north.max()) + 2
        self._first: Floats = np.full(shape, np.nan)
        self._first[seen.east, seen.north] = seen.begin_share
        self._at = seen.east[long].astype(np.float64), seen.north[long].astype(np.float64)
        self._share = seen.end_share[long]
        self.dt_s = (seen.end_s - seen.begin_s)[long]
        self._cell_m = cell_m
        middle = self._at[0].mean(), self._at[1].mean()
        turn = np.arctan2(self._at[1] - middle[1], self._at[0] - middle[0])
        self.sector = ((turn + np.pi) / (2.0 * np.pi) * SECTORS).astype(np.int64) % SECTORS

    def squares(self, east_m_s: float, north_m_s: float) -> Floats:
        """Return the square of each cell's difference; NaN without one."""
        shape = self._first.shape
        x = self._at[0] - east_m_s * self.dt_s / self._cell_m
        y = self._at[1] - north_m_s * self.dt_s / self._cell_m
        inside = (x >= 0.0) & (y >= 0.0) & (x < shape[0] - 1.0) & (y < shape[1] - 1.0)
        i = np.where(inside, x, 0.0).astype(np.int64)
        j = np.where(inside, y, 0.0).astype(np.int64)
        f, g = np.where(inside, x - i, 0.0), np.where(inside, y - j, 0.0)
        first = self._first
        was = (1.0 - f) * ((1.0 - g) * first[i, j] + g * first[i, j + 1])
        was += f * ((1.0 - g) * first[i + 1, j] + g * first[i + 1, j + 1])
        off: Floats = np.minimum(np.abs(self._share - np.where(inside, was, np.nan)), _MAX_ERROR)
        return off**2


def _measured(seen: _Sightings, grid: Grid) -> Drift | None:
    long = seen.end_s - seen.begin_s >= MIN_SPAN_S
    outline = long & (_is_part(seen.begin_share) | _is_part(seen.end_share))
    if np.count_nonzero(outline) < MIN_CELLS:
        return None
    made = _Registration(seen, long, grid.cell_m)
    unit_m_s = grid.cell_m / float(np.median(made.dt_s))
    least = max(MIN_CELLS, len(made.dt_s) // 3)
    # each part leaves one sector out; the last part has all sectors
    parts = [made.sector != k for k in range(SECTORS)] + [np.ones(len(made.dt_s), np.bool_)]
    (step, half), *finer = _LEVELS  # the first level uses all cells and gives each part its start
    best = np.zeros((len(parts), 2))
    best[:] = _least(made, parts[-1], best[-1], step * unit_m_s, half, least)
    for step, half in finer:
        for which, kept in enumerate(parts):
            best[which] = _least(made, kept, best[which], step * unit_m_s, half, least)
    reached_m_s = (REACH_CELLS - 0.25) * unit_m_s
    if not np.isfinite(best).all() or np.abs(best[-1]).max() >= reached_m_s:
        return None
    spread = best[:-1] - best[:-1].mean(axis=0)
    jackknife = float(((SECTORS - 1) / SECTORS * (spread**2).sum(axis=0)).sum())
    step_m_s = _LEVELS[-1][0] * unit_m_s
    error_m_s = math.sqrt(jackknife + step_m_s**2 + (POSITION_M / float(np.median(made.dt_s))) ** 2)
    east_m_s, north_m_s = best[-1].tolist()
    return Drift(
        grid.drift_east_m_s + east_m_s,
        grid.drift_north_m_s + north_m_s,
        error_m_s,
        math.hypot(east_m_s, north_m_s),
    )


def _least(
    made: _Registration,
    kept: NDArray[np.bool_],
    around_m_s: Floats,
    step_m_s: float,
    half: int,
    least: int,
) -> tuple[float, float]:
    """Return the drift of least mean square in a lattice around one; NaN without one."""
    found = (math.inf, math.nan, math.nan)
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            east_m_s, north_m_s = around_m_s[0] + i * step_m_s, around_m_s[1] + j * step_m_s
            squares = made.squares(east_m_s, north_m_s)[kept]
            known = squares[np.isfinite(squares)]
            if len(known) >= least:
                found = min(found, (float(known.mean()), float(east_m_s), float(north_m_s)))
    return found[1], found[2]
