"""What a flight is asked for, on the command line or in Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from missions.errors import LinkError, UavmapError
from missions.mission.schema import MAX_VEHICLES
from uavmap.base.arguments import choice, number, whole

Driver = Literal["pymavlink", "mavsdk"]
PYMAVLINK: Final = "pymavlink"
MAVSDK: Final = "mavsdk"
DRIVERS: Final[tuple[Driver, ...]] = (PYMAVLINK, MAVSDK)
"""Drivers that speak MAVLink: this program with pymavlink's codec, or MAVSDK."""
KEY_VARIABLE: Final = "UAVMAP_KEY_FILE"
"""Environment variable with the file of the signing key, where none is given."""
RANGES: Final[Mapping[str, tuple[float, float]]] = MappingProxyType(
    {"vehicles": (1, MAX_VEHICLES), "seed": (0, 2**63 - 1), "speedup": (0.001, 1000.0)}
)
"""Least and largest value of each number, both included."""


@dataclass(frozen=True, slots=True)
class FleetNetwork:
    """How a member of a fleet reaches the others: endpoints as Zenoh writes them."""

    listen: tuple[str, ...] = ()
    peers: tuple[str, ...] = ()
    routers: tuple[str, ...] = ()
    key_file: str | None = None
    """The file of the fleet's key; the key itself is never stored."""

    @property
    def alone(self) -> bool:
        """Whether no other member can be reached."""
        return not (self.listen or self.peers or self.routers)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOptions:
    """The options of one flight; `uavmap.ui.cli.option_table` describes each for its user.

    None, or an empty tuple, leaves the mission file's value. Raises `UavmapError` for a value out
    of its range, and `LinkError` for options that exclude each other.

    Attributes:
        mission_source: The path of a mission file, or the name of a shipped mission.
        simulated: Whether the aircraft are simulated in this process.
        urls: One for each vehicle.
        cameras: One for each vehicle.
        vehicles: Their number; None: that of the mission file, or of the URLs.
        detector: A folder of `uavmap tune`.
        seed: Of the simulation.
        speedup: Times real time; None: as fast as possible in simulation, else 1.
        auto_swap: Whether a fresh battery alone allows take-off: only for simulators.
        onboard: Whether the service flies with the vehicle, and is no ground station to it.
        member: The vehicle of this service in a fleet with a service for each; 0: a service on the
            ground, or a map merged of several journals.
        network: How this member reaches the others, with real vehicles.
        comms: How the members of a simulated fleet reach each other.
        key_file: The file of the signing key; the key itself is never stored.
        forward: URLs of ground stations to which all frames are passed on.
        all_strategies: Whether strategies of papers may fly, in simulation.
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
                "--camera goes with --connect: with --sim the cameras are simulated, too"
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
