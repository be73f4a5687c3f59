"""The plan at the start of a flight, as the journal keeps it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, Self

from pydantic import TypeAdapter

from missions.errors import JournalError, LinkError, MissionFileError, UavmapError
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mission.checks import FLOWN, STRATEGIES, check, with_strategy
from missions.mission.fleet_checks import check_fleet, with_own_air, with_vehicles
from missions.mission.schema import MAX_VEHICLES, Mission
from uavmap.base.arguments import choice, number, whole
from uavmap.base.version import __version__
from uavmap.journal.event_log import PLAN, JournalReader
from uavmap.load.detector_source import require_detector, with_kept_detector
from uavmap.load.strategy_source import compile_planner, warn_if_uncompiled

Driver = Literal["pymavlink", "mavsdk"]
PYMAVLINK: Final = "pymavlink"
MAVSDK: Final = "mavsdk"
DRIVERS: Final[tuple[Driver, ...]] = (PYMAVLINK, MAVSDK)
"""MAVLink drivers: this program with pymavlink's codec, or MAVSDK."""
KEY_VARIABLE: Final = "UAVMAP_KEY_FILE"
"""Environment variable with the file of the signing key, if none is given."""
RANGES: Final[Mapping[str, tuple[float, float]]] = MappingProxyType(
    {"vehicles": (1, MAX_VEHICLES), "seed": (0, 2**63 - 1), "speedup": (0.001, 1000.0)}
)
"""Minimum and maximum of each number, both included."""


@dataclass(frozen=True, slots=True)
class FleetNetwork:
    """The network of a member of a fleet: endpoints in the form of Zenoh."""

    listen: tuple[str, ...] = ()
    peers: tuple[str, ...] = ()
    routers: tuple[str, ...] = ()
    key_file: str | None = None
    """File of the fleet's key; the key itself is never stored."""

    @property
    def alone(self) -> bool:
        """True if no other member can be reached."""
        return not (self.listen or self.peers or self.routers)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOptions:
    """The options of one flight; `uavmap.ui.cli.option_table` describes each for its user.

    None, or an empty tuple, keeps the mission file's value. `member` is the vehicle of this service
    in a fleet with a service for each. It is 0 for a service on the ground, or a map merged of
    several journals. `network` is for real members, `comms` for simulated ones. A `speedup` of None
    is as fast as possible in simulation, else 1. Keys themselves are never stored. Raises
    `UavmapError` for a value out of its range, and `LinkError` for options that exclude each other.
    """

    mission_source: str
    simulated: bool = False
    urls: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    vehicles: int | None = None
    strategy: str | None = None
    detector: str | None = None
    seed: int = 1
    speedup: float | None = None
    auto_swap: bool = False
    driver: Driver = PYMAVLINK
    onboard: bool = False
    member: int | None = None
    network: FleetNetwork | None = None
    comms: str | None = None
    key_file: str | None = None
    forward: tuple[str, ...] = ()
    all_strategies: bool = False

    def __post_init__(self) -> None:
        whole("seed", self.seed, *map(int, RANGES["seed"]))
        if self.vehicles is not None:
            whole("vehicles", self.vehicles, *map(int, RANGES["vehicles"]))
        if self.speedup is not None:
            number("speedup", self.speedup, *RANGES["speedup"])
        choice("driver", self.driver, DRIVERS)
        if self.simulated and self.urls:
            raise UavmapError("--sim and --connect exclude each other; give one of them")
        if self.simulated and self.cameras:
            raise LinkError(
                "--camera goes with --connect: with --sim the cameras are simulated also"
            )
        if self.simulated and self.driver == MAVSDK:
            raise LinkError(
                "--driver mavsdk cannot fly with --sim: MAVSDK has a clock of its own, and a "
                "simulated flight is on virtual time; start `uavmap sitl`, and give its URLs with "
                "--connect"
            )
        if self.key_file is not None and self.driver == MAVSDK:
            raise LinkError(
                "--driver mavsdk does not sign: fly with a key (--key, UAVMAP_KEY_FILE) by "
                "--driver pymavlink"
            )
        if self.all_strategies and not self.simulated:
            raise UavmapError(
                "--all-strategies is for --sim: the others have flown with real aircraft; leave "
                "it out, or give --sim"
            )
        if self.comms is not None and not self.simulated:
            raise LinkError(
                "--comms is for --sim; on real aircraft each computer runs `uavmap onboard`"
            )


JOURNAL: Final = "journal.jsonl"
TLOG: Final = "flight.tlog"
REHOMED: Final = "rehomed"
"""Key of the journal's meta: whether simulated aircraft were put at home after the start."""
SIM_EPOCH_UTC_S: Final = 1577836800.0
"""Start of simulated flights, 2020-01-01, UTC s: equal flights have equal logs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan(FlightOptions):
    """The options of a flight, and its checked mission: a resume needs none of its source files."""

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
        plan.check_simulated_only()
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
        """Raise `MissionFileError` if the mission with the options cannot be flown."""
        # its detector was checked when the file was read
        check(self.mission, self.mission_source, detectors=(self.mission.detector.name,))

    def check_simulated_only(self) -> None:
        """Raise if a real aircraft would fly without a detector, or by a strategy of papers."""
        if not self.simulated:
            require_detector(self.mission.detector, self.mission_source)
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
            # heights, speeds and lanes differ from those for which the file was checked
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
        """Return the mission as it is flown, or was."""
        return setting_of(self.mission, self.member)

    def setting(self, say: Callable[[str], None]) -> Setting:
        """Return the mission, ready to be flown, its planner compiled; log if it will be slow."""
        setting = self.known_setting()
        warn_if_uncompiled([setting.mission.strategy], say)
        compile_planner(setting.mission.strategy, say)
        return setting

    def as_json(self) -> dict[str, Any]:
        """Return the values for a journal."""
        values: dict[str, Any] = _ADAPTER.dump_python(
            self, mode="json", exclude_unset=True, warnings=False
        )
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any], folder: Path) -> FlightPlan:
        """Return the plan of JSON values, for the flight of a folder: the inverse of `as_json`."""
        plan = _ADAPTER.validate_json(json.dumps(values))
        return replace(plan, mission=with_kept_detector(plan.mission, folder))

    @classmethod
    def read(cls, journal: JournalReader) -> FlightPlan:
        """Return the plan at the start of a journal. Raises `JournalError`."""
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
    """Raise `MissionFileError` if a mission has no vehicle of that number."""
    if not 0 < member <= len(mission.vehicles):
        raise MissionFileError(
            f"{source}: there is no vehicle {member}, it has {len(mission.vehicles)}; "
            "give the number of yours with --vehicle"
        )


_ADAPTER: Final[TypeAdapter[FlightPlan]] = TypeAdapter(FlightPlan)
