"""What a flight is started with, as it lies in the journal."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Self

from pydantic import TypeAdapter

from missions.errors import JournalError, LinkError, MissionFileError, UavmapError
from missions.flight.setting import Setting
from missions.flight.setting_of import setting_of
from missions.mission.checks import FLOWN, STRATEGIES, check, with_strategy
from missions.mission.fleet_checks import check_fleet, with_own_air, with_vehicles
from missions.mission.schema import Mission
from uavmap.base.version import __version__
from uavmap.journal.event_log import PLAN, JournalReader
from uavmap.journal.flight_options import FlightOptions
from uavmap.load.kept_detector import with_kept_detector
from uavmap.load.planner_setup import ready_planner, tell_if_uncompiled

JOURNAL: Final = "journal.jsonl"
TLOG: Final = "flight.tlog"
REHOMED: Final = "rehomed"
"""In the journal's meta: whether the simulated aircraft were put at home after the start."""
SIM_EPOCH_UTC_S: Final = 1577836800.0
"""Simulated flights begin on 2020-01-01, so that equal flights have equal logs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan(FlightOptions):
    """The options of a flight, and the mission that they make of its file.

    The journal keeps it, so a flight goes on without the files that its mission named.

    Attributes:
        mission: Checked, with the options applied.
        epoch_utc_s: Wall clock at mission time 0.
        version: Of the program that began the flight.
        rehomed: Whether the simulated aircraft were put at home once: the flight cannot repeat.
    """

    mission: Mission
    epoch_utc_s: float
    version: str = __version__
    rehomed: bool = False

    @classmethod
    def make(cls, options: FlightOptions, mission: Mission, epoch_utc_s: float) -> Self:
        """Make the plan of a loaded mission. Raises `MissionFileError`, `LinkError`."""
        given = {field.name: getattr(options, field.name) for field in fields(FlightOptions)}
        loaded = mission
        if options.strategy is not None:
            mission = with_strategy(mission, options.strategy)
        urls = options.urls if options.member is None else ()
        wanted = options.vehicles or len(urls) or len(mission.vehicles)
        if wanted != len(mission.vehicles):
            mission = with_vehicles(mission, wanted)
        plan = cls(**given, mission=mission, epoch_utc_s=epoch_utc_s)
        plan.check_strategy()
        if mission is not loaded:
            plan.check_mission()
        if options.member is not None:
            return plan.as_member(options.member)
        for what, option, count in (
            ("connection URLs", "--connect once a vehicle", len(options.urls)),
            ("cameras", "--camera once a vehicle, in the same order", len(options.cameras)),
        ):
            if count not in (0, len(mission.vehicles)):
                raise MissionFileError(
                    f"{options.mission_source}: {len(mission.vehicles)} vehicles, but {count} "
                    f"{what}; give {option}"
                )
        return plan

    def check_mission(self) -> None:
        """Raise `MissionFileError` where the mission cannot be flown as the options change it."""
        # its detector was checked when the file was read
        check(self.mission, self.mission_source, detectors=(self.mission.detector.name,))

    def check_strategy(self) -> None:
        """Raise where a strategy of papers would fly a real aircraft, or without being asked."""
        name = self.mission.strategy
        if name in FLOWN or name not in STRATEGIES:
            return
        if not self.simulated:
            raise MissionFileError(
                f"{self.mission_source}: strategy = {name!r}: only for comparisons in "
                f"simulation; with real aircraft take one of {', '.join(FLOWN)}"
            )
        if self.strategy is not None and not self.all_strategies:
            raise UavmapError(
                f"--strategy {name}: only for comparisons in simulation; give --all-strategies "
                f"with it, or take one of {', '.join(FLOWN)}"
            )

    def as_member(self, number: int) -> Self:
        """Return the plan of one member of a fleet; of 0 that of all. Raises `MissionFileError`."""
        plan = replace(self, member=number, mission=with_own_air(self.mission))
        if not number:
            return plan
        if plan.mission != self.mission:
            # other heights, speeds and lanes than those that the file was checked for
            plan.check_mission()
        check_fleet(plan.mission, self.mission_source)
        check_member(plan.mission, self.mission_source, number)
        for option, given in (("--connect", self.urls), ("--camera", self.cameras)):
            if len(given) > 1:
                raise LinkError(
                    f"{option} is given {len(given)} times; a service on board flies one vehicle"
                )
        return plan

    def known_setting(self) -> Setting:
        """The mission as it is flown, or was."""
        return setting_of(self.mission, self.member)

    def setting(self, say: Callable[[str], None]) -> Setting:
        """The mission, ready to be flown, its planner compiled; says so where it will be slow."""
        setting = self.known_setting()
        tell_if_uncompiled([setting.mission.strategy], say)
        ready_planner(setting.mission.strategy, say)
        return setting

    def as_json(self) -> dict[str, Any]:
        """Return what a journal keeps of it."""
        values: dict[str, Any] = _ADAPTER.dump_python(
            self, mode="json", exclude_unset=True, warnings=False
        )
        return values

    @classmethod
    def of_json(cls, values: Mapping[str, Any], folder: Path) -> FlightPlan:
        """The inverse of `as_json`, for the flight of a folder."""
        plan = _ADAPTER.validate_json(json.dumps(values))
        return replace(plan, mission=with_kept_detector(plan.mission, folder))

    @classmethod
    def read(cls, journal: JournalReader) -> FlightPlan:
        """The plan that a journal was begun with. Raises `JournalError`."""
        meta, path = journal.meta, journal.path
        try:
            plan = _ADAPTER.validate_json(json.dumps(meta[PLAN]))
        except (KeyError, ValueError, UavmapError):
            raise JournalError(f"{path} holds no flight plan; it cannot go on") from None
        if not math.isfinite(plan.epoch_utc_s):
            raise JournalError(f"{path} holds no flight plan; it cannot go on")
        # the plan on disk never changes: it is in the first line
        return replace(
            plan,
            mission=with_kept_detector(plan.mission, path.parent),
            rehomed=plan.rehomed or meta.get(REHOMED) is True,
        )


def check_member(mission: Mission, source: str, member: int) -> None:
    """Raise `MissionFileError` where a mission has no vehicle of that number."""
    if not 0 < member <= len(mission.vehicles):
        raise MissionFileError(
            f"{source}: there is no vehicle {member}, it has {len(mission.vehicles)}; "
            "give the number of yours with --vehicle"
        )


_ADAPTER: Final[TypeAdapter[FlightPlan]] = TypeAdapter(FlightPlan)
