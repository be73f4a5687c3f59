"""What a flight is started with, as it lies in the journal."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, Protocol

from pydantic import TypeAdapter

from missions.errors import JournalError, LinkError, MissionFileError
from missions.mission_file.checks import check
from missions.mission_file.fleet_checks import check_fleet, with_own_air
from missions.mission_file.schema import Mission, VehicleSection
from missions.state import Setting
from uavmap import __version__
from uavmap.journal.event_log import PLAN
from uavmap.kept_detector import with_kept_detector
from uavmap.mission_source import MissionSource
from uavmap.notices import ready_planner, tell_if_uncompiled

JOURNAL: Final = "journal.jsonl"
TLOG: Final = "flight.tlog"
REHOMED: Final = "rehomed"
"""In the journal's meta: whether the simulated aircraft were put at home after the start."""
Driver = Literal["pymavlink", "mavsdk"]
PYMAVLINK: Final = "pymavlink"
MAVSDK: Final = "mavsdk"
DRIVERS: Final[tuple[Driver, ...]] = (PYMAVLINK, MAVSDK)
"""Who speaks MAVLink: this program with pymavlink's codec, or MAVSDK."""
SIM_EPOCH_UTC_S: Final = 1577836800.0
"""Simulated flights begin on 2020-01-01, so that equal flights have equal logs."""


class HasMeta(Protocol):
    """What is needed of a journal to read its plan."""

    @property
    def path(self) -> Path:
        """Where it lies."""
        ...

    @property
    def meta(self) -> Mapping[str, Any]:
        """What the mission was started with."""
        ...


@dataclass(frozen=True, slots=True)
class FleetNetwork:
    """How a member of a fleet reaches the others: endpoints as Zenoh writes them."""

    listen: tuple[str, ...] = ()
    peers: tuple[str, ...] = ()
    routers: tuple[str, ...] = ()
    key_file: str | None = None
    """Where the key of the fleet lies; the key itself is nowhere."""

    @property
    def alone(self) -> bool:
        """Whether there is nobody to be reached."""
        return not (self.listen or self.peers or self.routers)


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """What a flight is started with; it is written into the journal and read back."""

    mission_source: str
    mission_text: str
    strategy: str | None
    vehicles: int | None
    seed: int
    urls: tuple[str, ...]
    """Empty in simulation."""
    speedup: float | None
    epoch_utc_s: float
    version: str = __version__
    auto_swap: bool = False
    """Whether a fresh battery alone allows take-off: for simulators, where nobody stands near."""
    rehomed: bool = False
    """Whether the simulated aircraft were put at home once: the flight cannot be repeated."""

    driver: Driver = PYMAVLINK
    """Who speaks MAVLink with the aircraft."""
    cameras: tuple[str, ...] = ()
    """One a vehicle, instead of the mission file's; empty: those."""
    key_file: str | None = None
    """Where the signing key lies; the key itself is nowhere."""
    onboard: bool = False
    """Whether the service flies with a vehicle, and is no ground station to it."""
    forward: tuple[str, ...] = ()
    """URLs of ground stations to which the vehicles' frames are passed on, and theirs back."""
    member: int | None = None
    """Of a fleet whose vehicles each have a service of their own: which vehicle this one flies; 0
    is the journal that was merged from those of all."""
    comms: str | None = None
    """How the members of a simulated fleet hear each other (`uavmap.comms.air`)."""
    network: FleetNetwork | None = None
    """How this member of a fleet of real vehicles reaches the others."""

    @property
    def simulated(self) -> bool:
        """Whether the aircraft are simulated in this process."""
        return not self.urls and self.network is None

    def check_driver(self) -> None:
        """Raise `LinkError` where the driver cannot fly this."""
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

    def mission(self) -> Mission:
        """The mission with what the command line changed. Raises `MissionFileError`."""
        source = MissionSource(self.mission_source, self.mission_text)
        mission = source.parse()
        changes: dict[str, Any] = {}
        if self.strategy is not None:
            changes["strategy"] = self.strategy
        urls = self.urls if self.member is None else ()
        wanted = self.vehicles or len(urls) or len(mission.vehicles)
        if wanted != len(mission.vehicles):
            spare = tuple(VehicleSection() for _ in range(wanted))
            changes["vehicles"] = (mission.vehicles + spare)[:wanted]
        if changes:
            mission = mission.model_copy(update=changes)
            if self.member != 0:  # which is merged of flights, and is not flown
                # its detector was looked at when the file was read
                check(mission, self.mission_source, detectors=(mission.detector.name,))
        if self.member is not None:
            given, mission = mission, with_own_air(mission)
            if self.member:
                if mission.vehicles != given.vehicles or mission.search != given.search:
                    # other heights, speeds and lanes than those that the file was checked for
                    check(mission, self.mission_source, detectors=(mission.detector.name,))
                check_fleet(mission, self.mission_source)
                self._check_one(mission, self.member)
            return mission
        if not self.simulated and len(self.urls) != len(mission.vehicles):
            raise MissionFileError(
                f"{self.mission_source}: {len(mission.vehicles)} vehicles, but "
                f"{len(self.urls)} connection URLs; give --connect once a vehicle"
            )
        if self.cameras and len(self.cameras) != len(mission.vehicles):
            raise MissionFileError(
                f"{self.mission_source}: {len(mission.vehicles)} vehicles, but "
                f"{len(self.cameras)} cameras; give --camera once a vehicle, in the same order"
            )
        return mission

    def _check_one(self, mission: Mission, member: int) -> None:
        """Raise where there is not one link and one camera for the vehicle of a member."""
        check_member(mission, self.mission_source, member)
        for option, given in (("--connect", self.urls), ("--camera", self.cameras)):
            if len(given) > 1:
                raise LinkError(
                    f"{option} is given {len(given)} times; a service on board flies one vehicle"
                )

    def known_setting(self) -> Setting:
        """The mission as it is flown, or was. Raises `MissionFileError`."""
        return Setting.of(self.mission(), self.member)

    def setting(self, say: Callable[[str], None]) -> Setting:
        """The mission, ready to be flown, its planner compiled; says so where it will be slow.

        Raises `MissionFileError`.
        """
        setting = self.known_setting()
        tell_if_uncompiled([setting.mission.strategy], say)
        ready_planner(setting.mission.strategy, say)
        return setting

    @classmethod
    def read(cls, journal: HasMeta) -> FlightPlan:
        """The plan that a journal was begun with. Raises `JournalError`."""
        meta, path = journal.meta, journal.path
        try:
            plan = _ADAPTER.validate_json(json.dumps(meta[PLAN]), strict=True)
        except (KeyError, ValueError):
            raise JournalError(f"{path} holds no flight plan; it cannot go on") from None
        if not math.isfinite(plan.epoch_utc_s) or not 0 < (plan.speedup or 1.0) < math.inf:
            raise JournalError(f"{path} holds no flight plan; it cannot go on")
        # the plan on disk never changes: it is in the first line
        return replace(
            plan,
            mission_text=with_kept_detector(plan.mission_text, path.parent),
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
