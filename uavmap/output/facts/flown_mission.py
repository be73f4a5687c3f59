"""All that is known of a flight, or of recorded pictures, for whoever writes it down."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from missions.flight.setting import Setting
from uavmap.base.version import __version__
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output.facts.boundary_summary import BoundaryTold, read_boundary
from uavmap.output.facts.calendar import Calendar
from uavmap.output.facts.extent import Extent, extent
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.map_model import MapData


@dataclass(frozen=True, slots=True)
class Flown:
    """What report and files are made of.

    Attributes:
        folder: Of the results.
        plan: What it was started with.
        setting: The mission.
        data: The map.
        values: summary.json.
        log: Its course.
        calendar: When mission seconds were.
        recorded: Whether it is a replay of recorded pictures: nobody has flown.
    """

    folder: Path
    plan: FlightPlan
    setting: Setting
    data: MapData
    values: Mapping[str, Any]
    log: FlightLog
    calendar: Calendar
    recorded: bool = False
    _extent: list[Extent] = field(default_factory=list, init=False, repr=False, compare=False)
    _boundary: list[BoundaryTold | None] = field(
        default_factory=list, init=False, repr=False, compare=False
    )

    def knowing(self, found: Extent, boundary: BoundaryTold | None) -> Flown:
        """The same, told what would be reckoned, and read from the folder, otherwise."""
        self._extent[:], self._boundary[:] = [found], [boundary]
        return self

    @property
    def completed(self) -> bool:
        """Whether the mission is complete."""
        return bool(self.values.get("completed"))

    @property
    def simulated(self) -> bool:
        """Whether the world was a simulated one."""
        return self.plan.simulated and not self.recorded

    @property
    def extent(self) -> Extent:
        """How large the region is; it is asked for often, and reckoned once."""
        if not self._extent:
            share = self.setting.mission.detector.share
            self._extent.append(extent(self.data, share))
        return self._extent[0]

    @property
    def boundary(self) -> BoundaryTold | None:
        """The boundary at pixel level, if the folder holds one of this map; it is read once."""
        if not self._boundary:
            self._boundary.append(read_boundary(self.folder, self.data))
        return self._boundary[0]

    @property
    def crs(self) -> str:
        """The coordinate reference system of the grid.

        It is that of maps in metres; maps in degrees are in WGS84, EPSG:4326.
        """
        return f"EPSG:{self.data.grid.zone.epsg}"


def flown_from(
    folder: Path,
    plan: FlightPlan,
    setting: Setting,
    data: MapData,
    values: Mapping[str, Any],
    log: FlightLog,
) -> Flown:
    """A flight, its figures dated."""
    calendar = Calendar.of_flight(plan)
    found = extent(data, setting.mission.detector.share)
    values = dated(values, data, found, calendar)
    return Flown(folder, plan, setting, data, values, log, calendar)


def dated(
    values: Mapping[str, Any], data: MapData, found: Extent, when: Calendar
) -> dict[str, Any]:
    """A summary with the extent of the region, dates, coordinates and version."""
    return {
        **values,
        **found.figures(),
        "begun_utc": when.utc(0.0),
        "ended_utc": when.utc(data.t_s),
        "crs": f"EPSG:{data.grid.zone.epsg}",
        "version": __version__,
    }
