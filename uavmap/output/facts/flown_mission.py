"""All that the report and the files of a flight, or of recorded pictures, are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from missions.flight.setting import Setting
from uavmap.base.version import __version__
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output.facts.boundary_model import BoundaryTold, read_boundary
from uavmap.output.facts.calendar import Calendar
from uavmap.output.facts.extent import Extent, extent
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.map_model import MapData


@dataclass(frozen=True)
class Flown:
    """A flight with its results, or a replay.

    Attributes:
        folder: Of the results.
        values: summary.json.
        recorded: Whether it is a replay of recorded pictures, without a flight.
    """

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
        """Whether the mission is complete."""
        return bool(self.values.get("completed"))

    @property
    def simulated(self) -> bool:
        """Whether the world was a simulated one."""
        return self.plan.simulated and not self.recorded

    @cached_property
    def extent(self) -> Extent:
        """The size of the region."""
        return extent(self.data, self.setting.mission.detector.share)

    @cached_property
    def boundary(self) -> BoundaryTold | None:
        """The boundary at pixel level, if the folder holds one of this map."""
        return read_boundary(self.folder, self.data)

    @property
    def crs(self) -> str:
        """The coordinate reference system of maps in metres; others are in WGS84, EPSG:4326."""
        return f"EPSG:{self.data.grid.zone.epsg}"


def dated(
    values: Mapping[str, Any], data: MapData, found: Extent, when: Calendar
) -> dict[str, Any]:
    """Add the extent of the region, dates, coordinates and version to a summary."""
    return {
        **values,
        **found.figures(),
        "begun_utc": when.utc(0.0),
        "ended_utc": when.utc(data.t_s),
        "crs": f"EPSG:{data.grid.zone.epsg}",
        "version": __version__,
    }
