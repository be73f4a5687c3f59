"""The facts of a flight, or of recorded pictures, for its report and files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.errors import ShapelyError
from shapely.geometry import MultiPolygon, Polygon

from missions.flight.state import Setting
from missions.mission.views import rim_share
from uavmap.base.text_files import read_text
from uavmap.base.version import __version__
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output.facts.cell_outlines import NEIGHBOURS, open_sides, packed
from uavmap.output.facts.class_areas import class_figures
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.map_model import MapData, on_ground

DERIVED: Final = "derived from the pictures"
"""Source of a mission that a replay derives: its box and fence are not shown."""
TAKEN: Final = "taken"
"""Key of the time and the clock of a replay's first picture, in the journal's meta."""
_1970: Final = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Calendar:
    """The dates of mission seconds.

    Attributes:
        zero_s: Seconds since 1970 at mission time 0; None if unknown.
        rate: Seconds of the calendar in a mission second.
        clock: `utc`; `camera`: a clock without a zone; `simulated`: UTC of a simulated world,
            which begins on 2020-01-01 in each flight.
    """

    zero_s: float | None
    rate: float = 1.0
    clock: Literal["utc", "camera", "simulated"] = "utc"

    @classmethod
    def of_flight(cls, plan: FlightPlan) -> Calendar:
        """Create the calendar of a flight."""
        if plan.simulated:
            return cls(plan.epoch_utc_s, clock="simulated")
        return cls(plan.epoch_utc_s, 1.0 / (plan.speedup or 1.0))

    @classmethod
    def of_replay(cls, taken: object) -> Calendar:
        """Create the calendar of recorded pictures, from the meta of their journal."""
        first_s = taken.get("first_s") if isinstance(taken, Mapping) else None
        if not isinstance(taken, Mapping) or not isinstance(first_s, int | float):
            return cls(None)
        return cls(float(first_s), clock="utc" if taken.get("clock") == "utc" else "camera")

    def utc(self, t_s: float) -> str | None:
        """Write UTC to a millisecond, in the form of ISO 8601 and GeoPackage; None if unknown.

        >>> Calendar(1577836800.0).utc(61.5)
        '2020-01-01T00:01:01.500Z'
        >>> Calendar(0.0, clock="camera").utc(1.0) is None
        True
        """
        date = None if self.clock == "camera" else self.date(t_s)
        return None if date is None else f"{date:%Y-%m-%dT%H:%M:%S}.{date.microsecond // 1000:03}Z"

    def in_words(self, t_s: float) -> str:
        """Write a date to a second, for readers.

        >>> Calendar(0.0, clock="camera").in_words(3600.0), Calendar(None).in_words(1.0)
        ("1970-01-01 01:00:00 by the camera's clock", 'not known')
        """
        date = self.date(t_s)
        if date is None:
            return "not known"
        zone = {"utc": " UTC", "camera": " by the camera's clock", "simulated": " UTC, simulated"}
        return f"{date:%Y-%m-%d %H:%M:%S}{zone[self.clock]}"

    def date(self, t_s: float) -> datetime | None:
        """Return the date; the zone of a camera's clock has no meaning."""
        if self.zero_s is None:
            return None
        try:
            return _1970 + timedelta(milliseconds=round(1e3 * (self.zero_s + t_s * self.rate)))
        except (OverflowError, ValueError):  # a journal may hold any number
            return None


def taken_meta(first_s: float | None, clock: str) -> dict[str, Any]:
    """Create the meta of a replay's journal from the time of its first picture."""
    return {TAKEN: {"first_s": first_s, "clock": clock}}


# --- the size of the region -----------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class Extent:
    """A region in numbers: square metres and metres on the ground.

    A cell belongs to the region if at least `detector.share` of it looks like region. An error of
    the pose may hide a part of that share (`rim_share`). So a cell of the region along the outline
    counts from the lesser share to 1. A judged cell beside it counts from 0 to `detector.share`,
    and a cell without a verdict from 0 to 1.

    Attributes:
        low_m2: Minimum area of region in its cells.
        high_m2: Maximum area of region, with that in the cells beside.
        outline: Outline of its cells, in the moving frame; may be empty.
        perimeter_m: Length along the sides of cells, holes included; a smooth outline is shorter,
            by at most the root of 2.
        parts: Number of parts; cells that share only a corner are of different parts.
        open_cells: Number of its cells beside a cell without a verdict: it may go on there.
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
        """Perimeter of a smooth outline that is diagonal everywhere."""
        return self.perimeter_m / math.sqrt(2.0)

    def figures(self) -> dict[str, Any]:
        """Return the figures for the summary."""
        return {
            "area_m2": round(self.area_m2, 1),
            "area_low_m2": round(self.low_m2, 1),
            "area_high_m2": round(self.high_m2, 1),
            "perimeter_m": round(self.perimeter_m, 1),
        }


def extent(data: MapData, least: float, most: float) -> Extent:
    """Measure a map's region.

    Cells with a share of at least `least` may belong to it, those with `most` do.
    """
    table = data.cells
    roi = table.cells[table.roi]
    rim, beside, beyond, open_cells = _around(roi, table.cells[table.in_state("non-roi")])
    cell_m2 = data.grid.cell_m**2
    shape = data.outline
    parts = [] if shape.is_empty else list(getattr(shape, "geoms", [shape]))
    return Extent(
        len(roi) * cell_m2,
        (len(roi) - (1.0 - least) * rim) * cell_m2,
        (len(roi) + most * beside + beyond) * cell_m2,
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
    near, known = packed((roi[:, None] + NEIGHBOURS).reshape(-1, 2)), packed(judged)
    outer = open_sides(roi).ravel()
    unjudged = outer & ~np.isin(near, known)
    rim, open_cells = (int(side.reshape(-1, 4).any(axis=1).sum()) for side in (outer, unjudged))
    outside, beyond = (len(np.unique(near[side])) for side in (outer, unjudged))
    return rim, outside - beyond, beyond, open_cells


# --- the boundary at pixel level ------------------------------------------------------------------
BOUNDARY_FILE: Final = "boundary.geojson"
_MAX_BYTES: Final = 50_000_000
_SAME_S: Final = 0.01


@dataclass(frozen=True, slots=True)
class BoundaryFacts:
    """The boundary at pixel level, in the fixed frame, m on the ground.

    Attributes:
        low_m2: Area with P of at least 0.9.
        high_m2: Area with P of at least 0.1.
        length_m: Length of all its lines.
        uncertainty_m: Uncertainty that half of it does not exceed: half the distance from P = 0.1
            to P = 0.9; None if P reaches 0.9 nowhere.
        open_m: Length along the end of the pictures.
        position_m: Standard deviation of a picture's place.
    """

    region: Polygon | MultiPolygon
    area_m2: float
    low_m2: float
    high_m2: float
    length_m: float
    uncertainty_m: float | None
    open_m: float
    position_m: float


def read_boundary(folder: Path, data: MapData) -> BoundaryFacts | None:
    """Read the boundary in a folder of results; None without one, or if it is old or edited."""
    try:
        values = json.loads(read_text(folder / BOUNDARY_FILE, _MAX_BYTES))
        if abs(float(values["t_s"]) - data.t_s) > _SAME_S:
            return None
        return _boundary_of(values["features"], data)
    except (OSError, ValueError, TypeError, KeyError, RecursionError, ShapelyError):
        return None


def _boundary_of(found: Iterable[Mapping[str, Any]], data: MapData) -> BoundaryFacts | None:
    """Read the features; None if a geometry is not a boundary. Any other fault raises."""
    features = {str(one["id"]): one for one in found}
    feature = features["boundary"]
    values = feature["properties"]
    region: Polygon | MultiPolygon = Polygon()
    if feature["geometry"] is not None:
        shape = shapely.from_geojson(json.dumps(feature["geometry"]))
        if not isinstance(shape, Polygon | MultiPolygon):
            return None
        region = shapely.transform(shape, lambda at: on_ground(at, data.grid))
    uncertainty = values["uncertainty_m"]
    lines = (one for name, one in features.items() if name.startswith("line "))
    numbers = [
        float(values["area_m2"]), float(values["area_low_m2"]), float(values["area_high_m2"]),
        float(sum(line["properties"]["length_m"] for line in lines)),
        0.0 if uncertainty is None else float(uncertainty), float(values["open_m"]),
        float(values["position_m"]),
    ]  # fmt: skip
    if not np.isfinite(numbers).all() or not np.isfinite(shapely.get_coordinates(region)).all():
        return None
    facts = BoundaryFacts(region, *numbers)
    return replace(facts, uncertainty_m=None) if uncertainty is None else facts


# --- a flight with its results --------------------------------------------------------------------
@dataclass(frozen=True)
class FlownMission:
    """A flight with its results, or a replay of recorded pictures; `values` is its summary.json."""

    folder: Path
    plan: FlightPlan
    setting: Setting
    data: MapData
    values: Mapping[str, Any]
    log: FlightLog
    calendar: Calendar
    recorded: bool = False

    @property
    def completed(self) -> bool:
        """Return whether the mission is complete."""
        return bool(self.values.get("completed"))

    @property
    def ending(self) -> str:
        """Its end in words."""
        if self.recorded:
            few = not (self.completed or self.values.get("flown_to_the_end"))
            return "Too few pictures" if few else "Pictures"
        if self.values.get("no_verdict"):
            return "No verdict"
        return "Complete" if self.completed else "Not complete"

    @property
    def simulated(self) -> bool:
        """Return whether it was flown in a simulated world."""
        return self.plan.simulated and not self.recorded

    @cached_property
    def extent(self) -> Extent:
        """The size of the region."""
        return extent(self.data, self.least_share, self.setting.mission.detector.share)

    @property
    def least_share(self) -> float:
        """Minimum share with which a cell may belong to the region."""
        mission = self.setting.mission
        return mission.detector.share if self.recorded else rim_share(mission)

    @cached_property
    def boundary(self) -> BoundaryFacts | None:
        """The boundary at pixel level, if the folder holds one of this map."""
        return read_boundary(self.folder, self.data)

    @property
    def crs(self) -> str:
        """The coordinate reference system of maps in metres; others are in WGS84, EPSG:4326."""
        return f"EPSG:{self.data.grid.zone.epsg}"


def dated(flown: FlownMission) -> FlownMission:
    """Add the extent of the region, dates, coordinates and version to the summary."""
    values = {
        **flown.values,
        **flown.extent.figures(),
        **class_figures(flown.data.class_areas),
        "begun_utc": flown.calendar.utc(0.0),
        "ended_utc": flown.calendar.utc(flown.data.t_s),
        "crs": flown.crs,
        "version": __version__,
    }
    return replace(flown, values=values)
